"""What a call may take, and how the work in the child learns of it."""

from collections.abc import Callable
from dataclasses import dataclass


def never() -> bool:
    """Nobody takes the call back."""
    return False


@dataclass(frozen=True)
class Limits:
    """What ends a call."""

    memory: float | None = None
    """Memory of the child and of its own children together [GB]; none: any."""
    seconds: float | None = None
    """Time for the call [s]; none: any."""
    cancelled: Callable[[], bool] = never
    """Asked again and again, in another thread: whether nobody waits any more."""


class NeedsMemory(Exception):  # noqa: N818, no error: the work was not begun
    """Raised by work that would take more memory than it may.

    It is no `GraspError`, since nothing is wrong with what was given: with more memory it works.
    """

    def __init__(self, gigabytes: float) -> None:
        super().__init__(gigabytes)
        self.gigabytes = gigabytes

    def __str__(self) -> str:
        return f"needs about {round(self.gigabytes, 2):g} GB of memory, more than it may take"


_allowed: float | None = None


def allowed_memory() -> float | None:
    """Memory that this process may take for the call it is at [GB]; none: any."""
    return _allowed


def allow_memory(memory: float | None) -> None:
    """Say what `allowed_memory` tells from now on.

    Args:
        memory: Of the whole process with its children [GB]; none: any.
    """
    global _allowed  # noqa: PLW0603
    _allowed = memory
