"""Cheap tasks that fail in all ways in which meshes can fail; the child imports nothing heavy."""

import ctypes
import os
import signal
import sys
import threading
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from grasp3d.errors import GraspError
from grasp3d.system.context import thread_count

TIMINGS = frozenset({"seconds", "seconds_reading", "seconds_labelling", "seconds_writing"})
"""Columns of a library that differ between runs."""


def raise_(error: BaseException) -> None:
    raise error


class NotUnpicklableError(Exception):
    """An error that can be pickled but not unpickled."""

    def __init__(self, one: str, two: str) -> None:
        super().__init__(one + two)


FAULTS: dict[str, tuple[Callable[[], Any], str]] = {
    "crash": (lambda: ctypes.string_at(0), "crashed or was killed (segmentation fault)"),
    "killed": (
        lambda: os.kill(os.getpid(), signal.SIGKILL),
        "was killed from outside, most likely for lack of memory",
    ),
    "hang": (  # in machine code, while no other thread of Python runs
        lambda: ctypes.PyDLL(None).sleep(60), "took longer than 6 s and was ended",
    ),
    "memory": (
        lambda: [np.ones(1_250_000) for _ in range(2000)],
        "took more than 0.5 GB of memory and was ended; fewer --workers leave more to each",
    ),
    "too much": (
        lambda: np.ones(10**15), "requested more memory than is available",
    ),
    "quits": (lambda: os._exit(3), "ended its process without a result (exit code 3)"),
    "refuses": (lambda: raise_(GraspError("no such thing")), "no such thing"),
    "raises": (
        lambda: raise_(ValueError("an error of\ntwo lines")),
        "unexpected ValueError: an error of two lines; please report this mesh",
    ),
    "exits": (
        lambda: sys.exit(2), "unexpected SystemExit: 2; please report this mesh",
    ),
    "does not pickle": (
        threading.Lock,
        "unexpected TypeError: cannot pickle '_thread.lock' object; please report this mesh",
    ),
    "pickles in part": (
        lambda: raise_(NotUnpicklableError("one", "two")),
        "unexpected NotUnpicklableError: onetwo; please report this mesh",
    ),
}  # fmt: skip
"""What a job with each name does, and the error that results."""


def work(job: str, pause: float = 0.0) -> Any:
    """Fail as the job's name says, or return the process, its session, its folder and threads."""
    print("printed text", flush=True)  # noqa: T201, discarded
    if job in FAULTS:
        return FAULTS[job][0]()
    if job == "kills its worker":
        os.kill(os.getppid(), signal.SIGKILL)
        time.sleep(60.0)
    time.sleep(pause if job.startswith("well") else 60.0)
    return os.getpid(), os.getsid(0), os.getcwd(), thread_count()  # noqa: PTH109
