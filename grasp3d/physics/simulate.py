"""Simulating grasps that are drawn from an object: do S hold, and U fail? And given poses."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from grasp3d.arrays import Floats, Ints, angles_between, locked, unit_rows
from grasp3d.batch.batch_settings import ClusterSettings
from grasp3d.batch.run import run
from grasp3d.errors import GraspError, MeshError, SettingError
from grasp3d.grasps.evaluated_poses import EvaluatedPoses
from grasp3d.grasps.evaluation import evaluate_grasps, in_stated_scale, poses_of_file
from grasp3d.grasps.poses import GraspPoses
from grasp3d.hand.hand import Hand, touching
from grasp3d.hand.hand_files import GivenHand, given_hand
from grasp3d.hand.jaws import Jaws
from grasp3d.hand.scene import Scene
from grasp3d.mesh import MeshSource, ObjectMesh, load_mesh
from grasp3d.physics.drawing import DrawnGrasps, TruePoints, draw_grasps, true_points
from grasp3d.physics.engine import mujoco_module
from grasp3d.physics.fingers import Fingers
from grasp3d.physics.parts import ConvexParts, convex_parts
from grasp3d.physics.pulling import Attempt, Fate, Outcome, simulate_attempt
from grasp3d.physics.scene import Stage, Tips, grasp_model
from grasp3d.physics.simulation import Simulation
from grasp3d.physics.simulation_settings import SimulationSettings
from grasp3d.quality.loads import GivenLoad, Load
from grasp3d.settings import (
    GivenModel,
    GivenSampling,
    GraspModel,
    MeshOptions,
    Sampling,
    with_fingers,
)
from grasp3d.settings.parsing import plain_values
from grasp3d.stability.label import Label
from grasp3d.surface.load_case import input_warnings, mass_of
from grasp3d.system.context import refuse_warnings, report_progress, unreported
from grasp3d.system.counts import counted

ATTEMPTS = 6
"""Attempts of one job: some seconds, so that progress is seen and little is lost by a crash."""

_NOT_SIMULATED = Outcome(Fate.BROKEN, 0, *(float("nan"),) * 6)


@dataclass(frozen=True, eq=False)
class Job:
    """Some attempts that are simulated one after the other, with one model."""

    number: int
    attempts: tuple[Attempt, ...]


@dataclass(frozen=True)
class JobResult:
    """The outcomes of a job, in the order of its attempts; the error is empty if it succeeded."""

    number: int
    outcomes: tuple[Outcome, ...]
    error: str = ""


def simulate_job(job: Job, stage: Stage) -> JobResult:
    """Simulate the attempts of a job."""
    model, data = grasp_model(stage)
    outcomes = (simulate_attempt(model, data, attempt, stage) for attempt in job.attempts)
    return JobResult(job.number, tuple(outcomes))


def simulate_attempts(
    attempts: Sequence[Attempt], stage: Stage, cluster: ClusterSettings
) -> tuple[tuple[Outcome, ...], tuple[str, ...]]:
    """Simulate attempts, some at a time in each process.

    Args:
        attempts: The grasps.
        stage: The object and the tips.
        cluster: Which processes simulate.

    Returns:
        The outcome of each attempt, in their order, and the errors of jobs that failed, whose
        attempts are `Fate.BROKEN`.

    Raises:
        GraspError: Every job failed, or the cluster is gone.
    """
    jobs = [
        Job(number, tuple(attempts[first : first + ATTEMPTS]))
        for number, first in enumerate(range(0, len(attempts), ATTEMPTS))
    ]
    results: dict[int, JobResult] = {}
    for result in run(simulate_job, jobs, stage, lost=_lost, cluster=cluster):
        results[result.number] = result
        report_progress(len(results) / len(jobs))
    errors = [one.error for one in results.values() if one.error]
    if len(errors) == len(jobs):
        raise GraspError(f"no grasp could be simulated: {errors[0]}")
    outcomes = tuple(one for job in jobs for one in results[job.number].outcomes)
    return outcomes, tuple(dict.fromkeys(errors))


def divided(
    mesh: ObjectMesh, settings: SimulationSettings, cluster: ClusterSettings
) -> ConvexParts:
    """Convex parts of a mesh, found in a watched process unless there shall be none.

    Args:
        mesh: The mesh.
        settings: Of the parts.
        cluster: Its limits.

    Raises:
        MeshError: The mesh is open.
        GraspError: CoACD crashed, took too long, or too much memory.
        SettingError: It is not installed, or finds no parts.
    """
    source = mesh.report.source
    if not mesh.report.closed:
        raise MeshError(
            f"{source}: is open, so it bounds no body that could be simulated; close it "
            "(--repair full)"
        )
    parts: ConvexParts | GraspError

    def lost(_: object, reason: str) -> GraspError:
        return GraspError(
            f"{source}: CoACD, which divides it into convex parts, {reason}; try a larger "
            "part_threshold, or repair the mesh (--repair full)"
        )

    (parts,) = run(_parts, [(mesh.vertices, mesh.faces)], settings, lost=lost, cluster=cluster)
    if isinstance(parts, GraspError):
        raise parts
    return parts


def _parts(surface: tuple[Floats, Ints], settings: SimulationSettings) -> ConvexParts | GraspError:
    """Convex parts of a surface, or why there are none."""
    threshold, seed = settings.part_threshold, settings.seed
    try:
        return convex_parts(*surface, threshold=threshold, seed=seed)
    except GraspError as error:
        return error


def _lost(job: Job, reason: str) -> JobResult:
    return JobResult(job.number, (_NOT_SIMULATED,) * len(job.attempts), f"the simulation {reason}")


STREAM = 0x6E6F697365
"""Part of every seed, so that numbers which a program drew with the same seed do not recur."""

GRASPS = 3
"""Number of the stream of random numbers of simulated grasps."""

GAP = 1e-4
"""Distance of each tip from the contact when it begins to close [m]."""

MUCH_LEFT_OUT = 0.5
"""Fraction of the surface that may be left out for its convex parts without a warning."""

COLUMNS = {
    "pulls_held": "pulls_held", "slip_m": "slip", "shift_m": "shift",
    "start_shift_m": "start_shift", "squeeze_shift_m": "squeeze_shift",
    "squeeze_turn": "squeeze_turn", "turn": "turn", "spin": "spin",
}  # fmt: skip
"""Columns of given poses, and the numbers of an outcome that they have; lengths are in metres."""

OFFSETS = 4
"""Number of the stream of random numbers of true poses."""

UNUSED = ("count", "tip_radius", "grip_ratio", "pulled", "part_angle")
"""Settings that do nothing at given poses."""


def simulate_grasps(
    mesh: MeshSource,
    model: GivenModel = None,
    *,
    simulation: SimulationSettings | Mapping[str, Any] | None = None,
    sampling: GivenSampling = None,
    hand: GivenHand = None,
    options: MeshOptions | None = None,
    cluster: ClusterSettings | None = None,
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
        >>> simulation = grasp3d.simulate_grasps(
        ...     box, simulation=SimulationSettings(count=6, pull_time=0.1),
        ...     cluster=ClusterSettings(workers=0),
        ... )
        >>> {name: f"{rate.successes} of {rate.count}" for name, rate in simulation.rates().items()}
        {'S': '2 of 2', 'M': '1 of 2', 'U': '0 of 2'}
    """
    mujoco_module()
    surface = load_mesh(mesh, options)
    surface.needs_metres("a simulation is in metres")
    settings = SimulationSettings.given("simulation", simulation) or SimulationSettings()
    hand, model = given_hand(hand), GraspModel.given("model", model)
    own_model = _model(model, hand)
    within = _within(Sampling.given("sampling", sampling) or Sampling(), surface, hand)
    radius = _tip_radius(settings, surface, hand)
    processes = cluster or ClusterSettings()
    parts = divided(surface, settings, processes)
    random = _random_stream(settings.seed, GRASPS)
    with unreported():
        reached = true_points(surface, parts, radius, settings.part_angle, random)
        grasps = draw_grasps(surface, reached, own_model, within, settings.count, random)
        poses, openings = _poses(grasps, radius, random)
    tips = Tips(radius, own_model.nominal_friction, own_model.torsion_radius)
    stage = Stage.of(surface, parts, tips, settings)
    centers = np.broadcast_to(surface.center_mass, (grasps.count, 3))
    if settings.pulled == "line":
        centers = grasps.points.mean(axis=1)
    starts = (openings + 2.0 * GAP).tolist()
    attempts = list(map(Attempt, poses, starts, centers, grasps.friction))
    outcomes, errors = simulate_attempts(attempts, stage, processes)
    warnings = (
        *input_warnings(surface, None if hand is None else Scene(hand), None, own_model),
        *_warnings(reached, grasps, settings),
        *errors,
    )
    refuse_warnings(warnings)
    return Simulation(
        mesh=surface,
        model=own_model,
        settings=settings,
        grasps=grasps,
        poses=locked(poses),
        openings=locked(openings),
        outcomes=outcomes,
        parts=parts.count,
        part_depth=locked(np.abs(_at(parts.depths, grasps.points))),
        part_angle=locked(angles_between(_at(parts.outward, grasps.points), -grasps.normals)),
        warnings=warnings,
    )


def _random_stream(seed: int, number: int) -> np.random.Generator:
    """Return a stream of random numbers, one for each use of the user's seed."""
    return np.random.default_rng((STREAM, seed, number))


def _model(model: GraspModel | None, hand: Hand | None) -> GraspModel:
    """The model of two fingers, with the gripper's resolution where none is given."""
    stated = model or (GraspModel() if hand is None else touching(hand, GraspModel()))
    if stated.method != "exact":
        raise SettingError("simulated grasps need labels of the method exact")
    return with_fingers(stated, 2)


def _within(sampling: Sampling, mesh: ObjectMesh, hand: Hand | None) -> Sampling:
    """Limits of the opening, within those of the gripper."""
    if sampling.grip != "squeeze":
        raise SettingError("simulated tips close from outside; grip must be squeeze")
    if hand is None:
        return sampling
    return Scene(hand).within_stroke(mesh, sampling)


def _tip_radius(settings: SimulationSettings, mesh: ObjectMesh, hand: Hand | None) -> float:
    """Radius of the tips [m]."""
    if hand is None:
        radius = float(settings.tip_radius)
        if radius >= mesh.size:
            raise SettingError(
                f"tip_radius must be below the size of the object, {mesh.size:.4g} m; "
                f"got {radius:.4g}"
            )
        return radius
    jaws = _needed_jaws(hand)
    if not jaws.round_tips:
        raise SettingError(
            f"gripper {hand.name!r} has flat pads, which touch more than two points; simulate "
            "round tips of its size without it (--tip-radius, --max-opening)"
        )
    return jaws.tip_radius


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


def _at(function: Callable[[Floats], Floats], points: Floats) -> Floats:
    """Values of a function of points (k, 3) at points (k, 2, 3)."""
    values = function(points.reshape(-1, 3))
    return np.asarray(values.reshape(*points.shape[:2], *values.shape[1:]))


def _warnings(reached: TruePoints, grasps: DrawnGrasps, settings: SimulationSettings) -> list[str]:
    """What limits the result."""
    warnings = []
    for label in (Label.S, Label.M, Label.U):
        count, third = int((grasps.label == label).sum()), settings.count // 3
        if count < third:
            warnings.append(f"only {counted(count, 'grasps')} of label {label.name} found")
    if reached.left_out > MUCH_LEFT_OUT:
        warnings.append(
            f"{100.0 * reached.left_out:.0f} % of the surface is left out, as the convex parts "
            "differ from it there; a smaller part_threshold makes finer parts"
        )
    return warnings


def simulate_poses(
    mesh: MeshSource,
    poses: GraspPoses | str | Path,
    model: GivenModel = None,
    *,
    hand: GivenHand,
    load: GivenLoad = None,
    simulation: SimulationSettings | Mapping[str, Any] | None = None,
    cluster: ClusterSettings | None = None,
) -> GraspPoses:
    """Close a gripper at given poses in MuJoCo, and pull at the object that it holds.

    The gripper is simulated as a whole: pads or round tips that give way, rigid fingers behind
    them, and the palm. Where it is in the object before it closes, by no more than `give_way` and
    the pose error, the object gives way. It lies with friction while the fingers close, and may
    move between them; then it floats, and is pulled at its centre of mass along each axis of the
    gripper. It is held where it stays within the limits of shift and turn of where it was after
    the squeeze.

    Args:
        mesh: The object, whose unit is known or stated by the poses.
        poses: The poses, or a file of them.
        model: Friction, torsion radius of round tips, and what labels depend on; None: as in
            `evaluate_grasps`. Torsion on pads follows from where they are touched.
        hand: The gripper.
        load: Gives the mass of the object, and the force of each finger, without one the greatest
            of the gripper, if that is stated; None: those of the settings.
        simulation: Forces, times, limits, pads, pose error and convex parts; None: the defaults.
            `count`, `tip_radius`, `pulled` and `part_angle` have no effect.
        cluster: Which processes simulate; None: one for each processor of this machine.

    Returns:
        The poses, each as often as there are trials, with the labels and numbers of
        `evaluate_grasps` at them, their simulated `outcome`, which files hold as `success`, and the
        columns `fate`, `pulls_held`, `slip_m`, `shift_m` [m], `turn` and `spin` [rad]; where it
        gave way `start_shift_m`, where it was squeezed `squeeze_shift_m` and `squeeze_turn`; with a
        pose error also `trial`, and the true pose in the frame of the given one, `error_x_m` ...
        [m] and as rotation vector `error_rx` ... [rad].

    Raises:
        MeshError: It is no mesh.
        SettingError: As in `evaluate_grasps`; or MuJoCo or CoACD is not installed.
        GraspError: Every simulation failed.

    Example:
        A box between the pads of a gripper, and a pose beside it:

        >>> import numpy as np
        >>> import trimesh
        >>> import grasp3d
        >>> from grasp3d.batch import ClusterSettings
        >>> from grasp3d.grasps import GraspPoses
        >>> from grasp3d.physics import SimulationSettings, simulate_poses
        >>> box = grasp3d.load_mesh(trimesh.creation.box([0.06, 0.04, 0.02]), unit="m")
        >>> from_above = np.diag([1.0, -1.0, -1.0, 1.0])
        >>> beside = from_above + [[0, 0, 0, 0], [0, 0, 0, 0.1], [0, 0, 0, 0], [0, 0, 0, 0]]
        >>> tried = simulate_poses(
        ...     box, GraspPoses(poses=[from_above, beside]),
        ...     hand=grasp3d.ParallelGripper.preset("franka"),
        ...     simulation=SimulationSettings(pull_time=0.1), cluster=ClusterSettings(workers=0),
        ... )
        >>> tried.outcome.tolist(), tried.columns["fate"].tolist()
        ([1.0, 0.0], ['held', 'missed'])
    """
    mujoco_module()
    hand, load = _needed(given_hand(hand)), Load.given("load", load)
    surface, processes = load_mesh(mesh), cluster or ClusterSettings()
    if isinstance(poses, str | Path):
        poses = poses_of_file(Path(poses), surface, hand=hand)
    surface = in_stated_scale(surface, poses)
    surface.needs_metres("a simulation is in metres")
    settings = SimulationSettings.given("simulation", simulation) or SimulationSettings()
    settings = _loaded(replace(settings, pulled="center_of_mass"), surface, hand, load)
    with unreported():
        evaluated = evaluate_grasps(surface, poses, model, hand=hand, load=load)
    parts = divided(evaluated.mesh, settings, processes)
    stage = Stage.of(evaluated.mesh, parts, _tips(hand, evaluated.model, settings), settings)
    given = np.repeat(np.arange(evaluated.size), settings.trials)
    errors = settings.pose_error.draw(len(given), _random_stream(settings.seed, OFFSETS))
    attempts = _posed_attempts(evaluated, given, errors, stage.tips)
    outcomes, _ = simulate_attempts(attempts, stage, processes)
    table = {
        "fate": np.array([str(one.fate) for one in outcomes]),
        **{
            column: np.array([getattr(one, name) for one in outcomes])
            for column, name in COLUMNS.items()
        },
        **_error_columns(errors, settings),
    }
    results = evaluated.to_poses().take(given)
    entries = {
        f"simulation_{name}": value
        for name, value in plain_values(settings).items()
        if name not in UNUSED
    }
    return replace(
        results,
        outcome=np.array(
            [np.nan if one.fate is Fate.BROKEN else float(one.held) for one in outcomes]
        ),
        columns={**results.columns, **table},
        settings={**results.settings, **entries},
    )


def _needed(hand: Hand | None) -> Hand:
    """A hand that must be given. Raises SettingError."""
    if hand is None:
        raise SettingError("poses are simulated with their gripper; give it (hand='franka')")
    return hand


def _loaded(
    settings: SimulationSettings, mesh: ObjectMesh, hand: Hand, load: Load | None
) -> SimulationSettings:
    """The settings with the mass and the forces of a load."""
    if load is None:
        return settings
    mass = mass_of(mesh, load)
    force = load.grip_force if load.grip_force is not None else hand.max_force
    return replace(
        settings,
        object_mass=settings.object_mass if mass is None else mass,
        grip_force=settings.grip_force if force is None else force,
    )


def _error_columns(errors: Floats, settings: SimulationSettings) -> dict[str, Floats | Ints]:
    """True poses (k, 4, 4) [m] in the frames of the given ones, as columns."""
    if not settings.pose_error:
        return {}
    turns = Rotation.from_matrix(errors[:, :3, :3]).as_rotvec()
    columns: dict[str, Floats | Ints] = {"trial": 1 + np.arange(len(errors)) % settings.trials}
    for number, axis in enumerate("xyz"):
        columns[f"error_{axis}_m"] = errors[:, number, 3]
        columns[f"error_r{axis}"] = turns[:, number]
    return columns


def _needed_jaws(hand: Hand) -> Jaws:
    """A hand as a parallel gripper, of which there are two tips. Raises SettingError."""
    if not isinstance(hand, Jaws):
        raise SettingError(f"{hand.name!r} is no parallel gripper; only those are simulated")
    return hand


def _tips(hand: Hand, model: GraspModel, settings: SimulationSettings) -> Tips:
    """The gripper's fingers, in metres."""
    jaws = _needed_jaws(hand)
    return Tips(
        friction=model.nominal_friction,
        torsion_radius=model.torsion_radius if jaws.round_tips else 0.0,
        fingers=Fingers.of(jaws, settings.pad_stiffness),
    )


def _posed_attempts(
    grasps: EvaluatedPoses, given: Ints, errors: Floats, tips: Tips
) -> list[Attempt]:
    """The attempts, from the opening with which the gripper comes.

    Args:
        grasps: The given poses.
        given: Index of the pose of each attempt, shape (k,).
        errors: True poses in the frames of the given ones [m], shape (k, 4, 4).
        tips: The gripper.
    """
    poses = grasps.poses[given]
    stroke = grasps.hand.max_opening
    openings = np.nan_to_num(grasps.given.pregrasp_opening[given], nan=stroke)
    center, friction = grasps.mesh.center_mass, np.full(2, tips.friction)
    attempt = partial(Attempt, center=center, friction=friction, may_move=True)
    return list(map(attempt, poses @ errors, np.minimum(openings, stroke).tolist()))
