"""Function calls in child processes, which may crash, hang or run out of memory."""

import os
import pickle
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

from grasp3d.system.isolation.limits import CallFailedError, CallFailure, Limits, never
from grasp3d.system.isolation.monitoring import RAISED, answer_of
from grasp3d.system.isolation.process import ChildProcess, pool

ResultT = TypeVar("ResultT")


def call(
    function: Callable[..., ResultT],
    *arguments: object,
    memory: float | None = None,
    seconds: float | None = None,
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

    Returns:
        The return value of the function.

    Raises:
        CallFailedError: The child crashed, was killed or exceeded a limit.
        Exception: The exception that the function raised, with its traceback as a note.
    """
    data = call_pickled(pickle_call(function, *arguments), memory=memory, seconds=seconds)
    result: ResultT = pickle.loads(data)  # noqa: S301, from a child process of ours
    return result


def pickle_call(function: Callable[..., object], *arguments: object) -> bytes:
    """Pickle a function call; functions and classes of a script are pickled by value."""
    import cloudpickle

    data: bytes = cloudpickle.dumps((function, arguments))
    return data


def call_pickled(
    work: bytes,
    folder: str = "",
    *,
    memory: float | None = None,
    seconds: float | None = None,
    cancelled: Callable[[], bool] = never,
) -> bytes:
    """As `call`, with a call from `pickle_call`: this process need not import what it needs.

    Args:
        work: The call.
        folder: Working folder, if it exists, so that relative paths mean the same as where the
            call was pickled; else that of this process.
        memory: As in `call`.
        seconds: As in `call`.
        cancelled: As in `call`.

    Returns:
        The pickled return value of the function.
    """
    here = working_folder()
    paths = [str(Path(here, path)) for path in sys.path]
    existing = folder if folder and Path(folder).is_dir() else here
    request = pickle.dumps((existing, paths, memory, work))
    limits = Limits(memory, seconds, cancelled)
    try:
        answer = _answer(_child(), request, limits)
    except _ReusedChildError:
        answer = _answer(_child(fresh=True), request, limits)
    if answer[0] == RAISED:
        raise pickle.loads(memoryview(answer)[1:])  # noqa: S301, as above
    return bytes(memoryview(answer)[1:])


def end_idle() -> None:
    """End the idle child processes."""
    pool.end_idle()


def working_folder() -> str:
    """Return the working folder of this process; the root if the folder was deleted."""
    try:
        return str(Path.cwd())
    except OSError:
        return os.sep


def _child(*, fresh: bool = False) -> ChildProcess:
    try:
        return pool.take(fresh=fresh)
    except OSError as error:  # the machine has too many processes: not an error of the call
        raise CallFailedError(
            CallFailure.KILLED, f"cannot be started ({error.strerror})"
        ) from error


class _ReusedChildError(Exception):
    """A call ran out of memory in a child process that may still hold memory of earlier calls."""


def _answer(child: ChildProcess, request: bytes, limits: Limits) -> bytearray:
    """Send a request to a child process, and return the child to the pool if it is alive."""
    try:
        answer = answer_of(child, request, limits)
    except CallFailedError as failure:
        if failure.kind is CallFailure.OUT_OF_MEMORY and child.used:
            raise _ReusedChildError from failure
        raise
    child.used = True
    if child.alive:
        pool.give_back(child)
    else:
        child.close()
    return answer
