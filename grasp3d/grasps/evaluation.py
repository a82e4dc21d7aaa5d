"""Evaluation of given grasps on a mesh: contacts, or poses at which a hand closes."""

import math
from dataclasses import replace
from pathlib import Path, PurePath
from typing import Any, overload

import numpy as np

from grasp3d.arrays import ArrayLike, Floats, locked
from grasp3d.contact.contacts import LARGEST
from grasp3d.errors import ContactError, SettingError
from grasp3d.formats import holds_poses, read_poses
from grasp3d.formats.frames import UnknownUnitError
from grasp3d.formats.own import contacts_in
from grasp3d.formats.poses import GraspPoses
from grasp3d.grasps.evaluated_poses import EvaluatedPoses
from grasp3d.grasps.jaw_grasps import JawGrasps
from grasp3d.grasps.link_grasps import LinkGrasps
from grasp3d.hand.articulated_hand import ArticulatedHand
from grasp3d.hand.choices import ContactRule, ObjectMotion
from grasp3d.hand.hand import Hand
from grasp3d.hand.hand_files import GivenHand, given_hand
from grasp3d.hand.jaws import IN_METRES
from grasp3d.hand.pose_checks import check_near, numbers_text
from grasp3d.hand.scene import Scene
from grasp3d.hand.table import Approach, GivenTable
from grasp3d.mesh import MeshSource, ObjectMesh, load_mesh
from grasp3d.mesh.object_mesh import scale_of
from grasp3d.mesh.region import allowed_contacts
from grasp3d.mesh.repair import RepairStep
from grasp3d.mesh.surface_points import SurfacePoints, nearest_surface_points
from grasp3d.quality.loads import GivenLoad, Load
from grasp3d.settings import MAX_FINGERS, GivenModel, GraspModel, MeshOptions, with_fingers
from grasp3d.settings.pose_error import PoseError
from grasp3d.settings.units import METRES, GivenLength, Unit, with_lengths_scaled
from grasp3d.surface.contacts import SurfaceContacts, critical_angles
from grasp3d.surface.grasp_table import GraspTable
from grasp3d.surface.labelled_grasps import LabelledGrasps
from grasp3d.surface.load_case import LoadCase
from grasp3d.system.context import refuse_warnings, report_progress, within

OFF_SURFACE = 1.0 / 100.0
"""Distance from the surface, in object sizes, up to which a given contact is moved onto it."""

DISTANCE_ROUNDING = 1e-9
"""Distance, in object sizes, of a contact from the surface that rounding explains."""

PROJECTED, ANGLES_COMPUTED = 0.5, 0.9
"""Fractions of the work after which contacts are on the surface and critical angles are known."""


@overload
def evaluate_grasps(
    mesh: MeshSource, grasps: GraspPoses, model: GivenModel = None, *,
    hand: GivenHand = None, table: GivenTable = None, approach: Approach | None = None,
    pose_error: PoseError | str | None = None, scene: Scene | None = None,
    object_motion: ObjectMotion | None = None, contact_rule: ContactRule | None = None,
    contact_distance: GivenLength | None = None, load: GivenLoad = None,
) -> EvaluatedPoses: ...  # fmt: skip
@overload
def evaluate_grasps(
    mesh: MeshSource, grasps: ArrayLike, model: GivenModel = None, *,
    hand: GivenHand, table: GivenTable = None, approach: Approach | None = None,
    pose_error: PoseError | str | None = None,
    object_motion: ObjectMotion | None = None, load: GivenLoad = None,
) -> EvaluatedPoses: ...  # fmt: skip
@overload
def evaluate_grasps(
    mesh: MeshSource, grasps: ArrayLike, model: GivenModel = None, *,
    max_distance: GivenLength | None = None, load: GivenLoad = None,
) -> GraspTable: ...  # fmt: skip
@overload
def evaluate_grasps(
    mesh: MeshSource, grasps: str | Path, model: GivenModel = None, *,
    hand: GivenHand = None, table: GivenTable = None, approach: Approach | None = None,
    pose_error: PoseError | str | None = None, scene: Scene | None = None,
    object_motion: ObjectMotion | None = None, contact_rule: ContactRule | None = None,
    contact_distance: GivenLength | None = None,
    max_distance: GivenLength | None = None, load: GivenLoad = None,
) -> GraspTable | EvaluatedPoses: ...  # fmt: skip
def evaluate_grasps(
    mesh: MeshSource,
    grasps: GraspPoses | ArrayLike | str | Path,
    model: GivenModel = None,
    *,
    hand: GivenHand = None,
    table: GivenTable = None,
    approach: Approach | None = None,
    pose_error: PoseError | str | None = None,
    scene: Scene | None = None,
    contact_rule: ContactRule | None = None,
    contact_distance: GivenLength | None = None,
    object_motion: ObjectMotion | None = None,
    max_distance: GivenLength | None = None,
    load: GivenLoad = None,
) -> GraspTable | EvaluatedPoses:
    """Compute label, critical friction angle and epsilon of given grasps, as contacts or poses.

    Contacts are moved to the nearest surface points, and have the normals there. The order of the
    contacts of a grasp does not matter.

    At poses of a gripper each jaw moves until it touches, and a free object gives way, with the
    model's friction. `close_jaws` describes this, and how a touched patch becomes a contact. A pose
    whose jaws close on nothing is U, without numbers. A grasp with a contact outside the mesh's
    region is U with an infinite critical angle.

    At poses of a hand with joints, given with their joint values, the links that touch make the
    grasp; see `LinkGrasps`.

    Args:
        mesh: The object: an `ObjectMesh`, or anything `load_mesh` takes (a path, a mesh of trimesh,
            PyVista or Open3D, or a pair of arrays), which is then prepared with default options. If
            its unit is not known and the poses state a scale, it gets this scale.
        grasps: Contacts in the mesh's frame, shape (b, n, 3), or (n, 3) for one grasp; n is 2 to 32
            for every grasp. Or poses of a gripper: `GraspPoses`, or 4x4 matrices [m], shape (k, 4,
            4), or (4, 4) for one. Or a file of either, as `read_grasps` takes it. Poses and files
            without a unit are in that of the mesh's file.
        model: Friction and sensor resolution [rad], or a dict of fields; None: the defaults, at
            poses with the resolution that the gripper states, if any. Its number of fingers, unless
            it is the default 2, must be that of the grasps.
        hand: The gripper or hand of the poses, or its name or file.
        table: What the object stands on, at poses, as in `label_surface`; None: nothing.
        approach: Allowed approach directions of the gripper; None: any.
        pose_error: How wrong the poses may be, such as '5mm,3deg'. `robustness` then includes poses
            that are wrong by up to this error, and fingers may start inside the object by less than
            it. None: the poses are exact.
        scene: The gripper, the table, the approach and the pose error as one, instead of the four.
        contact_rule: For hands with joints, which contacts a pose makes. given, or None: the points
            of links within `contact_distance` of the surface; closed: the hand closes from its
            preshape "open" until its links touch.
        contact_distance: For hands with joints, the distance from the surface, to either side, up
            to which a link touches, in metres or with a unit; None: 5 mm.
        object_motion: For poses of grippers. free, or None: the object settles between the jaws;
            fixed: it does not move.
        max_distance: Largest distance of a contact from the surface, in metres or with a
            unit; None: 1/100 of the object's size.
        load: What each grasp must hold, and with which force. `load_result` then has the grip force
            and payload of each grasp. At poses the force is the greatest one of the gripper, unless
            the load states another; hands with joints hold the payload with their motors. The
            fingers alone hold the mass, not the table. None: nothing.

    Returns:
        The grasps in their order, with `label`, `critical_angle` [rad] and `epsilon`, shape (b,)
        each. Given contacts come back on the surface, shape (b, n, 3); poses have the contacts that
        the jaws or links make.

    Raises:
        MeshError: The input is not a mesh.
        ContactError: Contacts have another shape, are not finite or are off the surface; or a pose
            is an internal grasp: its opening is larger than the pre-grasp opening.
        SettingError: A setting is outside its range, or is for contacts where there are poses or
            the other way round; poses come without a gripper, or the mesh without a unit; or a load
            needs a mass or unit that is not known.

    Example:
        Two fingers opposite each other, and two that are not:

        >>> import numpy as np
        >>> import trimesh
        >>> import grasp3d
        >>> box = trimesh.creation.box([0.08, 0.05, 0.03])
        >>> top, bottom, beside = [0.0, 0.0, 0.015], [0.0, 0.0, -0.015], [0.012, 0.0, -0.015]
        >>> grasps = grasp3d.evaluate_grasps(box, [[top, bottom], [top, beside]])
        >>> [grasp3d.Label(code).name for code in grasps.label]
        ['S', 'M']
        >>> np.degrees(grasps.critical_angle).round(1).tolist()
        [0.0, 21.8]
        >>> grasps.epsilon.round(3).tolist(), grasps.epsilon_min.round(3).tolist()
        ([0.131, 0.025], [0.077, 0.0])

        Soft fingers on the sides of a part of 0.5 kg, with gravity across the line through them and
        the centre of mass: each must press with m g / (2 friction):

        >>> mesh = grasp3d.load_mesh(box, unit="m")
        >>> soft = grasp3d.GraspModel(torsion_radius="3mm")
        >>> load = grasp3d.Load(mass=0.5, task="weight within 0 of -z")
        >>> sides = [[0.0, 0.025, 0.0], [0.0, -0.025, 0.0]]
        >>> load_result = grasp3d.evaluate_grasps(mesh, sides, soft, load=load).load_result
        >>> print(f"{load_result.grip_force[0]:.2f} N")
        4.90 N

        A gripper from above, and beside the part:

        >>> from_above = np.diag([1.0, -1.0, -1.0, 1.0])
        >>> beside = from_above + [[0, 0, 0, 0], [0, 0, 0, 0.1], [0, 0, 0, 0], [0, 0, 0, 0]]
        >>> franka = grasp3d.ParallelGripper.preset("franka")
        >>> results = grasp3d.evaluate_grasps(mesh, [from_above, beside], hand=franka)
        >>> results.to_dataframe()[["closing", "label", "opening", "reachable"]].round(3)
           closing label  opening  reachable
        0   closed     S     0.08       True
        1  nothing     U      NaN      False
    """
    model, load, hand = GraspModel.given("model", model), Load.given("load", load), given_hand(hand)
    grasps, mesh = _on_mesh(grasps, load_mesh(mesh), hand)
    scene = scene or Scene.given(mesh, hand, table, approach, pose_error)
    of_poses = {
        "object_motion": object_motion, "contact_rule": contact_rule,
        "contact_distance": contact_distance,
    }  # fmt: skip
    if not isinstance(grasps, GraspPoses):
        if scene is not None or any(value is not None for value in of_poses.values()):
            raise SettingError(
                "a gripper applies to poses, not to contacts; give poses, of shape (k, 4, 4)"
            )
        return evaluate_contacts(mesh, grasps, model, max_distance=max_distance, load=load)
    if max_distance is not None:
        raise SettingError("max_distance applies to contacts, not to poses of a gripper")
    if scene is None:
        raise SettingError(
            "poses are evaluated for a gripper; give it (--hand, in Python hand=...)"
        )
    return evaluate_poses(mesh, grasps, model, scene, load=load, **of_poses)


def _on_mesh(
    grasps: GraspPoses | ArrayLike | str | Path, mesh: ObjectMesh, hand: Hand | None
) -> tuple[GraspPoses | ArrayLike, ObjectMesh]:
    """Return poses or contacts on a mesh, and the mesh in the scale that the poses state."""
    if isinstance(grasps, str | Path):
        if holds_poses(grasps):
            grasps = poses_of_file(Path(grasps), mesh, hand=hand)
        else:
            return contacts_on(mesh, *contacts_in(Path(grasps))), mesh
    grasps = _poses_or_contacts(grasps)
    return grasps, in_stated_scale(mesh, grasps) if isinstance(grasps, GraspPoses) else mesh


def poses_of_file(path: Path, mesh: ObjectMesh, **stated: Any) -> GraspPoses:
    """Read poses; if they need a unit and the file states none, take that of the mesh's file.

    Args:
        path: The file.
        mesh: The object.
        stated: What is known of the file, as `read_poses` takes it.
    """
    try:
        return read_poses(path, **stated)
    except UnknownUnitError:
        if mesh.file_unit is None:
            raise
        return read_poses(path, unit=mesh.file_unit, **stated)


def contacts_on(mesh: ObjectMesh, contacts: Floats, unit: Unit | None) -> Floats:
    """Contacts (b, n, 3) of a file in the unit of a mesh.

    Args:
        mesh: The object.
        contacts: Contacts as they are in the file.
        unit: The unit that the file states; None: they are in that of the mesh's file.

    Raises:
        SettingError: The file states a unit, but that of the mesh is not known.
    """
    if unit is not None:
        mesh.needs_metres(f"the contacts are in {unit}")
    return np.asarray(contacts * scale_of(unit or mesh.file_unit))


def _poses_or_contacts(grasps: GraspPoses | ArrayLike) -> GraspPoses | ArrayLike:
    """Return matrices, shape (..., 4, 4), as poses, and anything else as given."""
    if isinstance(grasps, EvaluatedPoses):
        return grasps.given
    if isinstance(grasps, LabelledGrasps):
        raise SettingError(
            f"grasps must be contacts or poses; got {type(grasps).__name__}: give the "
            "contacts.points of a table of grasps"
        )
    if isinstance(grasps, GraspPoses):
        return grasps
    try:
        shape = np.shape(grasps)
    except ValueError:  # the numbers of contacts differ; this is refused later
        return grasps
    return GraspPoses(poses=np.asarray(grasps), unit="m") if shape[-2:] == (4, 4) else grasps


def evaluate_contacts(
    mesh: MeshSource,
    points: ArrayLike,
    model: GraspModel | None = None,
    *,
    max_distance: GivenLength | None = None,
    load: Load | None = None,
) -> GraspTable:
    """Move contacts (b, n, 3) to the surface and evaluate the grasps; see `evaluate_grasps`."""
    mesh, positions = load_mesh(mesh), _checked(points)
    own_model = with_fingers(model or GraspModel(), positions.shape[1])
    mesh.check_units(own_model)
    given_limit = OFF_SURFACE * mesh.size if max_distance is None else max_distance
    limit = mesh.length("max_distance", given_limit)
    if not (limit >= 0.0 and math.isfinite(limit)):
        raise SettingError(f"max_distance must be a finite length of at least 0; got {limit:g}")
    if load is not None:
        LoadCase.of(load, mesh, own_model)  # refuse an unusable load before the work
    with within(0.0, PROJECTED):
        contacts, distances = _on_surface(mesh, positions, limit)
    end = ANGLES_COMPUTED if own_model.method == "extremes" else 1.0
    with within(PROJECTED, end):
        angles = critical_angles(contacts, location_error=own_model.location_error)
    outside = ~allowed_contacts(mesh, contacts.points)
    worst, best = (locked(np.where(outside, math.inf, one)) for one in angles)
    grasps = GraspTable(
        contacts=contacts, model=own_model, critical_angle=worst, critical_angle_best=best,
        moved=distances, load=load,
    )  # fmt: skip
    refuse_warnings(grasps.warnings)
    with within(end, 1.0):
        grasps.compute_labels()
    report_progress(1.0)
    return grasps


def _on_surface(mesh: ObjectMesh, points: Floats, limit: float) -> tuple[SurfaceContacts, Floats]:
    """Contacts (b, n, 3) moved to the surface, and their distances from it before, (b, n)."""
    size, count = points.shape[:2]
    nearest, _, gaps = nearest_surface_points(
        mesh, points.reshape(-1, 3), limit=limit + DISTANCE_ROUNDING * mesh.size
    )
    distances = gaps.reshape(size, count)
    _check_near(mesh, points, distances, limit)
    faces, weights = nearest.faces.reshape(size, count), nearest.weights.reshape(size, count, 3)
    return SurfaceContacts(mesh, SurfacePoints(locked(faces), locked(weights))), locked(distances)


def _checked(points: ArrayLike) -> Floats:
    """Check contacts of at least one grasp; return them as an array of shape (b, n, 3)."""
    try:
        array = np.asarray(points, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise ContactError(f"contacts must be an array of numbers: {error}") from error
    if array.ndim == 2:
        array = array[None]
    if array.ndim != 3 or array.shape[2] != 3:
        raise ContactError(f"contacts must have shape (b, n, 3); got {np.shape(points)}")
    size, count = array.shape[:2]
    if not size:
        raise ContactError("no grasps: contacts must have shape (b, n, 3) with b at least 1")
    if not 2 <= count <= MAX_FINGERS:
        raise ContactError(f"a grasp has 2 to {MAX_FINGERS} contacts; got {count}")
    if not np.isfinite(array).all():
        grasp, contact, _ = np.argwhere(~np.isfinite(array))[0]
        point = numbers_text(array[grasp, contact])
        raise ContactError(f"{_name(grasp, contact)} must be three finite numbers; got {point}")
    if (np.abs(array) > LARGEST).any():
        raise ContactError(f"contacts must not exceed {LARGEST:g}; got {np.abs(array).max():g}")
    return array


def _check_near(mesh: ObjectMesh, array: Floats, distances: Floats, limit: float) -> None:
    """Raise ContactError if contacts are too far from the surface."""
    off = np.argwhere(np.isinf(distances))
    if not len(off):
        return
    grasp, contact = off[0]
    distance = nearest_surface_points(mesh, array[grasp, contact][None])[2][0]
    raise ContactError(
        f"{_name(grasp, contact)} at {numbers_text(array[grasp, contact])} is "
        f"{mesh.length_text(distance)} from the surface of {mesh.report.source}, more than the "
        f"allowed {mesh.length_text(limit)}; {len(off)} of {distances.size} contacts are too far: "
        f"are they in its frame and unit, in which its size is {mesh.length_text(mesh.size)}? "
        "max_distance (--max-distance) allows more"
    )


def _name(grasp: int, contact: int) -> str:
    """Name of a contact, numbered from 1."""
    return f"grasp {grasp + 1}, contact {contact + 1}"


def evaluate_poses(
    mesh: MeshSource,
    poses: GraspPoses,
    model: GraspModel | None,
    scene: Scene,
    *,
    load: Load | None = None,
    **options: Any,
) -> EvaluatedPoses:
    """Evaluate the grasps that a gripper or a hand with joints makes at given poses.

    Args:
        mesh: The object; one whose unit is not known gets the scale that the poses state, if any.
        poses: The poses; without a unit they are in that of the mesh's file.
        model: Friction and sensor resolution [rad]; None: the defaults, with the resolution that
            the gripper states, if any.
        scene: The hand, the table and the allowed approach.
        load: What each grasp must hold; None: nothing.
        options: For grippers `object_motion`, for hands with joints `contact_rule` and
            `contact_distance`, as in `evaluate_grasps`; None: the default.

    Raises:
        MeshError: The input is not a mesh.
        SettingError: The unit of the mesh is not known, a setting is outside its range or for
            another kind of hand, or the load needs a mass that is not known.
        ContactError: The poses have values of other joints, or one is an internal grasp.
    """
    kind = LinkGrasps if isinstance(scene.hand, ArticulatedHand) else JawGrasps
    stated = {name: value for name, value in options.items() if value is not None}
    other = next((name for name in stated if name not in OPTIONS[kind]), None)
    if other is not None:
        raise SettingError(f"{other} does not apply to poses of {scene.hand.name}")
    mesh = in_stated_scale(load_mesh(mesh), poses)
    mesh.needs_metres(IN_METRES)
    start = poses.on(mesh)
    if start.object_scale is None:
        start = replace(start, object_scale=mesh.file_scale)
    check_near(start.poses, mesh, stated=poses.unit, reach=scene.hand.size)
    result = kind.of(mesh, start, model, scene, load=load, **stated)
    refuse_warnings(result.warnings)
    result.compute()
    report_progress(1.0)
    return result


OPTIONS: dict[type[EvaluatedPoses], tuple[str, ...]] = {
    JawGrasps: ("object_motion",),
    LinkGrasps: ("contact_rule", "contact_distance"),
}
"""Options of `evaluate_poses` that apply to one kind of hand only."""


def poses_on(
    path: Path, source: MeshSource, options: MeshOptions | None, **stated: Any
) -> tuple[GraspPoses, ObjectMesh]:
    """Read poses and the mesh to which they belong.

    Args:
        path: File of the poses; if it states no unit, they are in that of the mesh's file.
        source: The mesh, which gets the scale that the poses state.
        options: How the mesh is read.
        stated: What is known of the file of poses, as `read_grasps` takes it.
    """
    mesh = load_mesh(source, options)
    poses = poses_of_file(path, mesh, **stated)
    return poses, in_stated_scale(mesh, poses)


def in_stated_scale(mesh: ObjectMesh, grasps: GraspPoses | Floats) -> ObjectMesh:
    """Return the mesh in metres if its unit is not known and poses state the scale of its file.

    If its unit is known and differs from this scale, the mesh gets a warning.

    Args:
        mesh: The object.
        grasps: Poses on it; contacts state no scale.

    Raises:
        SettingError: The unit differs, and the poses name this file.
    """
    scale = grasps.object_scale if isinstance(grasps, GraspPoses) else None
    if scale is None or any(step.name == SCALED for step in mesh.report.repairs):
        return mesh
    if mesh.file_unit is not None:
        assert isinstance(grasps, GraspPoses)
        return _checked_scale(mesh, mesh.file_unit, scale, grasps.object_file)
    step = RepairStep(SCALED, len(mesh.vertices), f"vertices scaled by {scale:g}, as the poses say")
    repairs = (*mesh.report.repairs, step)
    if unit := next((one for one, metres in METRES.items() if math.isclose(metres, scale)), None):
        mesh = mesh.with_unit(unit)
        return replace(mesh, report=replace(mesh.report, repairs=repairs))
    options = replace(with_lengths_scaled(mesh.options, scale), unit="m")
    report = replace(mesh.report, unit="m", repairs=repairs)
    return replace(mesh.scaled(scale), options=options, report=report)


SCALED = "scaled"
"""Name of the repair step that scales a mesh as poses state."""

SCALE_ROUNDING = 1e-4
"""Relative difference of scales that rounding explains."""


def _checked_scale(mesh: ObjectMesh, unit: Unit, scale: float, file: str | None) -> ObjectMesh:
    """Return the mesh, with a warning if its unit differs from the scale that poses state.

    Raises:
        SettingError: It differs, and the poses name the mesh's file.
    """
    units = [one for one in METRES if math.isclose(METRES[one], scale, rel_tol=SCALE_ROUNDING)]
    report = mesh.report
    if unit in units:
        return mesh
    remedy = f"scale the mesh by {scale / METRES[unit]:.6g} and give it another name"
    if units or mesh.options.unit is not None:
        remedy = f"give --unit {units[0]}" if units else "leave --unit out"
    text = (
        f"the poses belong to an object whose file has numbers of {scale:g} m (object_scale), but "
        f"the unit of {report.source} is {unit}: {remedy}"
    )
    if file is not None and PurePath(file).name == report.source:
        raise SettingError(text)
    warnings = dict.fromkeys((*report.warnings, f"{text}, if it is that file"))
    return replace(mesh, report=replace(report, warnings=tuple(warnings)))
