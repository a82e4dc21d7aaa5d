"""The memory that a job of a batch may take, and how jobs fail."""

import contextlib
import signal
from enum import StrEnum
from pathlib import Path

import psutil

from grasp3d.errors import GraspError

_CONTROL_GROUPS = Path("/sys/fs/cgroup")

_LIMITS = ("memory.max", "memory.high", "memory/memory.limit_in_bytes")
"""Files with the limits of a control group: of version 2, and of version 1."""

_CRASHES = {"SIGSEGV", "SIGABRT", "SIGBUS", "SIGFPE", "SIGILL", "SIGTRAP", "SIGSYS"}
"""Signals that are raised by an error of the process itself."""


class NeedsMemory(Exception):  # noqa: N818, not an error: the work was not started
    """Raised instead of starting work that would exceed the memory limit.

    It is not a `GraspError`, since the input is valid: with more memory the work succeeds.
    """

    def __init__(self, gigabytes: float) -> None:
        super().__init__(gigabytes)
        self.gigabytes = gigabytes

    def __str__(self) -> str:
        return f"needs about {round(self.gigabytes, 2):g} GB of memory, more than its limit"


_allowed: float | None = None


def allowed_memory() -> float | None:
    """Return the memory limit of the current job in this process [GB]; None: no limit."""
    return _allowed


def set_allowed_memory(memory: float | None) -> None:
    """Set the value that `allowed_memory` returns.

    Args:
        memory: Limit of this process [GB]; none: no limit.
    """
    global _allowed  # noqa: PLW0603
    _allowed = memory


def machine_memory() -> float:
    """Return the memory of the machine, or the limit of a container, if that is lower [GB]."""
    limits = [float(psutil.virtual_memory().total)]
    for name in _LIMITS:
        with contextlib.suppress(OSError, ValueError):  # none, or the word max
            limits.append(float((_CONTROL_GROUPS / name).read_text(encoding="ascii")))
    return min(limit for limit in limits if limit > 0.0) / 1e9


class CallFailure(StrEnum):
    """Why a job ended without a result."""

    CRASHED = "crashed"
    KILLED = "killed"
    """Ended from outside; on Linux usually by the kernel when memory runs out."""
    OUT_OF_MEMORY = "out of memory"
    OUT_OF_TIME = "out of time"
    CANCELLED = "cancelled"


class CallFailedError(GraspError):
    """A job ended without a result."""

    def __init__(self, kind: CallFailure, reason: str) -> None:
        super().__init__(kind, reason)
        self.kind = kind
        self.reason = reason
        """A sentence without its subject."""

    def __str__(self) -> str:
        return self.reason


def failure_from_exit_code(code: int) -> CallFailedError:
    """Return the error for the exit code of a process that ended during a job.

    Args:
        code: As `subprocess` reports it: below zero the negative number of the signal that ended
            the process.
    """
    if code >= 0:
        return CallFailedError(
            CallFailure.CRASHED, f"ended its process without a result (exit code {code})"
        )
    names = {item.value: item.name for item in signal.Signals}
    name = names.get(-code, "")
    description = (signal.strsignal(-code) or f"signal {-code}").lower()
    if name in _CRASHES:
        return CallFailedError(CallFailure.CRASHED, f"crashed ({description})")
    if name == "SIGKILL":
        return CallFailedError(
            CallFailure.KILLED, "was killed from outside, most likely for lack of memory"
        )
    return CallFailedError(CallFailure.KILLED, f"was killed from outside ({description})")
