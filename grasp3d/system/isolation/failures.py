"""The reasons why a child process ends without a result, and their messages."""

import signal
from enum import StrEnum

from grasp3d.errors import GraspError

_CRASHES = {"SIGSEGV", "SIGABRT", "SIGBUS", "SIGFPE", "SIGILL", "SIGTRAP", "SIGSYS"}
"""Signals that are raised by an error of the process itself."""


class CallFailure(StrEnum):
    """Why a call in a child process failed."""

    CRASHED = "crashed"
    KILLED = "killed"
    """Ended from outside; on Linux usually by the kernel when memory runs out."""
    OUT_OF_MEMORY = "out of memory"
    OUT_OF_TIME = "out of time"
    CANCELLED = "cancelled"


class CallFailedError(GraspError):
    """A call in a child process ended without a result."""

    def __init__(self, kind: CallFailure, reason: str) -> None:
        super().__init__(kind, reason)
        self.kind = kind
        self.reason = reason
        """A sentence without its subject."""

    def __str__(self) -> str:
        return self.reason


def failure_from_exit_code(code: int) -> CallFailedError:
    """Return the error for the exit code of a child process that ended during a call.

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


def describe_unexpected(error: Exception) -> str:
    """Return a one-line message for an exception that should not occur."""
    description = " ".join(f"{type(error).__name__}: {error}".split())
    return f"unexpected {description}; please report this mesh"
