"""Calling a function in a child process, which may crash, hang or take too much memory."""

import os
import pickle
import struct
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

from grasp3d.isolation.limits import Limits, never
from grasp3d.isolation.losses import Loss, Lost
from grasp3d.isolation.process import Child, Pool
from grasp3d.isolation.watching import ask

ResultT = TypeVar("ResultT")

LENGTH = struct.Struct("<Q")
"""How the length of a request and of an answer is written."""

IDLE = 30.0
"""How long a child is kept that nobody asks [s]."""

_ONE_THREAD = {
    f"{library}_NUM_THREADS": "1"
    for library in ("NUMBA", "OMP", "OPENBLAS", "MKL", "NUMEXPR", "VECLIB_MAXIMUM")
}
"""There is a child for each processor already."""

_pool = Pool("grasp3d.isolation.child", _ONE_THREAD, IDLE)


def call(
    function: Callable[..., ResultT],
    *arguments: object,
    memory: float | None = None,
    seconds: float | None = None,
    cancelled: Callable[[], bool] = never,
) -> ResultT:
    """Call a function in a child process, which is kept for the next call.

    Function and arguments are pickled, those of a script by value. The child finds modules where
    this process does, and works in its folder, with one thread for each numerical library. What it
    prints is not shown.

    Args:
        function: What to call.
        arguments: Handed to it.
        memory: What the child and its own children may take together [GB]; none: any.
        seconds: How long it may take [s]; none: any.
        cancelled: Asked ten times a second, in another thread: whether nobody waits any more.

    Returns:
        What the function returned.

    Raises:
        Lost: The child crashed, was killed, took more than the limits, or nobody waits any more.
        Exception: Whatever the function raised, with its traceback in the child as a note.
    """
    import cloudpickle

    request = cloudpickle.dumps((_place(), memory, cloudpickle.dumps((function, arguments))))
    limits = Limits(memory, seconds, cancelled)
    try:
        kind, value = _answer(_child(), request, limits)
    except _WornError:
        kind, value = _answer(_child(fresh=True), request, limits)
    if kind == "raised":
        raise value
    result: ResultT = value
    return result


def end_idle() -> None:
    """End the children that are not at a call."""
    _pool.end_idle()


def working_folder() -> str:
    """Folder that this process works in; the root where it was removed."""
    try:
        return str(Path.cwd())
    except OSError:
        return os.sep


def _place() -> tuple[str, list[str]]:
    """This process's folder, and where it finds modules."""
    here = working_folder()
    return here, [str(Path(here, path)) for path in sys.path]


def _child(*, fresh: bool = False) -> Child:
    try:
        return _pool.take(fresh=fresh)
    except OSError as error:  # the machine is full, which is no fault of this call
        raise Lost(Loss.KILLED, f"could not be given a process ({error.strerror})") from error


class _WornError(Exception):
    """A call ran out of memory in a child that may not have given back what others took."""


def _answer(child: Child, request: bytes, limits: Limits) -> tuple[str, Any]:
    """Ask a child, which is kept if it is well."""
    try:
        answer = ask(child, LENGTH.pack(len(request)) + request, _read, limits)
        kind, value = _loaded(child, answer)
    except Lost as lost:
        if lost.kind is Loss.OUT_OF_MEMORY and child.used:
            raise _WornError from lost
        raise
    child.used = True
    if child.alive:
        _pool.give_back(child)
    else:
        child.close()
    return kind, value


def _read(child: Child) -> bytearray:
    (length,) = LENGTH.unpack(child.receive(LENGTH.size))
    return child.receive(length)


def _loaded(child: Child, answer: bytearray) -> tuple[str, Any]:
    try:
        kind, value = pickle.loads(answer)  # noqa: S301, made by our own child
    except BaseException:
        child.close()
        raise
    if kind == "memory":
        child.close()
        raise Lost(Loss.OUT_OF_MEMORY, "asked for more memory than there is and was ended")
    return kind, value
