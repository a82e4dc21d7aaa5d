"""Telling whoever waits how far a long piece of work has come."""

from collections.abc import Callable

Progress = Callable[[float], None]
"""Takes the share of the work that is done, from 0 to 1."""


def ignore(share: float) -> None:
    """Report progress to nobody."""


def within(progress: Progress, start: float, end: float) -> Progress:
    """Give a part of the work, from one share of the whole to another, a progress of its own."""
    return lambda share: progress(start + (end - start) * share)
