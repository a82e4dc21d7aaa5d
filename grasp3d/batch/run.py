"""Running jobs, each in a watched child process, so that a failing job affects no other."""

from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack
from itertools import chain, islice
from typing import TYPE_CHECKING, TypeVar

from grasp3d.batch.batch_settings import ClusterSettings
from grasp3d.batch.local_client import open_local_client
from grasp3d.batch.warmup import compile_first, compile_kernels
from grasp3d.system.isolation import NeedsMemory, describe_unexpected

if TYPE_CHECKING:
    from grasp3d.batch.job_requests import JobClient

JobT = TypeVar("JobT")
SettingsT = TypeVar("SettingsT")
RowT = TypeVar("RowT")


def _ignore_start(job: object) -> None:
    """Do nothing when a job is started."""


def run(
    task: Callable[[JobT, SettingsT], RowT],
    jobs: Iterable[JobT],
    settings: SettingsT,
    *,
    lost: Callable[[JobT, str], RowT],
    cluster: ClusterSettings,
    started: Callable[[JobT], None] = _ignore_start,
    kernels: int | None = None,
    gripper: bool = False,
    forces: bool = False,
) -> Iterator[RowT]:
    """Run a task for every job and yield each row when it is finished.

    A job that crashes is tried once more. A job that exceeds its memory limit, or is killed by
    another process, is tried once more after all others, alone, with all available memory.

    Args:
        task: Called with a job and the settings; it returns expected failures as rows. It may raise
            `NeedsMemory` to be postponed until more memory is available.
        jobs: Taken singly, in their order, a few ahead of the running jobs.
        settings: The same for all jobs.
        lost: Makes the row of a job that failed without a row, from the reason.
        cluster: Which processes run the jobs, and the limits of a job.
        started: Called with each job that is taken.
        kernels: Number of fingers for which kernels are compiled before the jobs, outside their
            limits and times; 0: only meshes are prepared; None: no job needs kernels.
        gripper: Whether those for grippers are compiled too.
        forces: Whether those for grip forces are compiled too.

    Raises:
        SettingError: No cluster runs at the given address.
        GraspError: The cluster's scheduler is gone, or its workers cannot run the jobs.
    """
    jobs = iter(jobs)
    first = list(islice(jobs, 1))
    if not first:
        return
    if cluster.workers == 0:
        if kernels is not None:
            compile_kernels(kernels, gripper, forces)
        for job in chain(first, jobs):
            started(job)
            yield _run_here(task, job, settings, lost)
        return
    from grasp3d.batch.attempts import Attempts

    with ExitStack() as stack:
        client: JobClient
        if cluster.scheduler is None:
            client = local = stack.enter_context(open_local_client(cluster))
            first += islice(jobs, local.processes - 1)
            if kernels is not None:
                compile_first(kernels, gripper, forces, children=len(first))
                kernels = None
        else:
            # Imported here: jobs on this machine need no Dask.
            from grasp3d.batch.cluster import open_cluster

            client = stack.enter_context(open_cluster(cluster.scheduler))
        attempts = Attempts(
            client, task, settings, lost, cluster, kernels, gripper=gripper, forces=forces
        )
        yield from attempts.rows(chain(first, jobs), started)


def _run_here(
    task: Callable[[JobT, SettingsT], RowT],
    job: JobT,
    settings: SettingsT,
    lost: Callable[[JobT, str], RowT],
) -> RowT:
    """Run one job in this process; a crash of the job ends the process."""
    try:
        return task(job, settings)
    except NeedsMemory as more:
        return lost(job, str(more))
    except Exception as error:  # noqa: BLE001, a bug met by one mesh must not end the others
        return lost(job, describe_unexpected(error))
