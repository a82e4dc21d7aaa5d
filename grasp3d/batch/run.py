"""Running jobs, each in a watched child process, so that a failing job affects no other."""

import pickle
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass, replace
from functools import partial
from itertools import chain, islice
from typing import Generic, TypeVar

from grasp3d._kernels.ahead import warmup
from grasp3d.batch.batch_settings import ClusterSettings
from grasp3d.batch.job_requests import JobClient, Request, Result, ResultKind, open_local, versions
from grasp3d.batch.limits import CallFailure, NeedsMemory
from grasp3d.batch.worker import pickle_call, working_folder
from grasp3d.system.context import is_strict, running
from grasp3d.system.limited_reading import limited_reading
from grasp3d.system.names import describe_unexpected

JobT = TypeVar("JobT")
SettingsT = TypeVar("SettingsT")
RowT = TypeVar("RowT")

MAX_WORKER_DEATHS = 3
"""How many Dask workers may die while they run a job before it is given up."""

MORE_MEMORY = 1.01
"""Factor by which a second attempt must have more memory than the first."""


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
    compiled: bool = False,
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
        compiled: Whether the kernels are compiled before the jobs, outside their limits and times.

    Raises:
        SettingError: No cluster runs at the given address.
        GraspError: The cluster's scheduler is gone, or its workers cannot run the jobs.
    """
    jobs, task = iter(jobs), partial(_in_context, task, strict=is_strict())
    first = list(islice(jobs, 1))
    if not first:
        return
    if compiled and cluster.scheduler is None:
        warmup()
    if cluster.workers == 0:
        for job in chain(first, jobs):
            started(job)
            try:  # a crash of the job ends this process
                row = task(job, settings)
            except NeedsMemory as more:
                row = lost(job, str(more))
            except Exception as error:  # noqa: BLE001, a bug met by one mesh must not end the others
                row = lost(job, describe_unexpected(error))
            yield row
        return
    with ExitStack() as stack:
        client: JobClient
        preparation = None
        if cluster.scheduler is None:
            client = stack.enter_context(open_local(cluster))
        else:
            # Imported here: jobs on this machine need no Dask.
            from grasp3d.batch.cluster import open_cluster

            client = stack.enter_context(open_cluster(cluster.scheduler))
            if compiled:
                preparation = pickle_call(warmup)
        template = Request(
            b"", working_folder(), cluster.worker_memory, cluster.timeout, versions(), preparation
        )
        attempts = _Attempts(
            client, lambda job: pickle_call(task, job, settings), template, lost, started
        )
        yield from attempts.rows(chain(first, jobs))


def _in_context(
    task: Callable[[JobT, SettingsT], RowT], job: JobT, settings: SettingsT, *, strict: bool
) -> RowT:
    """Run a job that reads with limits, and whose warnings are errors if it is strict."""
    with running(strict=strict), limited_reading():
        return task(job, settings)


@dataclass(frozen=True)
class _Attempt(Generic[JobT]):
    """A job, and how its earlier attempts ended."""

    job: JobT
    alone: bool = False
    crashed: bool = False
    deaths: int = 0


class _Attempts(Generic[JobT, RowT]):
    """All jobs of a run: those that are running, and those that are postponed."""

    def __init__(
        self,
        client: JobClient,
        pack: Callable[[JobT], bytes],
        template: Request,
        lost: Callable[[JobT, str], RowT],
        started: Callable[[JobT], None],
    ) -> None:
        """Start nothing yet; `pack` pickles the call of a job, `template` is a request without."""
        self._client, self._pack, self._template = client, pack, template
        self._lost, self._started = lost, started
        self._running: dict[int, _Attempt[JobT]] = {}
        self._postponed: deque[_Attempt[JobT]] = deque()

    def rows(self, jobs: Iterator[JobT]) -> Iterator[RowT]:
        """Run the jobs, taken while fewer are running than the workers hold; yields each row."""
        while self._send_jobs(jobs):
            message = self._client.wait()
            if message is not None:
                number, result = message
                # Yield the row first: taking the next jobs can take a while.
                yield from self._rows_of(self._running.pop(number), result)

    def _send_jobs(self, queue: Iterator[JobT]) -> bool:
        """Send as many jobs as the workers can hold; returns whether any is running."""
        while len(self._running) < self._client.window:
            try:
                job = next(queue)
            except StopIteration:
                break
            self._started(job)
            self._send(_Attempt(job))
        if not self._running and self._postponed:
            self._send(self._postponed.popleft())
        return bool(self._running)

    def _send(self, attempt: _Attempt[JobT]) -> None:
        request = replace(self._template, work=self._pack(attempt.job), alone=attempt.alone)
        self._running[self._client.submit(request)] = attempt

    def _rows_of(self, attempt: _Attempt[JobT], result: Result) -> list[RowT]:
        """The row of a job, or none if the job is tried again."""
        if result.kind is ResultKind.RETURNED:
            return [pickle.loads(result.value)]  # noqa: S301, from a child process of ours
        died = result.kind is ResultKind.WORKER_DIED
        after = (self._after_death if died else self._after_loss)(attempt, result)
        if isinstance(after, str):
            return [self._lost(attempt.job, after)]
        if after.alone and not attempt.alone:
            self._postponed.append(after)
        else:
            self._send(after)
        return []

    def _after_death(self, attempt: _Attempt[JobT], result: Result) -> _Attempt[JobT] | str:
        """The next attempt of a job whose worker died; after several deaths why it is given up."""
        deaths = attempt.deaths + int(result.value)
        if deaths > MAX_WORKER_DEATHS:
            return f"{deaths} Dask workers died while they ran this mesh"
        return replace(attempt, deaths=deaths)

    def _after_loss(self, attempt: _Attempt[JobT], result: Result) -> _Attempt[JobT] | str:
        """The next attempt of a job without a row where it may help; else why it is given up."""
        if result.kind is not ResultKind.LOST:
            return str(result.value)
        failure = result.value.kind
        if failure is CallFailure.CANCELLED:  # by the scheduler, which has assigned it again
            return attempt
        if failure is CallFailure.CRASHED and not attempt.crashed:
            return replace(attempt, crashed=True)
        memory = failure is CallFailure.OUT_OF_MEMORY and self._has_more_memory(result)
        if not attempt.alone and (memory or failure is CallFailure.KILLED):
            return replace(attempt, alone=True)
        return str(result.value)

    def _has_more_memory(self, result: Result) -> bool:
        """Whether a job would have more memory alone than it had."""
        limit = result.memory
        return limit is None or self._client.largest_worker()[1] > MORE_MEMORY * limit
