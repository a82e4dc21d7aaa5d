"""Main loop of a child process that runs function calls for its parent.

A request is its length and a pickle: the working folder, the module search path, the memory limit,
and the pickled call. An answer is its length, a code, and the pickled result or exception.
"""

import contextlib
import gc
import os
import pickle
import queue
import sys
import threading
import traceback
from pathlib import Path
from typing import BinaryIO

import cloudpickle
import psutil

with contextlib.suppress(ImportError):  # Windows has no resource limits
    import resource

from grasp3d.system.isolation.limits import set_allowed_memory
from grasp3d.system.isolation.monitoring import NO_MEMORY, RAISED, VALUE
from grasp3d.system.isolation.process import LENGTH

VIRTUAL_FACTOR = 1.5
"""Limit of virtual memory as a multiple of the memory limit, since not all of it is used."""

VIRTUAL_SPARE = 2e9
"""Virtual memory in addition, which libraries allocate but never use [bytes]."""


def main() -> None:
    """Answer requests until the input ends, then end this process and its descendants at once."""
    inbox: queue.SimpleQueue[bytes] = queue.SimpleQueue()
    requests, answers = _reserve_pipes()
    _raise_kill_priority()
    threading.Thread(target=_receive, args=(requests, inbox), daemon=True).start()
    while True:
        code, answer = _answer(inbox.get())
        answers.writelines([LENGTH.pack(1 + len(answer)), bytes([code]), answer])
        answers.flush()
        del answer
        gc.collect()
        gc.freeze()  # later collections skip what stays in memory, above all modules


def _reserve_pipes() -> tuple[BinaryIO, BinaryIO]:
    """Return the pipes to the parent; the called functions read and print to the null device."""
    requests, answers = os.fdopen(os.dup(0), "rb"), os.fdopen(os.dup(1), "wb")
    null = os.open(os.devnull, os.O_RDWR)
    os.dup2(null, 0)
    os.dup2(null, 1)
    return requests, answers


def _raise_kill_priority() -> None:
    """Make Linux kill this process first when memory runs out, since the parent can report it."""
    with contextlib.suppress(OSError):
        Path("/proc/self/oom_score_adj").write_text("900", encoding="ascii")


def _receive(requests: BinaryIO, inbox: "queue.SimpleQueue[bytes]") -> None:
    """Queue requests; end this process, even during a call, when the parent closes the pipe."""
    while len(head := requests.read(LENGTH.size)) == LENGTH.size:
        inbox.put(requests.read(*LENGTH.unpack(head)))
    for process in psutil.Process().children(recursive=True):
        with contextlib.suppress(psutil.Error):
            process.kill()
    os._exit(0)


def _answer(request: bytes) -> tuple[int, bytes]:
    """The code of the answer, and what follows it."""
    try:
        return VALUE, _result(request)
    except MemoryError:
        return NO_MEMORY, b""
    except Exception as error:  # noqa: BLE001, the parent raises it
        return RAISED, _failure(error)
    except BaseException as error:  # noqa: BLE001, sys.exit must not end the child process
        return RAISED, _failure(RuntimeError(f"{type(error).__name__}: {error}"))


def _result(request: bytes) -> bytes:
    """Make a call; returns the pickled result."""
    folder, paths, memory, call = pickle.loads(request)  # noqa: S301, from the parent
    sys.path.extend(path for path in paths if path not in sys.path)
    os.chdir(folder)  # that of an earlier call may have been removed
    _limit(memory)
    function, arguments = pickle.loads(call)  # noqa: S301
    result = function(*arguments)
    try:
        data: bytes = cloudpickle.dumps(result)
    except MemoryError:
        raise
    except Exception as error:
        raise TypeError(f"its result cannot be pickled: {error}") from error
    return data


def _failure(error: Exception) -> bytes:
    """Pickle an exception with its traceback; one that cannot be pickled becomes a RuntimeError."""
    trace = "".join(traceback.format_exception(error))
    try:
        error.add_note(trace)
        data: bytes = cloudpickle.dumps(error)
        pickle.loads(data)  # noqa: S301, some exceptions pickle but do not unpickle
    except Exception:  # noqa: BLE001, as above
        plain = RuntimeError(f"{type(error).__name__}: {error}")
        plain.add_note(trace)
        return pickle.dumps(plain)
    return data


def _limit(memory: float | None) -> None:
    """Set the memory limit of the call [GB], and a limit of virtual memory above it."""
    set_allowed_memory(memory)
    with contextlib.suppress(NameError, OSError, ValueError, AttributeError):
        _, hard = resource.getrlimit(resource.RLIMIT_DATA)
        limit = (
            resource.RLIM_INFINITY
            if memory is None
            else int(VIRTUAL_FACTOR * 1e9 * memory + VIRTUAL_SPARE)
        )
        resource.setrlimit(resource.RLIMIT_DATA, (limit, hard))
