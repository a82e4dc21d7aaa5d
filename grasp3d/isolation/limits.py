"""Limits of a call in a child process, and access to the memory limit inside the child."""

from collections.abc import Callable
from dataclasses import dataclass


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
