"""Which job is tried when, how often, and what is made of its end."""

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Generic, TypeVar

from grasp3d.batch.batch_settings import ClusterSettings
from grasp3d.batch.crew import Crew
from grasp3d.batch.working import Answer, Ending, Order, versions
from grasp3d.isolation import Loss, Lost, NeedsMemory, working_folder
from grasp3d.isolation.packing import packed, unpacked

JobT = TypeVar("JobT")
SettingsT = TypeVar("SettingsT")
RowT = TypeVar("RowT")

DEATHS = 3
"""How many Dask workers may die under a job before it is given up."""

MORE = 1.01
"""By how much a second attempt must have more memory to be worth it."""


@dataclass(frozen=True)
class _Attempt(Generic[JobT]):
    """A job, and what came of it so far."""

    job: JobT
    alone: bool = False
    crashed: bool = False
    deaths: int = 0


class Attempts(Generic[JobT, SettingsT, RowT]):
    """All jobs of a run: those that are at work, and those that are put off."""

    def __init__(
        self,
        crew: Crew,
        task: Callable[[JobT, SettingsT], RowT],
        settings: SettingsT,
        lost: Callable[[JobT, str], RowT],
        cluster: ClusterSettings,
    ) -> None:
        """Begin nothing yet; the arguments are those of `run`, and who does the work."""
        self._crew, self._task, self._settings = crew, task, settings
        self._lost, self._cluster = lost, cluster
        self._folder = working_folder()
        self._flying: dict[int, _Attempt[JobT]] = {}
        self._later: deque[_Attempt[JobT]] = deque()

    def rows(self, jobs: Iterable[JobT], started: Callable[[JobT], None]) -> Iterator[RowT]:
        """Do the jobs; yields each row when it is done.

        Args:
            jobs: Taken while there are fewer at work than the workers can have.
            started: Told of each job that is taken.
        """
        left = iter(jobs)
        while self._sent(left, started):
            done = self._crew.wait()
            if done is not None:
                number, answer = done
                # A row is made before the next jobs are taken, which can take a while.
                yield from self._judged(self._flying.pop(number), answer)

    def _sent(self, left: Iterator[JobT], started: Callable[[JobT], None]) -> bool:
        """Send what there is room for; tells whether anything is at work."""
        while len(self._flying) < self._crew.window:
            try:
                job = next(left)
            except StopIteration:
                break
            started(job)
            self._send(_Attempt(job))
        if not self._flying and self._later:
            self._send(self._later.popleft())
        return bool(self._flying)

    def _send(self, attempt: _Attempt[JobT]) -> None:
        order = Order(
            packed(self._task, attempt.job, self._settings),
            self._folder,
            self._cluster.worker_memory,
            self._cluster.timeout,
            attempt.alone,
            versions(),
        )
        self._flying[self._crew.submit(order)] = attempt

    def _judged(self, attempt: _Attempt[JobT], answer: Answer) -> list[RowT]:
        """The row of a job, or none if it is tried again."""
        if answer.ending is Ending.ROW:
            return [unpacked(answer.value)]
        if answer.ending is Ending.LOST:
            again = self._after_loss(attempt, answer)
        elif answer.ending is Ending.NEEDS:
            again = self._after_need(attempt, answer)
        elif answer.ending is Ending.DIED:
            again = self._after_death(attempt, answer)
        else:
            again = str(answer.value)
        return [] if again is None else [self._lost(attempt.job, again)]

    def _after_loss(self, attempt: _Attempt[JobT], answer: Answer) -> str | None:
        """Try again what may have had bad luck; gives the reason where it is given up."""
        lost: Lost = answer.value
        if lost.kind is Loss.CANCELLED:  # by the scheduler, which then thought better of it
            self._send(attempt)
        elif lost.kind is Loss.CRASHED and not attempt.crashed:
            self._send(replace(attempt, crashed=True))
        elif self._worth_waiting(attempt, answer):
            self._later.append(replace(attempt, alone=True))
        else:
            return lost.reason
        return None

    def _worth_waiting(self, attempt: _Attempt[JobT], answer: Answer) -> bool:
        """Whether a job that was lost may do better alone."""
        kind = answer.value.kind
        if kind is Loss.KILLED:
            return not attempt.alone
        return kind is Loss.OUT_OF_MEMORY and self._more_than(attempt, answer)

    def _after_need(self, attempt: _Attempt[JobT], answer: Answer) -> str | None:
        if not self._more_than(attempt, answer):
            return str(NeedsMemory(answer.value))
        self._later.append(replace(attempt, alone=True))
        return None

    def _after_death(self, attempt: _Attempt[JobT], answer: Answer) -> str | None:
        deaths = attempt.deaths + int(answer.value)
        if deaths > DEATHS:
            return f"{deaths} Dask workers died while they worked on this mesh"
        self._send(replace(attempt, deaths=deaths))
        return None

    def _more_than(self, attempt: _Attempt[JobT], answer: Answer) -> bool:
        """Whether the job could have more memory alone than it had."""
        if attempt.alone:
            return False
        return answer.memory is None or self._crew.largest()[1] > MORE * answer.memory
