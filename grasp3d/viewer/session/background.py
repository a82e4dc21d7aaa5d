"""Background jobs, one at a time: a new request replaces the running job."""

import threading
from collections.abc import Callable, Hashable
from contextvars import copy_context
from dataclasses import dataclass, field
from functools import partial
from queue import Empty, SimpleQueue
from typing import Generic, TypeVar

from grasp3d.errors import GraspError
from grasp3d.system.context import running
from grasp3d.system.names import describe_unexpected

ResultT = TypeVar("ResultT")


class Cancelled(BaseException):
    """Raised in a job by its progress report when the job is no longer needed."""


@dataclass(frozen=True, eq=False)
class Job(Generic[ResultT]):
    """A computation."""

    key: Hashable
    """Identifies the job; a running job is not restarted by a request with the same key."""
    text: str
    """Description, such as 'searching grasps'."""
    run: Callable[[], ResultT]
    delay: float = 0.0
    """Waiting time before it starts, in which a newer request can replace it [s]."""
    then: Callable[[ResultT], None] | None = None
    """Called by the owner with the result; None: that stays where it was computed."""


@dataclass(eq=False)
class Run(Generic[ResultT]):
    """A job that is running, or has finished with a result or an error."""

    job: Job[ResultT]
    fraction: float = 0.0
    """Finished fraction, from 0 to 1."""
    result: ResultT | None = None
    error: str | None = None
    """Why there is no result, as one sentence."""
    stop: threading.Event = field(default_factory=threading.Event)

    def report(self, fraction: float) -> None:
        """Note the finished fraction; ends the job if it is no longer needed."""
        if self.stop.is_set():
            raise Cancelled
        self.fraction = fraction


class Worker(Generic[ResultT]):
    """Runs the latest requested job in a thread.

    A replaced job ends at its next progress report. Only the job itself runs in the thread; all
    methods are called from the owner's thread.
    """

    def __init__(self) -> None:
        self._finished: SimpleQueue[Run[ResultT]] = SimpleQueue()
        self._run: Run[ResultT] | None = None

    @property
    def job(self) -> Job[ResultT] | None:
        """The running job."""
        return None if self._run is None else self._run.job

    @property
    def fraction(self) -> float:
        """Finished fraction of the running job, from 0 to 1."""
        return 0.0 if self._run is None else self._run.fraction

    def request(self, job: Job[ResultT] | None) -> None:
        """Run a job instead of the current one; None: cancel the current one."""
        if self._run is not None and job is not None and self._run.job.key == job.key:
            return
        if self._run is not None:
            self._run.stop.set()
        self._run = None
        if job is not None:
            self._run = Run(job)
            # A new thread begins without the threads that are stated here.
            execute = partial(copy_context().run, self._execute, self._run)
            threading.Thread(target=execute, daemon=True).start()

    def take_finished(self) -> Run[ResultT] | None:
        """The current job, once, when it has finished."""
        while True:
            try:
                run = self._finished.get_nowait()
            except Empty:
                return None
            if run is self._run:
                self._run = None
                return run

    def _execute(self, run: Run[ResultT]) -> None:
        job = run.job
        if run.stop.wait(job.delay):
            return
        try:
            with running(progress=run.report):
                run.result = job.run()
        except Cancelled:
            return
        except GraspError as error:
            run.error = str(error)
        except MemoryError:
            run.error = f"{job.text}: memory is too small; use a coarser mesh"
        except Exception as error:  # noqa: BLE001
            run.error = describe_unexpected(error)
        self._finished.put(run)
