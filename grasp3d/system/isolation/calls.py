"""Function calls in child processes, which may crash, hang or run out of memory."""

import os
import pickle
import struct
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

from grasp3d.system.isolation.failures import CallFailedError, CallFailure
from grasp3d.system.isolation.limits import Limits, never
from grasp3d.system.isolation.monitoring import send_request
from grasp3d.system.isolation.process import ChildProcess, ProcessPool

ResultT = TypeVar("ResultT")

LENGTH = struct.Struct("<Q")
"""Format of the length that precedes each request and each answer."""

IDLE = 30.0
"""Time after which an idle child process is ended [s]."""

_ONE_THREAD = {
    f"{library}_NUM_THREADS": "1"
    for library in ("NUMBA", "OMP", "OPENBLAS", "MKL", "NUMEXPR", "VECLIB_MAXIMUM")
}
"""Environment for one thread per child process, since each processor has a child already."""

_pool = ProcessPool("grasp3d.system.isolation.child", _ONE_THREAD, IDLE)


def call(
    function: Callable[..., ResultT],
    *arguments: object,
    memory: float | None = None,
    seconds: float | None = None,
    cancelled: Callable[[], bool] = never,
) -> ResultT:
    """Call a function in a child process, which is reused for later calls.

    Function and arguments are pickled; functions of a script are pickled by value. The child has
    the module search path and the working folder of this process, and one thread per numerical
    library. Its standard output is discarded.

    Args:
        function: Function to call.
        arguments: Its arguments.
        memory: Limit for the child process and its descendants together [GB]; none: no limit.
        seconds: Time limit [s]; none: no limit.
        cancelled: Called ten times a second in another thread: whether the result is no longer
            needed.

    Returns:
        The return value of the function.

    Raises:
        CallFailedError: The child crashed, was killed, exceeded a limit, or the call was cancelled.
        Exception: The exception that the function raised, with its traceback as a note.
    """
    import cloudpickle

    request = cloudpickle.dumps((_environment(), memory, cloudpickle.dumps((function, arguments))))
    limits = Limits(memory, seconds, cancelled)
    try:
        kind, value = _answer(_child(), request, limits)
    except _ReusedChildError:
        kind, value = _answer(_child(fresh=True), request, limits)
    if kind == "raised":
        raise value
    result: ResultT = value
    return result


def end_idle() -> None:
    """End the idle child processes."""
    _pool.end_idle()


def working_folder() -> str:
    """Return the working folder of this process; the root if the folder was deleted."""
    try:
        return str(Path.cwd())
    except OSError:
        return os.sep


def _environment() -> tuple[str, list[str]]:
    """Return the working folder and the module search path of this process."""
    folder = working_folder()
    return folder, [str(Path(folder, path)) for path in sys.path]


def _child(*, fresh: bool = False) -> ChildProcess:
    try:
        return _pool.take(fresh=fresh)
    except OSError as error:  # the machine has too many processes: not an error of the call
        raise CallFailedError(
            CallFailure.KILLED, f"cannot be started ({error.strerror})"
        ) from error


class _ReusedChildError(Exception):
    """A call ran out of memory in a child process that may still hold memory of earlier calls."""


def _answer(child: ChildProcess, request: bytes, limits: Limits) -> tuple[str, Any]:
    """Send a request to a child process, and return the child to the pool if it is alive."""
    try:
        answer = send_request(child, LENGTH.pack(len(request)) + request, _read, limits)
        kind, value = _unpickled(child, answer)
    except CallFailedError as failure:
        if failure.kind is CallFailure.OUT_OF_MEMORY and child.used:
            raise _ReusedChildError from failure
        raise
    child.used = True
    if child.alive:
        _pool.give_back(child)
    else:
        child.close()
    return kind, value


def _read(child: ChildProcess) -> bytearray:
    (length,) = LENGTH.unpack(child.receive(LENGTH.size))
    return child.receive(length)


def _unpickled(child: ChildProcess, answer: bytearray) -> tuple[str, Any]:
    try:
        kind, value = pickle.loads(answer)  # noqa: S301, from a child process of ours
    except BaseException:
        child.close()
        raise
    if kind == "memory":
        child.close()
        raise CallFailedError(
            CallFailure.OUT_OF_MEMORY, "requested more memory than is available and was ended"
        )
    return kind, value
