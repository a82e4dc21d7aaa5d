"""Simulations in watched processes: MuJoCo and CoACD may crash, which must not end the program."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

from grasp3d.batch.batch_settings import ClusterSettings
from grasp3d.batch.run import run
from grasp3d.errors import GraspError, MeshError
from grasp3d.mesh import ObjectMesh
from grasp3d.physics.parts import ConvexParts, convex_parts
from grasp3d.physics.pulling import Attempt, Fate, Outcome, simulate_attempt
from grasp3d.physics.scene import SimulatedObject, Tips, grasp_model
from grasp3d.physics.simulation_settings import SimulationSettings
from grasp3d.system.isolation import CallFailedError, call
from grasp3d.system.progress import Progress

ATTEMPTS = 6
"""Attempts of one job: some seconds, so that progress is seen and little is lost by a crash."""

_NOT_SIMULATED = Outcome(Fate.BROKEN, 0, *(float("nan"),) * 6)


@dataclass(frozen=True, eq=False)
class Stage:
    """What all attempts of an object have in common; lengths in metres."""

    thing: SimulatedObject
    tips: Tips
    settings: SimulationSettings


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
    model, data = grasp_model(stage.thing, stage.tips, stage.settings)
    outcomes = [
        simulate_attempt(model, data, attempt, stage.tips, stage.settings)
        for attempt in job.attempts
    ]
    return JobResult(job.number, tuple(outcomes))


def simulate_attempts(
    attempts: Sequence[Attempt], stage: Stage, cluster: ClusterSettings, progress: Progress
) -> tuple[tuple[Outcome, ...], tuple[str, ...]]:
    """Simulate attempts, some at a time in each process.

    Args:
        attempts: The grasps.
        stage: The object and the tips.
        cluster: Which processes simulate.
        progress: Called with the fraction of the work done, from 0 to 1.

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
        progress(len(results) / len(jobs))
    errors = tuple(dict.fromkeys(one.error for one in results.values() if one.error))
    if len([one for one in results.values() if one.error]) == len(jobs):
        raise GraspError(f"no grasp could be simulated: {errors[0]}")
    return tuple(one for job in jobs for one in results[job.number].outcomes), errors


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
    work = partial(
        convex_parts,
        mesh.vertices,
        mesh.faces,
        threshold=settings.part_threshold,
        seed=settings.seed,
    )
    if cluster.workers == 0:
        return work()
    try:
        return call(work, memory=cluster.worker_memory, seconds=cluster.timeout)
    except CallFailedError as failure:
        raise GraspError(
            f"{source}: CoACD, which divides it into convex parts, {failure.reason}; try a larger "
            "part_threshold, or repair the mesh (--repair full)"
        ) from failure


def _lost(job: Job, reason: str) -> JobResult:
    return JobResult(job.number, (_NOT_SIMULATED,) * len(job.attempts), f"the simulation {reason}")
