"""Work in the background, one piece at a time: the newest that is wanted, whoever is watching."""

import threading
from collections.abc import Callable, Hashable
from dataclasses import dataclass, field
from queue import Empty, SimpleQueue
from typing import Generic, TypeVar

from grasp3d.errors import GraspError
from grasp3d.isolation import unexpected
from grasp3d.system.progress import Progress

ResultT = TypeVar("ResultT")


class Abandoned(BaseException):
    """Ends work that nobody wants any more, out of its own report of progress."""


@dataclass(frozen=True, eq=False)
class Job(Generic[ResultT]):
    """A piece of work."""

    key: Hashable
    """What it is; work that is wanted under the same key goes on."""
    words: str
    """What is said while it goes on, such as 'searching grasps'."""
    do: Callable[[Progress], ResultT]
    pause: float = 0.0
    """How long it is held back, in case that something newer is wanted at once [s]."""


@dataclass(frozen=True, eq=False)
class Ended(Generic[ResultT]):
    """How a piece of work ended."""

    job: Job[ResultT]
    result: ResultT | None
    error: str | None
    """Why there is no result, a sentence."""


@dataclass(eq=False)
class _Run(Generic[ResultT]):
    """A piece of work under way."""

    job: Job[ResultT]
    share: float = 0.0
    stop: threading.Event = field(default_factory=threading.Event)

    def tell(self, share: float) -> None:
        if self.stop.is_set():
            raise Abandoned
        self.share = share


class Worker(Generic[ResultT]):
    """Does the newest piece of work that is wanted, in a thread of its own.

    What it was doing before is abandoned where it next tells its progress. Everything but the work
    itself happens in the thread of whoever holds the worker.
    """

    def __init__(self) -> None:
        self._ended: SimpleQueue[tuple[Ended[ResultT], _Run[ResultT]]] = SimpleQueue()
        self._run: _Run[ResultT] | None = None

    @property
    def job(self) -> Job[ResultT] | None:
        """What is being done."""
        return None if self._run is None else self._run.job

    @property
    def share(self) -> float:
        """How much of it is done, from 0 to 1."""
        return 0.0 if self._run is None else self._run.share

    def want(self, job: Job[ResultT] | None) -> None:
        """Have something done, in place of anything else; None: nothing."""
        if self._run is not None and job is not None and self._run.job.key == job.key:
            return
        if self._run is not None:
            self._run.stop.set()
        self._run = None
        if job is not None:
            self._run = _Run(job)
            threading.Thread(target=self._do, args=(self._run,), daemon=True).start()

    def take(self) -> Ended[ResultT] | None:
        """The end of the work that is wanted, once."""
        while True:
            try:
                ended, run = self._ended.get_nowait()
            except Empty:
                return None
            if run is self._run:
                self._run = None
                return ended

    def _do(self, run: _Run[ResultT]) -> None:
        job = run.job
        if run.stop.wait(job.pause):
            return
        try:
            ended = Ended(job, job.do(run.tell), None)
        except Abandoned:
            return
        except GraspError as error:
            ended = Ended(job, None, str(error))
        except MemoryError:
            ended = Ended(job, None, f"{job.words}: memory is too small; use a coarser mesh")
        except Exception as error:  # noqa: BLE001
            ended = Ended(job, None, unexpected(error))
        self._ended.put((ended, run))
