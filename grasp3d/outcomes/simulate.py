"""Simulating grasps of a gripper, given ones or the best ones: does the object stay in it?"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from grasp3d.errors import GraspError, SettingError
from grasp3d.formats.poses import GraspPoses
from grasp3d.grasps.best import best_grasps
from grasp3d.grasps.evaluation import evaluate_grasps, in_stated_scale, poses_of_file
from grasp3d.grasps.jaw_grasps import JawGrasps
from grasp3d.hand.hand import Hand
from grasp3d.hand.hand_files import GivenHand, given_hand
from grasp3d.hand.jaws import Jaws
from grasp3d.jobs.cluster_settings import ClusterSettings
from grasp3d.jobs.running import run
from grasp3d.mesh import MeshSource, ObjectMesh, load_mesh
from grasp3d.outcomes.fingers import Fingers
from grasp3d.outcomes.parts import coacd_module, parts_of
from grasp3d.outcomes.pulling import Attempt, Fate, Outcome, simulate_attempt
from grasp3d.outcomes.scene import Stage, grasp_model
from grasp3d.outcomes.simulation_settings import SimulationSettings
from grasp3d.settings import GivenModel
from grasp3d.settings.parsing import plain_values
from grasp3d.surface.labelling import label_surface
from grasp3d.system.context import report_progress, unreported

ATTEMPTS = 6
"""Attempts of one job: some seconds, so that progress is seen and little is lost by a crash."""

FORCE = 40.0
"""Force of each finger of a gripper that states none [N]."""

STREAM = 0x6E6F697365
"""Part of every seed, so that numbers which a program drew with the same seed do not recur."""

TRIALS = 4
"""Number of the stream of random numbers of trials."""

NUMBERS = tuple(one.name for one in fields(Outcome) if one.name != "fate")
"""What is known of an outcome beside the fate, as columns."""


@dataclass(frozen=True, eq=False)
class Job:
    """Some attempts that are simulated one after the other, with one model."""

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

    The gripper is simulated as a whole: pads or round tips that give way, rigid fingers behind
    them, and the palm. Where it is in the object before it closes, by no more than `give_way` and
    the pose error, the object gives way. It lies with friction while the fingers close, and may
    move between them; then it floats, and is pulled at its centre of mass along each axis of the
    gripper. It is held where it stays within the limits of shift and turn of where it was after
    the squeeze.

    Args:
        mesh: The object, whose unit is known or stated by the poses.
        grasps: The poses, or a file of them; None: the best `count` grasps of the gripper.
        model: Friction, whose true value is drawn from its interval for each trial, torsion radius
            of round tips, and what labels depend on; None: as in `evaluate_grasps`. Torsion on pads
            follows from where they are touched.
        hand: The gripper.
        simulation: Forces, times, limits, pads, pose error and convex parts; None: the defaults.
        cluster: Which processes simulate; None: one for each processor of this machine. The result
            does not depend on it.

    Returns:
        The poses, each as often as there are trials, with the labels and numbers of
        `evaluate_grasps` at them, their simulated `outcome` (1: held, 0: not, nan: unknown), which
        files hold as `success`, and the columns `fate` (one of `Fate`), `trial`, `true_friction`,
        `pulls_held`, `slip_m`, `pull_shift_m` [m] and `pull_turn` [rad]; where it gave way
        `start_shift_m`, where it was squeezed `squeeze_shift_m` and `squeeze_turn`; with a pose
        error also the true pose in the frame of the given one, `error_x_m` ... [m] and as rotation
        vector `error_rx` ... [rad].

    Raises:
        MeshError: It is no mesh, or an open one.
        SettingError: As in `evaluate_grasps`; or MuJoCo or CoACD is not installed, or the hand is
            no parallel gripper.
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
    """A hand as a parallel gripper. Raises SettingError."""
    if not isinstance(hand, Jaws):
        name = "none is given" if hand is None else f"{hand.name!r} is none"
        raise SettingError(f"only parallel grippers are simulated; {name} (--hand NAME|FILE)")
    return hand


def _evaluated(
    mesh: ObjectMesh, grasps: GraspPoses | None, model: GivenModel, hand: Hand | None, count: int
) -> JawGrasps:
    """Given poses, or the best ones of a gripper, with their labels."""
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
    """Simulate attempts, some at a time in each process.

    Args:
        attempts: The grasps.
        stage: The object and the gripper.
        cluster: Which processes simulate.

    Returns:
        The outcome of each attempt, in their order; those of jobs that failed are `Fate.BROKEN`.

    Raises:
        GraspError: Every job failed, or the cluster is gone.
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
