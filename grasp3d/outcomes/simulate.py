"""Simulation of given grasps, or of the best ones: does the object stay in the gripper?

MuJoCo collides meshes as their convex hulls, so the object is divided into convex parts.
"""

import hashlib
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial import ConvexHull, QhullError
from scipy.spatial.transform import Rotation

from grasp3d.arrays import Floats, Ints, locked
from grasp3d.errors import GraspError, MeshError, OutputError, SettingError
from grasp3d.formats.poses import GraspPoses
from grasp3d.grasps.best import best_grasps
from grasp3d.grasps.evaluation import evaluate_grasps, in_stated_scale, poses_of_file
from grasp3d.grasps.jaw_grasps import JawGrasps
from grasp3d.hand.hand import Hand
from grasp3d.hand.hand_files import GivenHand, given_hand
from grasp3d.hand.jaws import Jaws
from grasp3d.jobs.child import LostError
from grasp3d.jobs.cluster_settings import ClusterSettings
from grasp3d.jobs.running import run
from grasp3d.mesh import MeshSource, ObjectMesh, load_mesh
from grasp3d.outcomes.pulling import Attempt, Fate, Outcome, simulate_attempt
from grasp3d.outcomes.scene import Fingers, Stage, grasp_model
from grasp3d.outcomes.simulation_settings import SimulationSettings
from grasp3d.settings import GivenModel
from grasp3d.settings.parsing import plain_values
from grasp3d.surface.labelling import label_surface
from grasp3d.system.context import report_progress, unreported
from grasp3d.system.files import atomic_write

SEARCH = {"mcts_iterations": 60, "mcts_nodes": 10, "preprocess_mode": "off"}
"""Settings of CoACD: it searches for cuts half as long as by default, for about as few parts. It
does not remesh the surface, which would move it outward by a hundredth of the object's size; a
closed surface needs no remeshing."""

CACHE = "GRASP3D_CACHE"
"""Environment variable with the folder in which parts are kept; empty: they are not kept."""


Parts = tuple[Floats, ...]
"""Corners of convex bodies whose union is nearly the object [m], shape (n, 3) each."""


def parts_of(mesh: ObjectMesh, settings: SimulationSettings, cluster: ClusterSettings) -> Parts:
    """Find the convex parts of a mesh, in a watched process unless the cluster has no workers.

    Args:
        mesh: The mesh.
        settings: Settings of the parts.
        cluster: Limits of the process.

    Raises:
        MeshError: The mesh is open.
        GraspError: CoACD crashed, or took too much time or memory.
        SettingError: CoACD is not installed, or finds no parts.
    """
    source = mesh.report.source
    if not mesh.report.closed:
        raise MeshError(
            f"{source}: is open, so it bounds no body that could be simulated; close it "
            "(--repair full)"
        )
    task = partial(_parts, settings=settings)
    (done,) = run(task, [(mesh.vertices, mesh.faces)], cluster=cluster)
    if isinstance(done.error, LostError):
        raise GraspError(
            f"{source}: CoACD, which divides it into convex parts, {done.error}; try a larger "
            "part_threshold, or repair the mesh (--repair full)"
        )
    return done.result


def _parts(surface: tuple[Floats, Ints], settings: SimulationSettings) -> Parts:
    return convex_parts(*surface, threshold=settings.part_threshold, seed=settings.seed)


def convex_parts(vertices: Floats, faces: Ints, *, threshold: float = 0.02, seed: int = 0) -> Parts:
    """Divide a closed surface into convex parts with CoACD (Wei et al., SIGGRAPH 2022).

    Args:
        vertices: Positions, shape (V, 3).
        faces: Corners of each face, shape (F, 3).
        threshold: CoACD's concavity, with the object scaled to a longest side of 2, below which a
            part is not divided further, at most 1.
        seed: Seed of the search for cuts; the same seed gives the same parts.

    Returns:
        Corners of each part, shape (n, 3). A file keeps the parts of a surface and settings.

    Raises:
        SettingError: CoACD is not installed, or finds no parts.

    Example:
        >>> import trimesh
        >>> from grasp3d.outcomes import convex_parts
        >>> box = trimesh.creation.box([0.04, 0.06, 0.1])
        >>> len(convex_parts(box.vertices, box.faces))
        1
    """
    key = hashlib.sha256(repr((SEARCH, threshold, seed)).encode())
    for array in (vertices, faces):
        key.update(np.ascontiguousarray(array).tobytes())
    path = _cached_file(key.hexdigest())
    cached = None if path is None else _read(path)
    if cached is not None:
        return cached
    parts = _decomposed(vertices, faces, threshold, seed)
    if path is not None:
        _write(path, parts)
    return parts


def coacd_module() -> Any:
    """Import CoACD, of the extra `physics`. Raises SettingError if it is not installed."""
    try:
        import coacd
    except ImportError as error:
        text = "a simulation needs coacd; install it with: pip install 'grasp3d[physics]'"
        raise SettingError(text) from error
    return coacd


def _decomposed(vertices: Floats, faces: Ints, threshold: float, seed: int) -> Parts:
    coacd = coacd_module()
    coacd.set_log_level("error")
    parts: Any = coacd.run_coacd(
        coacd.Mesh(vertices, faces), threshold=threshold, seed=seed, **SEARCH
    )
    solid = [one for one in (np.asarray(points, float) for points, _ in parts) if _is_solid(one)]
    if not solid:
        raise SettingError("the mesh has no convex parts: it must enclose a volume")
    return tuple(map(locked, solid))


def _is_solid(vertices: Floats) -> bool:
    """Whether points span a volume."""
    if len(vertices) < 4:
        return False
    try:
        ConvexHull(vertices)
    except QhullError:
        return False
    return True


def _cached_file(key: str) -> Path | None:
    """File in which the parts of a key are kept; None if they are not kept."""
    folder = os.environ.get(CACHE)
    if folder == "":
        return None
    try:
        home = Path.home()
    except RuntimeError:  # no home folder
        return None
    cache = os.environ.get("XDG_CACHE_HOME") or str(home / ".cache")
    return Path(folder or Path(cache) / "grasp3d") / "parts" / f"{key[:32]}.npz"


def _read(path: Path) -> Parts | None:
    """Read parts from a file; None if it is missing or damaged."""
    try:
        with np.load(path) as file:
            vertices, first = file["vertices"], file["first"]
    except (OSError, ValueError, KeyError, EOFError):
        return None
    return tuple(map(locked, np.split(vertices, first)))


def _write(path: Path, parts: Parts) -> None:
    """Write parts to a file, if possible."""
    counts = np.cumsum([len(one) for one in parts])
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with atomic_write(path) as temporary:
            np.savez(temporary, vertices=np.concatenate(parts), first=counts[:-1])
    except (OSError, OutputError):
        return


ATTEMPTS = 6
"""Attempts of one job: it takes seconds, so progress shows and a crash loses little."""

FORCE = 40.0
"""Force of each finger of a gripper that states no force [N]."""

STREAM = 0x6E6F697365
"""Part of every seed; it keeps results apart from numbers drawn elsewhere with the same seed."""

TRIALS = 4
"""Number of the random stream for trials."""

NUMBERS = tuple(one.name for one in fields(Outcome) if one.name != "fate")
"""Numbers of an outcome, besides the fate, that become columns."""


@dataclass(frozen=True, eq=False)
class Job:
    """Attempts that are simulated one after the other, with one model."""

    number: int
    attempts: tuple[Attempt, ...]


def simulate_grasps(
    mesh: MeshSource,
    grasps: GraspPoses | str | Path | None = None,
    model: GivenModel = None,
    *,
    hand: GivenHand,
    simulation: SimulationSettings | Mapping[str, Any] | None = None,
    cluster: ClusterSettings | None = None,
) -> GraspPoses:
    """Close a gripper at poses in MuJoCo, and pull at the object that it holds.

    The whole gripper is simulated: pads or round tips that give way, rigid fingers behind them, and
    the palm. If the gripper overlaps the object before it closes, by no more than `give_way` and
    the pose error, the object is pushed aside. While the fingers close, the object lies with
    friction and may move between them. Then it floats, and is pulled at its centre of mass along
    each axis of the gripper. It counts as held if it stays within the limits of shift and turn from
    its pose after the squeeze.

    Args:
        mesh: The object, whose unit is known or stated by the poses.
        grasps: The poses, or a file of them; None: the best `count` grasps of the gripper.
        model: Friction, torsion radius of round tips, and what labels depend on; None: as in
            `evaluate_grasps`. Each trial draws its friction from the interval. Torsion on pads
            follows from where they are touched.
        hand: The gripper.
        simulation: Forces, times, limits, pads, pose error and convex parts; None: the defaults.
        cluster: The processes that simulate; None: one for each processor of this machine. The
            result does not depend on them.

    Returns:
        The poses, each as often as there are trials, with the labels and numbers of
        `evaluate_grasps`. The simulated `outcome` (1: held, 0: not, nan: unknown) is `success` in
        files. The columns are `fate` (one of `Fate`), `trial`, `true_friction`, `pulls_held`,
        `slip_m`, `pull_shift_m` [m], `pull_turn` [rad], `start_shift_m`, if the object gave way,
        and `squeeze_shift_m` and `squeeze_turn` if it was squeezed; with a pose error also the true
        pose in the frame of the given one, `error_x_m` ... [m] and as rotation vector `error_rx`
        ... [rad].

    Raises:
        MeshError: The input is not a mesh, or is open.
        SettingError: As in `evaluate_grasps`; or MuJoCo or CoACD is not installed, or the hand is
            not a parallel gripper.
        GraspError: The gripper has no grasp on the object, or every simulation failed.

    Example:
        A box between the pads of a gripper, and a pose beside it:

        >>> import numpy as np
        >>> import trimesh
        >>> import grasp3d
        >>> from grasp3d.jobs import ClusterSettings
        >>> from grasp3d.formats import GraspPoses
        >>> box = grasp3d.load_mesh(trimesh.creation.box([0.06, 0.04, 0.02]), unit="m")
        >>> from_above = np.diag([1.0, -1.0, -1.0, 1.0])
        >>> beside = from_above + [[0, 0, 0, 0], [0, 0, 0, 0.1], [0, 0, 0, 0], [0, 0, 0, 0]]
        >>> tried = grasp3d.simulate_grasps(
        ...     box, GraspPoses(poses=[from_above, beside]), hand="franka",
        ...     simulation={"pull_time": 0.1}, cluster=ClusterSettings(workers=0),
        ... )
        >>> tried.outcome.tolist(), tried.columns["fate"].tolist()
        ([1.0, 0.0], ['held', 'missed'])
    """
    coacd_module()
    hand = given_hand(hand)
    jaws = _needed_jaws(hand)
    settings = SimulationSettings.given("simulation", simulation) or SimulationSettings()
    surface, processes = load_mesh(mesh), cluster or ClusterSettings()
    if isinstance(grasps, str | Path):
        grasps = poses_of_file(Path(grasps), surface, hand=hand)
    if grasps is not None:
        surface = in_stated_scale(surface, grasps)
    surface.needs_metres("a simulation is in metres")
    with unreported():
        found = _evaluated(surface, grasps, model, hand, settings.count)
    force = settings.grip_force or jaws.max_force or FORCE
    settings = replace(settings, grip_force=force)
    torsion_radius = found.model.torsion_radius if jaws.round_tips else 0.0
    fingers = Fingers.of(jaws, settings.pad_stiffness, torsion_radius)
    parts = parts_of(found.mesh, settings, processes)
    stage = Stage.of(found.mesh, parts, fingers, settings, force)
    given = np.repeat(np.arange(found.size), settings.trials)
    random = np.random.default_rng((STREAM, settings.seed, TRIALS))
    errors = settings.pose_error.draw(len(given), random)
    friction = random.uniform(*found.model.friction_interval, len(given))
    stroke = jaws.max_opening
    openings = np.minimum(np.nan_to_num(found.given.pregrasp_opening, nan=stroke), stroke)
    attempts = [
        Attempt(*one)
        for one in zip(
            found.poses[given] @ errors, openings[given].tolist(), friction.tolist(), strict=True
        )
    ]
    outcomes = simulate_attempts(attempts, stage, processes)
    columns = {
        "trial": 1 + np.arange(len(given)) % settings.trials,
        "true_friction": friction,
        "fate": np.array([str(one.fate) for one in outcomes]),
        **{name: np.array([getattr(one, name) for one in outcomes]) for name in NUMBERS},
    }
    if settings.pose_error:
        turns = Rotation.from_matrix(errors[:, :3, :3]).as_rotvec()
        for number, axis in enumerate("xyz"):
            columns |= {f"error_{axis}_m": errors[:, number, 3], f"error_r{axis}": turns[:, number]}
    results = found.to_poses().take(given)
    entries = {f"simulation_{name}": value for name, value in plain_values(settings).items()}
    held = {Fate.HELD: 1.0, Fate.BROKEN: np.nan}
    return replace(
        results,
        outcome=np.array([held.get(one.fate, 0.0) for one in outcomes]),
        columns={**results.columns, **columns},
        settings={**results.settings, **entries},
    )


def _needed_jaws(hand: Hand | None) -> Jaws:
    """Return the hand if it is a parallel gripper. Raises SettingError."""
    if not isinstance(hand, Jaws):
        name = "none is given" if hand is None else f"{hand.name!r} is none"
        raise SettingError(f"only parallel grippers are simulated; {name} (--hand NAME|FILE)")
    return hand


def _evaluated(
    mesh: ObjectMesh, grasps: GraspPoses | None, model: GivenModel, hand: Hand | None, count: int
) -> JawGrasps:
    """Evaluate given poses, or find the best ones of a gripper."""
    found: object = (
        best_grasps(label_surface(mesh, model, hand=hand), count)
        if grasps is None
        else evaluate_grasps(mesh, grasps, model, hand=hand)
    )
    if not isinstance(found, JawGrasps) or not found.size:
        raise GraspError(
            f"{mesh.report.source}: the gripper has no grasp on it that may hold; give poses "
            "(--grasps)"
        )
    return found


def simulate_attempts(
    attempts: Sequence[Attempt], stage: Stage, cluster: ClusterSettings
) -> tuple[Outcome, ...]:
    """Simulate attempts in jobs of a few, in parallel processes.

    Args:
        attempts: The grasps.
        stage: The object and the gripper.
        cluster: The processes that simulate.

    Returns:
        The outcome of each attempt, in order; `Fate.BROKEN` for all attempts of a failed job.

    Raises:
        GraspError: Every job failed, or the cluster is unavailable.
    """
    jobs = [
        Job(number, tuple(attempts[first : first + ATTEMPTS]))
        for number, first in enumerate(range(0, len(attempts), ATTEMPTS))
    ]
    outcomes, errors = dict[int, tuple[Outcome, ...]](), []
    for done in run(partial(simulate_job, stage=stage), jobs, cluster=cluster):
        number, broken = done.job.number, (Outcome(Fate.BROKEN),) * len(done.job.attempts)
        outcomes[number] = broken if done.value is None else done.value
        errors += [] if done.error is None else [done.error]
        report_progress(len(outcomes) / len(jobs))
    if errors and len(errors) == len(jobs):
        raise GraspError(f"no grasp could be simulated: the simulation {errors[0]}")
    return tuple(one for job in jobs for one in outcomes[job.number])


def simulate_job(job: Job, stage: Stage) -> tuple[Outcome, ...]:
    """Simulate the attempts of a job, in their order."""
    model, data = grasp_model(stage)
    return tuple(simulate_attempt(model, data, attempt, stage) for attempt in job.attempts)
