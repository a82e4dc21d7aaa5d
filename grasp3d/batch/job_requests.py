"""Jobs as they are sent to the processes that run them, and how their attempts end."""

import platform
from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum, auto
from functools import cache
from importlib.metadata import version
from typing import Any, Protocol

from grasp3d.system.isolation import CallFailedError, NeedsMemory, call, describe_unexpected
from grasp3d.system.isolation.pickling import run_pickled_call

USABLE_MEMORY = 0.9
"""Fraction of the memory that jobs may take; the rest is for the system and for this program."""


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
    alone: bool
    """Whether the job may take all memory of the worker, since no other job runs there."""
    versions: str
    """Versions of the sender."""
    preparation: bytes | None = None
    """A packed call that is made once per worker, outside the limits of jobs; none: none needed."""

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
    """The value is the `CallFailedError` with which the child process ended."""
    NEEDS_MEMORY = auto()
    """Not begun: the value is the memory that the job needs [GB]."""
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
        value = call(
            run_pickled_call,
            request.work,
            request.folder,
            memory=memory,
            seconds=request.seconds,
            cancelled=cancelled,
        )
    except CallFailedError as failure:
        return Result(ResultKind.LOST, failure, memory)
    except NeedsMemory as more:
        return Result(ResultKind.NEEDS_MEMORY, more.gigabytes, memory)
    except Exception as error:  # noqa: BLE001, a bug met by one mesh must not end the others
        return Result(ResultKind.FAILED, describe_unexpected(error))
    return Result(ResultKind.RETURNED, value)


@cache
def versions() -> str:
    """Versions that must be equal everywhere, for equal results and readable pickles."""
    python = ".".join(platform.python_version_tuple()[:2])
    packages = ", ".join(f"{name} {version(name)}" for name in ("grasp3d", "distributed"))
    return f"{packages} and Python {python}"
