"""Progress callbacks of long computations."""

from collections.abc import Callable

Progress = Callable[[float], None]
"""Called with the fraction of the work that is done, from 0 to 1."""


def ignore(fraction: float) -> None:
    """Do nothing: the callback where progress is not reported."""


def within(progress: Progress, start: float, end: float) -> Progress:
    """Return the callback of one part of the work.

    Args:
        progress: Callback of the whole work.
        start: Fraction of the whole at which the part starts.
        end: Fraction of the whole at which it ends.
    """
    return lambda fraction: progress(start + (end - start) * fraction)
