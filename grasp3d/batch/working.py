"""What a Dask worker does for one job: it hands the work to a child process and watches it."""

import platform
from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum, auto
from functools import cache
from importlib.metadata import version
from typing import Any

from distributed import Status, Worker, get_worker
from distributed.system import MEMORY_LIMIT

from grasp3d.isolation import Lost, NeedsMemory, call, end_idle, unexpected
from grasp3d.isolation.packing import called

KEPT = 0.9
"""Share of the memory that work may take; the rest is for the system and for Dask."""

_ENDING = {Status.closing, Status.closed, Status.failed}


@dataclass(frozen=True)
class Order:
    """One job as it is sent to a worker."""

    work: bytes
    """The call, packed: neither scheduler nor worker loads what only the child needs."""
    folder: str
    """Where relative paths in it begin, if the worker has that folder."""
    memory: float | None
    """Memory for the job where it does not run alone [GB]; none: a share of the worker's."""
    seconds: float | None
    """Time for the job [s]; none: any."""
    alone: bool
    """Whether it may take all memory of the worker, since nothing else runs there."""
    versions: str
    """Of whoever sends it."""


class Ending(StrEnum):
    """How the work on an order ended."""

    ROW = auto()
    """With what the task returned, packed."""
    LOST = auto()
    """`Lost`, by which the child ended."""
    NEEDS = auto()
    """Before it began: the memory that it needs [GB]."""
    FAILED = auto()
    """With an exception that nobody foresaw; a sentence."""
    DIED = auto()
    """With the Dask worker, told by the scheduler: how often."""
    OTHER = auto()
    """Never begun, since the worker runs other versions; a sentence."""


@dataclass(frozen=True)
class Answer:
    """What came of an order."""

    ending: Ending
    value: Any
    memory: float | None = None
    """What the child was allowed [GB]."""


def perform(order: Order) -> Answer:
    """Do one job, as a task of a Dask worker; whatever happens is an answer, no exception."""
    worker = get_worker()
    if order.versions != versions():
        told = f"the worker at {worker.address} runs {versions()}, this process {order.versions}"
        return Answer(Ending.OTHER, told)
    memory = _memory(order, worker)
    if order.alone:
        end_idle()  # what they hold is part of what the job may take
    try:
        row = call(
            called,
            order.work,
            order.folder,
            memory=memory,
            seconds=order.seconds,
            cancelled=_taken_back(worker, worker.get_current_task()),
        )
    except Lost as lost:
        return Answer(Ending.LOST, lost, memory)
    except NeedsMemory as more:
        return Answer(Ending.NEEDS, more.gigabytes, memory)
    except Exception as error:  # noqa: BLE001, a bug met by one mesh must not end the others
        return Answer(Ending.FAILED, unexpected(error))
    return Answer(Ending.ROW, row)


@cache
def versions() -> str:
    """What must be the same everywhere for results to be the same and pickles to be read."""
    python = ".".join(platform.python_version_tuple()[:2])
    packages = ", ".join(f"{name} {version(name)}" for name in ("grasp3d", "distributed"))
    return f"{packages} and Python {python}"


def whole_memory(dask_worker: Worker) -> float:
    """Memory of a worker that work may take [GB]: of what it was given, or of its machine."""
    return KEPT * (dask_worker.memory_manager.memory_limit or MEMORY_LIMIT) / 1e9


def _memory(order: Order, worker: Worker) -> float:
    whole, own = whole_memory(worker), order.memory
    if order.alone:
        return whole if own is None else max(whole, own)
    return whole / worker.state.nthreads if own is None else own


def _taken_back(worker: Worker, key: Any) -> Callable[[], bool]:  # noqa: ANN401, Dask's own type
    """Tell of the task in this thread whether nobody waits for it any more.

    The scheduler takes tasks back when they are cancelled, and when their client is gone.
    """

    def taken_back() -> bool:
        task = worker.state.tasks.get(key)
        return task is None or task.state != "executing" or worker.status in _ENDING

    return taken_back
