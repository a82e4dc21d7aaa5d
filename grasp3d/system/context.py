"""Context of a call: number of threads, progress callback, and whether warnings are errors.

It is a context variable: called functions share the context, and another thread starts a new one.
"""

import os
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, replace
from numbers import Integral
from typing import Any

from grasp3d.errors import SettingError, WarningError

Progress = Callable[[float], None]
"""Called with the fraction of work done, from 0 to 1; an exception that it raises ends the work."""


@dataclass(frozen=True)
class _Context:
    """State that all functions of a call share."""

    threads: int | None = None
    progress: Progress | None = None
    strict: bool = False


_NOTHING_STATED = _Context()
_context = ContextVar("grasp3d", default=_NOTHING_STATED)


@contextmanager
def _changed(**changes: object) -> Iterator[None]:
    """Change the context inside a `with` block."""
    token = _context.set(replace(_context.get(), **changes))  # type: ignore[arg-type]
    try:
        yield
    finally:
        _context.reset(token)


@contextmanager
def running(
    *, threads: int | None = None, progress: Progress | None = None, strict: bool | None = None
) -> Iterator[None]:
    """Set the threads, the progress callback and the strictness of the computations inside.

    A nested `running` changes only what it states. By default there are as many threads as
    processors, no progress is reported, and warnings are not errors.

        with grasp3d.running(threads=4, progress=print):
            labels = grasp3d.label_surface("mug.stl")

    Args:
        threads: Threads to use, 1 or more; results do not depend on it. A value that is computed
            when first read uses the threads stated where it is read. None: unchanged.
        progress: Called by each computation with the fraction done, from 0 to 1; an exception that
            it raises ends the computation. None: unchanged.
        strict: Whether a computation whose result would have warnings raises `WarningError`
            instead, with their text. None: unchanged.

    Raises:
        SettingError: `threads` is not a whole number of at least 1.
    """
    is_count = isinstance(threads, Integral) and not isinstance(threads, bool) and threads >= 1
    if threads is not None and not is_count:
        raise SettingError(f"threads must be a whole number, at least 1; got {threads!r}")
    stated = {"threads": threads, "progress": progress, "strict": strict}
    with _changed(**{name: value for name, value in stated.items() if value is not None}):
        yield


def is_strict() -> bool:
    """Whether warnings are errors."""
    return _context.get().strict


def refuse_warnings(texts: Iterable[str]) -> None:
    """Raise warnings as one error if the context is strict.

    Args:
        texts: The warnings, one sentence each.

    Raises:
        WarningError: There are warnings, and the context is strict.
    """
    if is_strict() and (text := "; ".join(texts)):
        raise WarningError(text)


def available_processors() -> int:
    """Return how many processors this process may use.

    A container or a cluster job may allow fewer than the machine has.
    """
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def thread_count() -> int:
    """The number of threads that a computation uses."""
    return _context.get().threads or available_processors()


def in_threads(
    work: Callable[[slice, Any], object],
    count: int,
    chunk: int,
    scratch: Callable[[], Any] = object,
) -> None:
    """Run a function on slices of rows in several threads.

    Args:
        work: Called with a slice of rows and the scratch arrays of its thread.
        count: Number of rows.
        chunk: Number of rows of a slice.
        scratch: Makes the scratch arrays of a thread.
    """
    starts = range(0, count, chunk)
    threads = max(1, min(thread_count(), len(starts)))

    def run(number: int) -> None:
        own = scratch()
        for start in starts[number::threads]:
            work(slice(start, min(start + chunk, count)), own)

    if threads == 1:
        run(0)
        return
    with ThreadPoolExecutor(threads) as pool:
        list(pool.map(run, range(threads)))


def current_progress() -> Progress:
    """Progress callback of the running computation, or of its current part."""
    return _context.get().progress or _ignore


def _ignore(fraction: float) -> None:
    """Progress callback that reports nothing."""


def report_progress(fraction: float) -> None:
    """Report the progress of the running computation, or of its current part.

    Args:
        fraction: Fraction done, from 0 to 1.
    """
    current_progress()(fraction)


@contextmanager
def within(start: float, end: float) -> Iterator[None]:
    """Run one part of a computation, inside which progress is reported as a fraction of the part.

    Args:
        start: Fraction of the whole at which the part starts.
        end: Fraction of the whole at which it ends.
    """
    whole = current_progress()
    with running(progress=lambda fraction: whole(start + (end - start) * fraction)):
        yield


@contextmanager
def unreported() -> Iterator[None]:
    """Run a part of a computation without reporting its progress."""
    with _changed(progress=None):
        yield
