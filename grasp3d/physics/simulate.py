"""Simulating grasps drawn from an object: do S hold, and U fail?"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from grasp3d.arrays import Floats, angles_between, locked, unit_rows
from grasp3d.batch.batch_settings import ClusterSettings
from grasp3d.errors import SettingError
from grasp3d.hand.metres import metres_per_unit
from grasp3d.hand.parallel_gripper import ParallelGripper
from grasp3d.mesh import MeshSource, ObjectMesh, load_mesh
from grasp3d.mesh.noise_fields import noise_stream
from grasp3d.physics.drawing import DrawnGrasps, TruePoints, draw_grasps, true_points
from grasp3d.physics.engine import mujoco_module
from grasp3d.physics.hand import Tips
from grasp3d.physics.jobs import Stage, divided, simulate_attempts
from grasp3d.physics.parts import ConvexParts
from grasp3d.physics.pulling import Attempt
from grasp3d.physics.scene import SimulatedObject
from grasp3d.physics.simulation import Simulation
from grasp3d.physics.simulation_settings import SimulationSettings
from grasp3d.settings import GraspModel, MeshOptions, Sampling, with_fingers
from grasp3d.settings.lengths import METRES, settings_in_unit
from grasp3d.stability.label import Label
from grasp3d.system.counts import counted
from grasp3d.system.progress import Progress, ignore
from grasp3d.system.steps import begin_step

GRASPS = 3
"""Number of the stream of random numbers of simulated grasps."""

GAP = 1e-4
"""Distance of each tip from the contact when it begins to close [m]."""

MUCH_LEFT_OUT = 0.5
"""Fraction of the surface that may be left out for its convex parts without a warning."""


def simulate_grasps(
    mesh: MeshSource,
    model: GraspModel | None = None,
    *,
    simulation: SimulationSettings | None = None,
    sampling: Sampling | None = None,
    hand: ParallelGripper | None = None,
    options: MeshOptions | None = None,
    cluster: ClusterSettings | None = None,
    progress: Progress | None = None,
) -> Simulation:
    """Draw grasps of two fingers from a surface, label them, and simulate what becomes of them.

    Pairs of surface points that face each other are the true contacts. Perceived normals and points
    are drawn within the uncertainty of the model, the label follows from these, and the true
    friction is drawn from its interval. As many grasps of each label are chosen, of each evenly
    over the margin.

    In MuJoCo, two round tips close on the true contacts and press; then the object is pulled by its
    weight along each axis of the gripper. The object is that of its convex parts, from CoACD, and
    no point is used where these have another surface. Fingers, palm and table are not simulated.

    Args:
        mesh: The object: a path or an object, as in `load_mesh`, whose unit is known.
        model: Friction, sensor resolution and errors; None: the defaults, with the resolution that
            the gripper states, if any.
        simulation: Number of grasps, tips, forces, limits, and the seed; None: the defaults.
        sampling: Its limits of the opening; None: none.
        hand: Gives its limits of the opening, and the radius of its tips; None: ideal ones.
        options: How the mesh is read and prepared.
        cluster: Which processes simulate; None: one for each processor of this machine. The result
            does not depend on it.
        progress: Called with the fraction of the work done, from 0 to 1.

    Returns:
        The grasps, their labels and outcomes.

    Raises:
        MeshError: It is no mesh.
        SettingError: MuJoCo or CoACD is not installed, the unit of the mesh is not known, the
            gripper has flat pads, or the model has another number of fingers.
        GraspError: There is no grasp, or every simulation failed.

    Example:
        Six grasps of a box, held with 20 times its weight:

        >>> import trimesh
        >>> import grasp3d
        >>> from grasp3d.batch import ClusterSettings
        >>> from grasp3d.physics import SimulationSettings
        >>> box = grasp3d.load_mesh(trimesh.creation.box([0.04, 0.06, 0.1]), unit="m")
        >>> found = grasp3d.simulate_grasps(
        ...     box, simulation=SimulationSettings(count=6, pull_time=0.1),
        ...     cluster=ClusterSettings(workers=0),
        ... )
        >>> {label: f"{rate.successes} of {rate.count}" for label, rate in found.rates().items()}
        {'S': '2 of 2', 'M': '1 of 2', 'U': '0 of 2'}
    """
    mujoco_module()
    surface = load_mesh(mesh, options)
    source = surface.report.source
    if surface.unit is None:
        raise SettingError(
            f"a simulation is in metres, but the unit of {source} is not known: give the unit of "
            "its coordinates (--unit, in Python unit=...)"
        )
    scale = METRES[surface.unit]
    settings = simulation or SimulationSettings()
    chosen, given = surface.in_own_unit(_model(model, hand), sampling or Sampling())
    within = _within(given, surface, hand)
    radius = _tip_radius(settings, surface, hand)
    processes = cluster or ClusterSettings()
    begin_step("dividing the object into convex parts")
    parts = divided(surface, settings, processes)
    begin_step("drawing grasps")
    random = noise_stream(settings.seed, GRASPS)
    reached = true_points(surface, parts, radius, settings.part_angle, random)
    drawn = draw_grasps(surface, reached, chosen, within, settings.count, random)
    poses, openings = _poses(drawn, radius, random)
    begin_step("simulating grasps")
    stage = Stage(
        simulated_object(surface, parts, scale),
        Tips(radius * scale, chosen.friction, chosen.torsion_radius * scale),
        *settings_in_unit("m", settings),
    )
    attempts = _attempts(drawn, poses, openings, surface, settings, scale)
    outcomes, errors = simulate_attempts(attempts, stage, processes, progress or ignore)
    return Simulation(
        mesh=surface,
        model=chosen,
        settings=settings,
        grasps=drawn,
        poses=locked(poses),
        openings=locked(openings),
        outcomes=outcomes,
        parts=parts.count,
        part_depth=locked(np.abs(_at(parts.depths, drawn.points))),
        part_angle=locked(angles_between(_at(parts.outward, drawn.points), -drawn.normals)),
        warnings=(*_warnings(reached, drawn, settings), *errors),
    )


def _model(model: GraspModel | None, hand: ParallelGripper | None) -> GraspModel:
    """The model of two fingers, with the gripper's resolution where none is given."""
    given = model or (GraspModel() if hand is None else hand.touching(GraspModel()))
    if given.method != "exact":
        raise SettingError("simulated grasps need labels of the method exact")
    return with_fingers(given, 2)


def _within(sampling: Sampling, mesh: ObjectMesh, hand: ParallelGripper | None) -> Sampling:
    """Limits of the opening, within those of the gripper."""
    if sampling.grip != "squeeze":
        raise SettingError("simulated tips close from outside; grip must be squeeze")
    if hand is None:
        return sampling
    from grasp3d.hand.scene import Scene

    return Scene(hand).within_stroke(mesh, sampling)


def _tip_radius(
    settings: SimulationSettings, mesh: ObjectMesh, hand: ParallelGripper | None
) -> float:
    """Radius of the tips, in the mesh's unit."""
    if hand is None:
        radius = float(mesh.in_own_unit(settings)[0].tip_radius)
        if radius >= mesh.size:
            raise SettingError(
                f"tip_radius must be below the size of the object, {mesh.size:.4g} {mesh.unit}; "
                f"got {radius:.4g}"
            )
        return radius
    if not hand.round_tips:
        raise SettingError(
            f"gripper {hand.name!r} has flat pads, which touch more than two points; simulate "
            "round tips of its size without it (--tip-radius, --max-opening)"
        )
    return hand.tip_radius / metres_per_unit(mesh)


def _poses(drawn: DrawnGrasps, radius: float, random: np.random.Generator) -> tuple[Floats, Floats]:
    """Poses of the gripper with its tips at the true contacts, and their openings."""
    centres = drawn.points - radius * drawn.normals  # (k, 2, 3)
    line = centres[:, 1] - centres[:, 0]
    x = unit_rows(line)
    helper = random.standard_normal(x.shape)
    y = unit_rows(np.cross(helper, x))
    poses = np.tile(np.eye(4), (drawn.count, 1, 1))
    poses[:, :3, :3] = np.stack([x, y, np.cross(x, y)], axis=2)
    poses[:, :3, 3] = centres.mean(axis=1)
    return poses, np.linalg.norm(line, axis=1) - 2.0 * radius


def _attempts(
    drawn: DrawnGrasps,
    poses: Floats,
    openings: Floats,
    mesh: ObjectMesh,
    settings: SimulationSettings,
    scale: float,
) -> list[Attempt]:
    """The attempts, in metres."""
    metric = poses.copy()
    metric[:, :3, 3] *= scale
    centers = np.broadcast_to(mesh.center_mass, (drawn.count, 3))
    if settings.pulled == "line":
        centers = drawn.points.mean(axis=1)
    return [
        Attempt(
            metric[row],
            float(openings[row] * scale + 2.0 * GAP),
            centers[row] * scale,
            drawn.friction[row],
        )
        for row in range(drawn.count)
    ]


def simulated_object(mesh: ObjectMesh, parts: ConvexParts, scale: float) -> SimulatedObject:
    """The object in metres.

    Args:
        mesh: The object.
        parts: Its convex parts, in the mesh's unit.
        scale: Metres of that unit.
    """
    metric = replace(parts, vertices=tuple(scale * one for one in parts.vertices))
    extents = scale * np.ptp(mesh.vertices[mesh.faces].reshape(-1, 3), axis=0)
    return SimulatedObject(metric, scale * mesh.center_mass, extents)


def _at(function: Callable[[Floats], Floats], points: Floats) -> Floats:
    """Values of a function of points (k, 3) at points (k, 2, 3)."""
    values = function(points.reshape(-1, 3))
    return np.asarray(values.reshape(*points.shape[:2], *values.shape[1:]))


def _warnings(reached: TruePoints, drawn: DrawnGrasps, settings: SimulationSettings) -> list[str]:
    """What limits the result."""
    found = []
    for label in (Label.S, Label.M, Label.U):
        count, wanted = int((drawn.label == label).sum()), settings.count // 3
        if count < wanted:
            found.append(f"only {counted(count, 'grasps')} of label {label.name} found")
    left_out = reached.other_shape / reached.tried
    if left_out > MUCH_LEFT_OUT:
        found.append(
            f"{100.0 * left_out:.0f} % of the surface is left out, as the convex parts differ from "
            "it there; a smaller part_threshold makes finer parts"
        )
    return found
