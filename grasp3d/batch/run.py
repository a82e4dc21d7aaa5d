"""Running jobs, each in a watched process of its own; one that ends its process harms no other."""

from collections.abc import Callable, Iterable, Iterator
from itertools import chain, islice
from typing import TypeVar

from grasp3d.batch.batch_settings import ClusterSettings
from grasp3d.isolation import NeedsMemory, unexpected

JobT = TypeVar("JobT")
SettingsT = TypeVar("SettingsT")
RowT = TypeVar("RowT")


def _tell_nobody(job: object) -> None:
    """Leave a job that was started unannounced."""


def run(
    task: Callable[[JobT, SettingsT], RowT],
    jobs: Iterable[JobT],
    settings: SettingsT,
    *,
    lost: Callable[[JobT, str], RowT],
    cluster: ClusterSettings,
    started: Callable[[JobT], None] = _tell_nobody,
) -> Iterator[RowT]:
    """Do a task for every job and yield each row when it is done.

    A job that crashes is tried once more. One that takes too much memory, or is killed from
    outside, is tried once more after all others, alone, with all the memory there is.

    Args:
        task: What is done for one job; failures that it foresees are rows. It may raise
            `NeedsMemory` to be put off until it can have more.
        jobs: Taken one by one, in their order, a few ahead of the work.
        settings: The same for all of them.
        lost: Makes the row of a job that did not come back with one, from the reason.
        cluster: Who does the work, and what a job may take.
        started: Told of each job that is taken.

    Raises:
        SettingError: There is no cluster where one is said to run.
        GraspError: Its scheduler is gone, or its workers cannot do this work.
    """
    if cluster.workers == 0:
        for job in jobs:
            started(job)
            yield _done_here(task, job, settings, lost)
        return
    jobs = iter(jobs)
    first = list(islice(jobs, 1))
    if not first:
        return
    from grasp3d.batch.attempts import Attempts
    from grasp3d.batch.cluster import crew

    with crew(cluster) as workers:
        attempts = Attempts(workers, task, settings, lost, cluster)
        yield from attempts.rows(chain(first, jobs), started)


def _done_here(
    task: Callable[[JobT, SettingsT], RowT],
    job: JobT,
    settings: SettingsT,
    lost: Callable[[JobT, str], RowT],
) -> RowT:
    """Do one job in this process; what ends the process ends all."""
    try:
        return task(job, settings)
    except NeedsMemory as more:
        return lost(job, str(more))
    except Exception as error:  # noqa: BLE001, a bug met by one mesh must not end the others
        return lost(job, unexpected(error))
