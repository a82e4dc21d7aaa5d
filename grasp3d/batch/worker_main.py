"""Main loop of a process that runs jobs for its parent.

A request is a pickle: the working folder, the module search path, the memory limit, and the pickled
call. An answer is a pickle as well: a code, and the pickled result or exception.
"""

import contextlib
import gc
import os
import pickle
import queue
import signal
import sys
import threading
from pathlib import Path
from typing import Any, BinaryIO

import cloudpickle

from grasp3d.batch.limits import set_allowed_memory
from grasp3d.system.limited_reading import pickled_error

VALUE, RAISED, NO_MEMORY = range(3)
"""Codes of an answer: before the pickled result or exception, or without more memory."""


def main() -> None:
    """Answer requests; `_receive` ends this process."""
    inbox: queue.SimpleQueue[Any] = queue.SimpleQueue()
    requests, answers = _reserve_pipes()
    _raise_kill_priority()
    threading.Thread(target=_receive, args=(requests, inbox), daemon=True).start()
    while True:
        pickle.dump(_answer(*inbox.get()), answers)
        answers.flush()
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


def _receive(requests: BinaryIO, inbox: "queue.SimpleQueue[Any]") -> None:
    """Queue requests; end this process and those that it started when the parent ends."""
    with contextlib.suppress(EOFError, pickle.UnpicklingError):
        while True:
            inbox.put(pickle.load(requests))  # noqa: S301, from the parent
    with contextlib.suppress(AttributeError):  # Windows has no groups
        os.killpg(0, signal.SIGKILL)
    os._exit(0)


def _answer(folder: str, paths: list[str], memory: float | None, call: bytes) -> tuple[int, bytes]:
    """The code of the answer, and what follows it."""
    try:
        sys.path.extend(path for path in paths if path not in sys.path)
        os.chdir(folder)  # that of an earlier job may have been removed
        set_allowed_memory(memory)
        function, arguments = pickle.loads(call)  # noqa: S301, from the parent
        return VALUE, cloudpickle.dumps(function(*arguments))
    except MemoryError:
        return NO_MEMORY, b""
    except Exception as error:  # noqa: BLE001, the parent raises it
        return RAISED, pickled_error(error, cloudpickle.dumps)
    except BaseException as error:  # noqa: BLE001, sys.exit must not end the process
        return RAISED, pickled_error(RuntimeError(f"{type(error).__name__}: {error}"))
