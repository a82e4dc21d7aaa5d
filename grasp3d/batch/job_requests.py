"""Requests to run jobs, how they end, and the processes of this machine that answer them."""

import platform
import queue
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from enum import StrEnum, auto
from functools import cache
from importlib.metadata import version
from itertools import count
from typing import Any, Protocol

from grasp3d.batch.batch_settings import MIN_WORKER_MEMORY, ClusterSettings
from grasp3d.batch.limits import CallFailedError, CallFailure, NeedsMemory, machine_memory
from grasp3d.batch.worker import call_pickled, end_idle
from grasp3d.system.context import available_processors
from grasp3d.system.names import describe_unexpected

USABLE_MEMORY = 0.9
"""Fraction of the memory that jobs may take; the rest is for the system and for this program."""

REQUESTS_PER_PROCESS = 2
"""Requests sent for each process, so that no process waits for the next one."""

WAIT = 1.0
"""Longest time of a wait for a result [s]."""


@dataclass(frozen=True)
class Request:
    """One job as it is sent to a worker."""

    work: bytes
    """The packed call: scheduler and worker need not import what only the child process needs."""
    folder: str
    """Folder in which the call's relative paths begin, if the worker has that folder."""
    memory: float | None
    """Memory limit where the job does not run alone [GB]; none: the worker's, divided by its
    threads."""
    seconds: float | None
    """Time limit [s]; none: no limit."""
    versions: str
    """Versions of the sender."""
    preparation: bytes | None = None
    """A packed call that is made once per worker, outside the limits of jobs; none: none needed."""
    alone: bool = False
    """Whether the job may take all memory of the worker, since no other job runs there."""

    def memory_limit(self, usable: float, threads: int) -> float:
        """Memory limit of the job's process [GB].

        Args:
            usable: Memory of the worker that jobs may take [GB].
            threads: Jobs that the worker runs at once.
        """
        if self.alone:
            return usable if self.memory is None else max(usable, self.memory)
        return usable / threads if self.memory is None else self.memory


class ResultKind(StrEnum):
    """How a request ended."""

    RETURNED = auto()
    """The value is what the task returned, packed."""
    LOST = auto()
    """The value is the `CallFailedError` with which the child process ended, or that tells that
    the job was not begun for lack of memory."""
    FAILED = auto()
    """An unexpected exception; the value is a sentence."""
    WORKER_DIED = auto()
    """The Dask worker died; the value is how often, as counted by the scheduler."""
    OTHER_VERSIONS = auto()
    """Not begun, since the worker runs other versions; the value is a sentence."""


@dataclass(frozen=True)
class Result:
    """Result of a request."""

    kind: ResultKind
    value: Any
    memory: float | None = None
    """Memory limit of the child process [GB]."""


class JobClient(Protocol):
    """Sends requests to the processes that run them and collects their results."""

    @property
    def window(self) -> int:
        """How many requests should be pending at any time."""

    def submit(self, request: Request) -> int:
        """Send a request; returns its number."""

    def wait(self) -> tuple[int, Result] | None:
        """Wait for a result for a limited time; returns its number and value, or none."""

    def largest_worker(self) -> tuple[str, float]:
        """Name of the worker with the most memory, and the memory that jobs may take [GB]."""


def result_of(request: Request, memory: float, cancelled: Callable[[], bool]) -> Result:
    """Run a job in a child process and watch it; every failure is a result, not an exception.

    Args:
        request: The job.
        memory: Memory limit of the process [GB].
        cancelled: Whether the result is no longer needed.
    """
    try:
        value = call_pickled(
            request.work,
            request.folder,
            memory=memory,
            seconds=request.seconds,
            cancelled=cancelled,
        )
    except CallFailedError as failure:
        return Result(ResultKind.LOST, failure, memory)
    except NeedsMemory as more:
        too_little = CallFailedError(CallFailure.OUT_OF_MEMORY, str(more))
        return Result(ResultKind.LOST, too_little, memory)
    except Exception as error:  # noqa: BLE001, a bug met by one mesh must not end the others
        return Result(ResultKind.FAILED, describe_unexpected(error))
    return Result(ResultKind.RETURNED, value)


@cache
def versions() -> str:
    """Versions that must be equal everywhere, for equal results and readable pickles."""
    python = ".".join(platform.python_version_tuple()[:2])
    packages = ", ".join(f"{name} {version(name)}" for name in ("grasp3d", "distributed"))
    return f"{packages} and Python {python}"


class LocalClient:
    """Runs requests on this machine: a thread for each child process, which watches it."""

    def __init__(self, processes: int) -> None:
        """Start nothing yet.

        Args:
            processes: How many requests run at once.
        """
        self.processes = processes
        self._usable = USABLE_MEMORY * machine_memory()
        self._numbers = count()
        self._done: queue.SimpleQueue[tuple[int, Result]] = queue.SimpleQueue()
        self._closed = threading.Event()
        self._threads = ThreadPoolExecutor(processes, "grasp3d-batch")

    @property
    def window(self) -> int:
        """How many requests should be pending at any time."""
        return REQUESTS_PER_PROCESS * self.processes

    def submit(self, request: Request) -> int:
        """Run a request when a process is free; returns its number."""
        number = next(self._numbers)
        self._threads.submit(self._run, number, request)
        return number

    def wait(self) -> tuple[int, Result] | None:
        """Wait for a result for a limited time; returns its number and value, or none."""
        try:
            return self._done.get(timeout=WAIT)
        except queue.Empty:
            return None

    def largest_worker(self) -> tuple[str, float]:
        """Name of this machine, and the memory that jobs may take [GB]."""
        return "this machine", self._usable

    def close(self) -> None:
        """End the running requests, and forget the others."""
        self._closed.set()
        self._threads.shutdown(cancel_futures=True)

    def _run(self, number: int, request: Request) -> None:
        if request.alone:
            end_idle()  # the memory of idle children is part of what the job may take
        memory = request.memory_limit(self._usable, self.processes)
        self._done.put((number, result_of(request, memory, self._closed.is_set)))


@contextmanager
def open_local(settings: ClusterSettings) -> Iterator[LocalClient]:
    """Run requests on this machine for the duration of the context, then end all processes."""
    client = LocalClient(local_workers(settings))
    try:
        yield client
    finally:
        client.close()
        end_idle()


def local_workers(settings: ClusterSettings) -> int:
    """Jobs to run at once on this machine, limited by its processors and its memory."""
    if settings.workers is not None:
        return settings.workers
    least = settings.worker_memory or MIN_WORKER_MEMORY
    return max(1, min(available_processors(), int(USABLE_MEMORY * machine_memory() / least)))
