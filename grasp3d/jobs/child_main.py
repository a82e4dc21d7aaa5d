"""Main loop of a process that makes calls for its parent.

A request is a pickled function. An answer is its pickled result, or the reason why there is none.
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

from grasp3d.system.names import describe_unexpected


def main() -> None:
    """Answer requests; `_receive` ends this process."""
    inbox: queue.SimpleQueue[bytes] = queue.SimpleQueue()
    requests, answers = os.fdopen(os.dup(0), "rb"), os.fdopen(os.dup(1), "wb")
    null = os.open(os.devnull, os.O_RDWR)  # called functions read and print nothing
    os.dup2(null, 0)
    os.dup2(null, 1)
    if sys.platform == "linux":  # killed first when memory runs out; the parent reports it
        with contextlib.suppress(OSError):
            Path("/proc/self/oom_score_adj").write_text("900", encoding="ascii")
    threading.Thread(target=_receive, args=(requests, inbox), daemon=True).start()
    while True:
        pickle.dump(_answer(inbox.get()), answers)
        answers.flush()
        gc.collect()
        gc.freeze()  # later collections skip what stays in memory, mainly modules


def _receive(requests: BinaryIO, inbox: "queue.SimpleQueue[Any]") -> None:
    """Queue requests; when the parent ends, end this process and those that it has started."""
    with contextlib.suppress(EOFError, pickle.UnpicklingError):
        while True:
            inbox.put(pickle.load(requests))  # noqa: S301, from the parent
    with contextlib.suppress(AttributeError):  # Windows has no groups
        os.killpg(0, signal.SIGKILL)
    os._exit(0)


def _answer(work: bytes) -> bytes | str:
    try:
        answer: bytes = cloudpickle.dumps(pickle.loads(work)())  # noqa: S301, from the parent
    except BaseException as error:  # noqa: BLE001, sys.exit must not end the process
        return describe_unexpected(error)
    return answer
