"""Reading of files and repair of meshes in child processes with limited memory and time.

The command line, batch jobs and the viewer use it, because damaged files can crash libraries or use
up time and memory. Called from Python, files are read without limits in the same process.
"""

import faulthandler
import gc
import multiprocessing
import os
import pickle
import signal
import sys
import threading
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from grasp3d.errors import FileUnreadError, GraspError
from grasp3d.system.names import printable

SECONDS = 30.0
"""Time limit for reading a file [s]."""

MEMORY = 2e9
"""Memory limit for reading a file [bytes]."""

GRACE = 2.0
"""Time beyond its limit after which a child process is killed if its own alarm failed [s]."""

T = TypeVar("T")


@dataclass(frozen=True)
class Limits:
    """Limits of a child process, and words of the error when it exceeds them."""

    seconds: float
    """Time limit [s]."""
    memory: float
    """Memory that it may take in addition to what it starts with [bytes]."""
    doing: str
    """What it does, as the subject of a sentence that begins with the file."""
    remedy: str
    """What the user can do about it."""


_is_limited = ContextVar("is_limited", default=False)
_files: ContextVar[tuple[Path, ...]] = ContextVar("files", default=())
_starting = threading.Lock()
# A fork saves a second of imports; on other systems, system libraries do not work in forks.
_processes: Any = multiprocessing.get_context("fork" if sys.platform == "linux" else "spawn")


@contextmanager
def limited_reading() -> Iterator[None]:
    """Let `read_file` read in child processes inside this context."""
    tokens = _is_limited.set(True), _files.set(())
    try:
        yield
    finally:
        _is_limited.reset(tokens[0])
        _files.reset(tokens[1])


def files_read() -> tuple[Path, ...]:
    """Files that `read_file` was called with inside the context of `limited_reading`."""
    return _files.get()


def read_file(read: Callable[..., T], path: Path, *arguments: Any) -> T:
    """Read a file with a function, in a child process if reading is limited.

    Args:
        read: Function at the top level of a module, called with the path and the arguments.
        path: The file.
        arguments: Further arguments of the function.

    Raises:
        FileUnreadError: The child process crashed, or exceeded a limit.
        Exception: Any exception of the function.
    """
    if _is_limited.get():
        _files.set((*_files.get(), path))
    limits = Limits(SECONDS, MEMORY, f"{path}: reading it", "is it damaged?")
    return in_limits(limits, read, path, *arguments)


def in_limits(limits: Limits, work: Callable[..., T], *arguments: Any) -> T:
    """Call a function on a file's content, in a child process if reading is limited.

    Args:
        limits: Limits of the child process.
        work: Function at the top level of a module.
        arguments: Arguments of the function.

    Raises:
        FileUnreadError: The child process crashed, or exceeded a limit.
        Exception: Any exception of the function.
    """
    if not _is_limited.get():
        return work(*arguments)
    with _starting:  # so that no other child process inherits this pipe, and keeps it open
        answers, sender = _processes.Pipe(duplex=False)
        process = _processes.Process(
            target=_serve, args=(sender, limits, work, arguments), daemon=True
        )
        process.start()
        sender.close()
    data = None
    try:
        with suppress(EOFError):  # the child process ended without an answer
            data = answers.recv_bytes() if answers.poll(limits.seconds + GRACE) else None
    finally:
        process.kill()
        process.join()
        answers.close()
    if not data:
        why = _why(limits, data, process.exitcode)
        raise FileUnreadError(printable(f"{limits.doing} {why}; {limits.remedy}"))
    is_raised, value = pickle.loads(data)  # noqa: S301, from a child process of ours
    if is_raised:
        raise pickle.loads(value)  # noqa: S301, as above
    result: T = value
    return result


def _why(limits: Limits, data: bytes | None, code: int) -> str:
    """Return why there is no answer, as the end of a sentence."""
    if data is not None:
        return f"takes more than {limits.memory / 1e9:g} GB of memory"
    if -code in {signal.SIGKILL, signal.SIGALRM}:
        return f"takes more than {limits.seconds:g} s, or more memory than the machine has"
    return f"ended its process ({signal.strsignal(-code) if code < 0 else f'exit code {code}'})"


def _serve(
    sender: Any, limits: Limits, work: Callable[..., object], arguments: tuple[Any, ...]
) -> None:
    """Run a function and send its result or exception; send nothing if it takes too much memory."""
    gc.disable()  # the child must not delete objects of the parent
    _is_limited.set(False)  # files that the function reads share its limits
    _set_limits(limits)
    try:
        answer = pickle.dumps((False, work(*arguments)), pickle.HIGHEST_PROTOCOL)
    except MemoryError:
        answer = b""
    except Exception as error:  # noqa: BLE001, the parent raises it
        answer = pickle.dumps((True, _pickled(error)))
    sender.send_bytes(answer)
    os._exit(0)  # without the parent's exit handlers


def _pickled(error: Exception) -> bytes:
    """Pickle an exception, or a plain substitute; add its traceback unless it is a GraspError."""
    trace = "".join(traceback.format_exception(error))
    error.__cause__ = error.__context__ = None  # they may not pickle
    try:
        if not isinstance(error, GraspError):
            error.add_note(trace)
        data = pickle.dumps(error)
        pickle.loads(data)  # noqa: S301, some exceptions pickle but do not unpickle
    except Exception:  # noqa: BLE001, as above
        plain = RuntimeError(f"{type(error).__name__}: {error}")
        plain.add_note(trace)
        return pickle.dumps(plain)
    return data


def _set_limits(limits: Limits) -> None:
    """Limit this process, discard its output, and let an interrupt end it silently."""
    faulthandler.disable()
    null = os.open(os.devnull, os.O_RDWR)
    for descriptor in range(3):
        os.dup2(null, descriptor)
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    if sys.platform != "win32":
        signal.signal(signal.SIGALRM, signal.SIG_DFL)
        signal.setitimer(signal.ITIMER_REAL, limits.seconds)
    if sys.platform == "linux":
        import resource

        pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[5])
        hard = resource.getrlimit(resource.RLIMIT_DATA)[1]
        limit = pages * resource.getpagesize() + int(limits.memory)
        limit = limit if hard == resource.RLIM_INFINITY else min(limit, hard)
        resource.setrlimit(resource.RLIMIT_DATA, (limit, hard))
