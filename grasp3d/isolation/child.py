"""The process that calls functions for another one.

A request is its length and a pickle: the folder to work in and where modules are found, the memory
that is allowed, and the pickled call. The answer is its length and a pickle: a kind and a value.
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

with contextlib.suppress(ImportError):  # Windows knows no limits
    import resource

from grasp3d.isolation.calls import LENGTH
from grasp3d.isolation.limits import allow_memory
from grasp3d.isolation.packing import dumped

NET = 1.5
"""Share of the allowed memory that may be asked for at once: what is not touched is not taken."""

SPARE = 2e9
"""Bytes beside it for what libraries ask for and never touch."""


def main() -> None:
    """Answer requests until there are no more, then end at once, with all processes below."""
    inbox: queue.SimpleQueue[bytes] = queue.SimpleQueue()
    requests, answers = _own_pipes()
    _volunteer()
    threading.Thread(target=_receive, args=(requests, inbox), daemon=True).start()
    while True:
        answer = _answer(inbox.get())
        answers.writelines([LENGTH.pack(len(answer)), answer])
        answers.flush()
        del answer
        gc.collect()
        gc.freeze()  # what stays, modules above all, need not be looked through again


def _own_pipes() -> tuple[BinaryIO, BinaryIO]:
    """Keep the pipes from whatever the functions read or print."""
    requests, answers = os.fdopen(os.dup(0), "rb"), os.fdopen(os.dup(1), "wb")
    nothing = os.open(os.devnull, os.O_RDWR)
    os.dup2(nothing, 0)
    os.dup2(nothing, 1)
    return requests, answers


def _volunteer() -> None:
    """Be the first that Linux ends when its memory is full: the parent can tell what happened."""
    with contextlib.suppress(OSError):
        Path("/proc/self/oom_score_adj").write_text("900", encoding="ascii")


def _receive(requests: BinaryIO, inbox: "queue.SimpleQueue[bytes]") -> None:
    """Hand requests on; the end of the input is the end of the parent, even amid a call."""
    while len(head := requests.read(LENGTH.size)) == LENGTH.size:
        inbox.put(requests.read(*LENGTH.unpack(head)))
    for process in psutil.Process().children(recursive=True):
        with contextlib.suppress(psutil.Error):
            process.kill()
    os._exit(0)


def _answer(request: bytes) -> bytes:
    try:
        return dumped(("value", _called(request)))
    except MemoryError:
        return pickle.dumps(("memory", None))
    except Exception as error:  # noqa: BLE001, whatever it is: the parent raises it
        return _failure(error)
    except BaseException as error:  # noqa: BLE001, sys.exit is for a process, not for a call
        return _failure(RuntimeError(f"{type(error).__name__}: {error}"))


def _called(request: bytes) -> object:
    (folder, paths), memory, call = pickle.loads(request)  # noqa: S301, from the parent
    sys.path.extend(path for path in paths if path not in sys.path)
    if folder != os.getcwd():  # noqa: PTH109, compared as text
        os.chdir(folder)
    _limit(memory)
    function, arguments = pickle.loads(call)  # noqa: S301
    return function(*arguments)


def _failure(error: Exception) -> bytes:
    """Pickle an exception so that the parent can read it, whatever is in it."""
    told = "".join(traceback.format_exception(error))
    try:
        error.add_note(told)
        data: bytes = cloudpickle.dumps(("raised", error))
        pickle.loads(data)  # noqa: S301, some can be written only
    except Exception:  # noqa: BLE001, as above
        plain = RuntimeError(f"{type(error).__name__}: {error}")
        plain.add_note(told)
        return pickle.dumps(("raised", plain))
    return data


def _limit(memory: float | None) -> None:
    """Tell the work what it may take, and refuse it at once far more than that [GB]."""
    allow_memory(memory)
    with contextlib.suppress(NameError, OSError, ValueError, AttributeError):
        _, hard = resource.getrlimit(resource.RLIMIT_DATA)
        most = resource.RLIM_INFINITY if memory is None else int(NET * 1e9 * memory + SPARE)
        resource.setrlimit(resource.RLIMIT_DATA, (most, hard))
