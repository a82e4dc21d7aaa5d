"""The task of a Dask worker: run one job in a child process and watch it."""

import platform
import threading
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from enum import StrEnum, auto
from functools import cache
from importlib.metadata import version
from typing import Any

from distributed import Status, Worker, get_worker
from distributed.system import MEMORY_LIMIT

from grasp3d.isolation import CallFailedError, NeedsMemory, call, describe_unexpected, end_idle
from grasp3d.isolation.pickling import run_pickled_call

USABLE_MEMORY = 0.9
"""Fraction of the memory that jobs may take; the rest is for the system and for Dask."""

_ENDING = {Status.closing, Status.closed, Status.failed}

_preparing = threading.Lock()
_prepared: set[bytes] = set()


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


class ResultKind(StrEnum):
    """How a request ended."""

    RETURNED = auto()
    """The value is what the task returned, packed."""
    LOST = auto()
    """The value is the `CallFailedError` with which the child process ended."""
    NEEDS_MEMORY = auto()
    """Not begun: the value is the memory that the job needs [GB]."""
    FAILED = auto()
    """An describe_unexpected exception; the value is a sentence."""
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


def run_request(request: Request) -> Result:
    """Run one job, as a task of a Dask worker; every failure is a result, not an exception."""
    worker = get_worker()
    if request.versions != versions():
        message = (
            f"the worker at {worker.address} runs {versions()}, this process {request.versions}"
        )
        return Result(ResultKind.OTHER_VERSIONS, message)
    memory = _memory_limit(request, worker)
    if request.alone:
        end_idle()  # the memory of idle children is part of what the job may take
    cancelled = _cancelled(worker, worker.get_current_task())
    try:
        prepare(request, cancelled)
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


def prepare(request: Request, cancelled: Callable[[], bool]) -> None:
    """Make the call that prepares a worker, if it was not made yet; other jobs wait meanwhile.

    Args:
        request: The next job.
        cancelled: Whether the job is no longer needed; the call is then made with another one.
    """
    with _preparing:
        if request.preparation is None or request.preparation in _prepared:
            return
        with suppress(CallFailedError):  # jobs report the same failure
            call(run_pickled_call, request.preparation, request.folder, cancelled=cancelled)
            _prepared.add(request.preparation)


@cache
def versions() -> str:
    """Versions that must be equal everywhere, for equal results and readable pickles."""
    python = ".".join(platform.python_version_tuple()[:2])
    packages = ", ".join(f"{name} {version(name)}" for name in ("grasp3d", "distributed"))
    return f"{packages} and Python {python}"


def usable_memory(dask_worker: Worker) -> float:
    """Memory of a worker that jobs may take [GB], from its memory limit or its machine's memory."""
    return USABLE_MEMORY * (dask_worker.memory_manager.memory_limit or MEMORY_LIMIT) / 1e9


def _memory_limit(request: Request, worker: Worker) -> float:
    usable, own = usable_memory(worker), request.memory
    if request.alone:
        return usable if own is None else max(usable, own)
    return usable / worker.state.nthreads if own is None else own


def _cancelled(worker: Worker, key: Any) -> Callable[[], bool]:
    """Make a function that returns whether a task of the worker was cancelled.

    The scheduler releases tasks when they are cancelled, and when their client is gone.
    """

    def cancelled() -> bool:
        task = worker.state.tasks.get(key)
        return task is None or task.state != "executing" or worker.status in _ENDING

    return cancelled
