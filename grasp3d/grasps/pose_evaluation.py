"""Evaluation of poses: the jaws are closed on the object, and the contacts are evaluated."""

from dataclasses import replace

import numpy as np

from grasp3d.arrays import Bools, Floats, locked
from grasp3d.errors import ContactError
from grasp3d.grasps.evaluated_poses import EvaluatedPoses
from grasp3d.grasps.poses import GraspPoses
from grasp3d.hand.choices import ObjectMotion
from grasp3d.hand.hand import touching
from grasp3d.hand.jaws import metres_per_unit
from grasp3d.hand.scene import Scene
from grasp3d.mesh import MeshSource, ObjectMesh, load_mesh
from grasp3d.quality.critical_angle import critical_friction_angle
from grasp3d.quality.loads import Load
from grasp3d.settings import GraspModel, with_fingers
from grasp3d.surface.contacts import JawContacts
from grasp3d.surface.grasp_table import GraspTable
from grasp3d.surface.load_case import LoadCase
from grasp3d.surface.masses import loaded_mesh
from grasp3d.surface.rows import rows_where
from grasp3d.system.processors import thread_count
from grasp3d.system.progress import Progress, ignore, within

JAWS_CLOSED = 0.7
"""Fraction of the work after which the jaws are closed."""

ROUNDING = 1e-9
"""Angle by which a limit may be exceeded through rounding [rad]."""


def evaluate_poses(
    mesh: MeshSource,
    poses: GraspPoses,
    model: GraspModel | None,
    scene: Scene,
    *,
    object_motion: ObjectMotion = "free",
    load: Load | None = None,
    threads: int | None = None,
    progress: Progress | None = None,
) -> EvaluatedPoses:
    """Close the jaws of a gripper on an object from given poses, and evaluate the grasps.

    As `evaluate_grasps` does.

    Args:
        mesh: The object; one whose unit is not known gets the scale that the poses state, if any.
        poses: The poses; without a unit they are in the mesh's.
        model: Friction and sensor resolution [rad]; None: the defaults, with the resolution that
            the gripper states, if any.
        scene: The gripper, the table and the allowed approach.
        object_motion: free: the object settles between the jaws; fixed: it does not move.
        load: What each grasp must hold; None: nothing.
        threads: Threads to use; None: one per processor.
        progress: Called with the fraction of the work done, from 0 to 1.

    Raises:
        MeshError: It is no mesh.
        SettingError: The unit of the mesh is not known, a setting is outside its range, or the load
            needs a mass that is not known.
        ContactError: A grasp is internal: its opening is larger than the one before it.
    """
    hand = scene.hand
    mesh = in_stated_scale(load_mesh(mesh), poses)
    metres_per_unit(mesh)
    mesh, load = loaded_mesh(mesh, load)
    given = poses.scaled(1.0, mesh.unit) if poses.unit is None else _in_unit(poses, mesh)
    _check_external(given)
    used = touching(hand, GraspModel()) if model is None else model
    (used,) = mesh.in_own_unit(with_fingers(used, hand.fingers[-1]))
    threads = thread_count(threads)
    if load is not None:
        LoadCase.of(load, mesh, used, hand)  # refuse it before the work
    report = progress or ignore
    closing = within(report, 0.0, JAWS_CLOSED)
    jaws = hand.close(
        mesh,
        given.poses,
        posture=given.posture,
        object_motion=object_motion,
        friction=float(np.min(used.frictions)),
        threads=threads,
        progress=closing,
    )
    held = jaws.closed if object_motion == "fixed" else np.zeros(given.count, dtype=np.bool_)
    colliding = hand.blocked(
        mesh, given.poses, jaws, posture=given.posture, held=held, table=scene.table,
        threads=threads,
    )  # fmt: skip
    contacts = JawContacts.of(mesh, jaws)
    angles = np.zeros(0)
    if contacts.size:
        angles = critical_friction_angle(contacts.contacts(used))
    grasps = GraspTable(
        contacts=contacts, model=used, critical_angle=locked(angles),
        critical_angle_best=locked(angles),
        scene=scene, load=load, threads=threads,
    )  # fmt: skip
    found = EvaluatedPoses(
        grasps=grasps,
        row=rows_where(jaws.closed),
        given=given,
        jaws=jaws,
        object_motion=object_motion,
        collides=locked(colliding),
        reachable=locked(
            jaws.closed
            & ~colliding
            & hand.opens_to(mesh, jaws)
            & _within_approach(given.poses, scene)
        ),
    )
    found.compute_labels(within(report, JAWS_CLOSED, 1.0))
    report(1.0)
    return found


def in_stated_scale(mesh: ObjectMesh, grasps: GraspPoses | Floats) -> ObjectMesh:
    """The mesh in metres, where its unit is not known and poses state the scale of its file.

    Args:
        mesh: The object.
        grasps: Poses on it; contacts state no scale.
    """
    scale = grasps.object_scale if isinstance(grasps, GraspPoses) else None
    if mesh.unit is not None or scale is None:
        return mesh
    # Normals and their sets do not depend on the size.
    return replace(
        mesh,
        vertices=locked(mesh.vertices * scale),
        center=locked(mesh.center * scale),
        size=mesh.size * scale,
        center_mass=locked(mesh.center_mass * scale),
        volume=mesh.volume * scale**3,
        report=replace(mesh.report, unit="m"),
    )


def _check_external(poses: GraspPoses) -> None:
    """Refuse internal grasps, whose jaws would have to move apart."""
    internal = np.flatnonzero(poses.pregrasp_opening < poses.opening)
    if len(internal):
        raise ContactError(
            f"{poses.names[internal[0]]} is an internal grasp, as are {len(internal)} of "
            f"{poses.count}: its fingers push outward; only external grasps are evaluated"
        )


def _in_unit(poses: GraspPoses, mesh: ObjectMesh) -> GraspPoses:
    assert mesh.unit is not None
    return poses.in_unit(mesh.unit)


def _within_approach(poses: Floats, scene: Scene) -> Bools:
    """Whether each approach direction is allowed, (k,)."""
    direction = scene.approach.direction
    if direction is None and scene.table is not None:
        direction = -scene.table.normal
    if direction is None:
        return np.ones(len(poses), dtype=np.bool_)
    angle = np.arccos(np.clip(poses[:, :3, 2] @ direction, -1.0, 1.0))
    return np.asarray(angle <= scene.approach.within + ROUNDING)
