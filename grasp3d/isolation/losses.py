"""What ends a piece of work in another process, and how it is told."""

import signal
from enum import StrEnum

from grasp3d.errors import GraspError

_CRASHES = {"SIGSEGV", "SIGABRT", "SIGBUS", "SIGFPE", "SIGILL", "SIGTRAP", "SIGSYS"}
"""Signals that a process brings upon itself."""


class Loss(StrEnum):
    """What ended it."""

    CRASHED = "crashed"
    KILLED = "killed"
    """From outside; on Linux by the system that runs out of memory, most of the time."""
    OUT_OF_MEMORY = "out of memory"
    OUT_OF_TIME = "out of time"
    CANCELLED = "cancelled"


class Lost(GraspError):  # noqa: N818, the word for it in rows and reports too
    """A call whose process did not come back with an answer."""

    def __init__(self, kind: Loss, reason: str) -> None:
        super().__init__(kind, reason)
        self.kind = kind
        self.reason = reason
        """A sentence without its subject."""

    def __str__(self) -> str:
        return self.reason


def lost_by_exit(code: int) -> Lost:
    """Say what an exit code tells of a process that should still be there.

    Args:
        code: As `subprocess` has it: below zero the signal that ended the process.
    """
    if code >= 0:
        return Lost(Loss.CRASHED, f"ended its process without an answer (exit code {code})")
    known = {item.value: item.name for item in signal.Signals}
    name = known.get(-code, "")
    told = (signal.strsignal(-code) or f"signal {-code}").lower()
    if name in _CRASHES:
        return Lost(Loss.CRASHED, f"crashed ({told})")
    if name == "SIGKILL":
        return Lost(Loss.KILLED, "was killed from outside, most likely for want of memory")
    return Lost(Loss.KILLED, f"was killed from outside ({told})")


def unexpected(error: Exception) -> str:
    """Say in one sentence what nobody foresaw."""
    told = " ".join(f"{type(error).__name__}: {error}".split())
    return f"unexpected {told}; please report this mesh"
