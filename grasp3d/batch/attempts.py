"""Attempts at jobs: when and how often a job is tried, and which row each attempt gives."""

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Generic, TypeVar

from grasp3d.batch.batch_settings import ClusterSettings
from grasp3d.batch.job_requests import JobClient, Request, Result, ResultKind, versions
from grasp3d.batch.warmup import compile_kernels
from grasp3d.system.isolation import CallFailedError, CallFailure, NeedsMemory, working_folder
from grasp3d.system.isolation.pickling import pickle_call, unpickle_result

JobT = TypeVar("JobT")
SettingsT = TypeVar("SettingsT")
RowT = TypeVar("RowT")

MAX_WORKER_DEATHS = 3
"""How many Dask workers may die while they run a job before it is given up."""

MORE_MEMORY = 1.01
"""Factor by which a second attempt must have more memory than the first."""


@dataclass(frozen=True)
class _Attempt(Generic[JobT]):
    """A job, and how its earlier attempts ended."""

    job: JobT
    alone: bool = False
    crashed: bool = False
    deaths: int = 0


class Attempts(Generic[JobT, SettingsT, RowT]):
    """All jobs of a run: those that are running, and those that are postponed."""

    def __init__(
        self,
        client: JobClient,
        task: Callable[[JobT, SettingsT], RowT],
        settings: SettingsT,
        lost: Callable[[JobT, str], RowT],
        cluster: ClusterSettings,
        kernels: int | None = None,
        *,
        gripper: bool = False,
        forces: bool = False,
    ) -> None:
        """Start nothing yet; the arguments are those of `run`, and the client that sends jobs."""
        self._preparation = None
        if kernels is not None:
            self._preparation = pickle_call(compile_kernels, kernels, gripper, forces)
        self._client, self._task, self._settings = client, task, settings
        self._lost, self._cluster = lost, cluster
        self._folder = working_folder()
        self._running: dict[int, _Attempt[JobT]] = {}
        self._postponed: deque[_Attempt[JobT]] = deque()

    def rows(self, jobs: Iterable[JobT], started: Callable[[JobT], None]) -> Iterator[RowT]:
        """Run the jobs; yields each row when it is finished.

        Args:
            jobs: Taken while fewer are running than the workers can hold.
            started: Called with each job that is taken.
        """
        queue = iter(jobs)
        while self._send_jobs(queue, started):
            message = self._client.wait()
            if message is not None:
                number, result = message
                # Yield the row first: taking the next jobs can take a while.
                yield from self._rows_of(self._running.pop(number), result)

    def _send_jobs(self, queue: Iterator[JobT], started: Callable[[JobT], None]) -> bool:
        """Send as many jobs as the workers can hold; returns whether any is running."""
        while len(self._running) < self._client.window:
            try:
                job = next(queue)
            except StopIteration:
                break
            started(job)
            self._send(_Attempt(job))
        if not self._running and self._postponed:
            self._send(self._postponed.popleft())
        return bool(self._running)

    def _send(self, attempt: _Attempt[JobT]) -> None:
        request = Request(
            pickle_call(self._task, attempt.job, self._settings),
            self._folder,
            self._cluster.worker_memory,
            self._cluster.timeout,
            attempt.alone,
            versions(),
            self._preparation,
        )
        self._running[self._client.submit(request)] = attempt

    def _rows_of(self, attempt: _Attempt[JobT], result: Result) -> list[RowT]:
        """The row of a job, or none if the job is tried again."""
        if result.kind is ResultKind.RETURNED:
            return [unpickle_result(result.value)]
        if result.kind is ResultKind.LOST:
            reason = self._after_loss(attempt, result)
        elif result.kind is ResultKind.NEEDS_MEMORY:
            reason = self._after_memory_request(attempt, result)
        elif result.kind is ResultKind.WORKER_DIED:
            reason = self._after_death(attempt, result)
        else:
            reason = str(result.value)
        return [] if reason is None else [self._lost(attempt.job, reason)]

    def _after_loss(self, attempt: _Attempt[JobT], result: Result) -> str | None:
        """Try a lost job again where that may help; else returns why it is given up."""
        failure: CallFailedError = result.value
        if failure.kind is CallFailure.CANCELLED:  # by the scheduler, which has assigned it again
            self._send(attempt)
        elif failure.kind is CallFailure.CRASHED and not attempt.crashed:
            self._send(replace(attempt, crashed=True))
        elif self._may_succeed_alone(attempt, result):
            self._postponed.append(replace(attempt, alone=True))
        else:
            return failure.reason
        return None

    def _may_succeed_alone(self, attempt: _Attempt[JobT], result: Result) -> bool:
        """Whether a lost job may succeed when no other job runs beside it."""
        kind = result.value.kind
        if kind is CallFailure.KILLED:
            return not attempt.alone
        return kind is CallFailure.OUT_OF_MEMORY and self._more_memory_alone(attempt, result)

    def _after_memory_request(self, attempt: _Attempt[JobT], result: Result) -> str | None:
        """Postpone a job that needs more memory; returns why it is given up if there is no more."""
        if not self._more_memory_alone(attempt, result):
            return str(NeedsMemory(result.value))
        self._postponed.append(replace(attempt, alone=True))
        return None

    def _after_death(self, attempt: _Attempt[JobT], result: Result) -> str | None:
        """Try a job again whose worker died; returns why it is given up after several deaths."""
        deaths = attempt.deaths + int(result.value)
        if deaths > MAX_WORKER_DEATHS:
            return f"{deaths} Dask workers died while they ran this mesh"
        self._send(replace(attempt, deaths=deaths))
        return None

    def _more_memory_alone(self, attempt: _Attempt[JobT], result: Result) -> bool:
        """Whether the job would have more memory alone than it had."""
        if attempt.alone:
            return False
        return (
            result.memory is None or self._client.largest_worker()[1] > MORE_MEMORY * result.memory
        )
