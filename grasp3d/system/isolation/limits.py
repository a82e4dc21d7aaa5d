"""Limits of a call in a child process, and the memory that the call or the machine has."""

import contextlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

_CONTROL_GROUPS = Path("/sys/fs/cgroup")

_LIMITS = ("memory.max", "memory.high", "memory/memory.limit_in_bytes")
"""Files with the limits of a control group: of version 2, and of version 1."""


def never() -> bool:
    """Return False: the call is never cancelled."""
    return False


@dataclass(frozen=True)
class Limits:
    """Limits of a call; the child process is ended when one is exceeded."""

    memory: float | None = None
    """Memory of the child process and its descendants together [GB]; none: no limit."""
    seconds: float | None = None
    """Duration of the call [s]; none: no limit."""
    cancelled: Callable[[], bool] = never
    """Polled in another thread: whether the result is no longer needed."""


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
    """Return the memory limit of the current call in this process [GB]; None: no limit."""
    return _allowed


def set_allowed_memory(memory: float | None) -> None:
    """Set the value that `allowed_memory` returns.

    Args:
        memory: Limit of this process and its descendants together [GB]; none: no limit.
    """
    global _allowed  # noqa: PLW0603
    _allowed = memory


def machine_memory() -> float:
    """Return the memory of the machine, or the limit of a container, if that is lower [GB]."""
    import psutil

    limits = [float(psutil.virtual_memory().total)]
    for name in _LIMITS:
        with contextlib.suppress(OSError, ValueError):  # none, or the word max
            limits.append(float((_CONTROL_GROUPS / name).read_text(encoding="ascii")))
    return min(limit for limit in limits if limit > 0.0) / 1e9
