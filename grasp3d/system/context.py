"""The context of a call: threads, progress, whether warnings are errors.

It is a context variable: what a function calls has the same context, another thread a new one.
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
"""Called with the fraction of the work that is done, from 0 to 1; what it raises ends the work."""


@dataclass(frozen=True)
class _Context:
    """What all functions of a call share."""

    threads: int | None = None
    progress: Progress | None = None
    strict: bool = False


_NOTHING_STATED = _Context()
_context = ContextVar("grasp3d", default=_NOTHING_STATED)


@contextmanager
def _changed(**changes: object) -> Iterator[None]:
    """Change the context of what is called inside."""
    token = _context.set(replace(_context.get(), **changes))  # type: ignore[arg-type]
    try:
        yield
    finally:
        _context.reset(token)


@contextmanager
def running(
    *, threads: int | None = None, progress: Progress | None = None, strict: bool | None = None
) -> Iterator[None]:
    """State how many threads the computations inside use, and follow their progress.

    A `running` inside another one changes what it states and keeps the rest. Without any there are
    as many threads as processors, no progress is reported, and warnings are not errors.

        with grasp3d.running(threads=4, progress=print):
            labels = grasp3d.label_surface("mug.stl")

    Args:
        threads: Threads to use, 1 or more; no result depends on it. A value that is computed when
            it is first read uses the threads stated there. None: unchanged.
        progress: Called by each computation with the fraction that is done, from 0 to 1; what it
            raises ends the computation. None: as outside.
        strict: Whether a computation whose result would have warnings raises `WarningError`
            instead, with their text. None: as outside.

    Raises:
        SettingError: `threads` is no whole number from 1 on.
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
    """Raise warnings where they are errors.

    Args:
        texts: The warnings, one sentence each.

    Raises:
        WarningError: There are some, and the context is strict.
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
    """Run work on slices of rows in threads.

    Args:
        work: Called with rows and the scratch arrays of its thread.
        count: Number of rows.
        chunk: Rows that are worked on at a time.
        scratch: Makes scratch arrays.
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
    """The function that takes the progress of the running computation, or of the running part."""
    return _context.get().progress or _ignore


def _ignore(fraction: float) -> None:
    """Where no progress is reported."""


def report_progress(fraction: float) -> None:
    """Report the progress of the running computation, or of the running part.

    Args:
        fraction: Fraction that is done, from 0 to 1.
    """
    current_progress()(fraction)


@contextmanager
def within(start: float, end: float) -> Iterator[None]:
    """Run one part of a computation: what is called inside reports the progress of the part.

    Args:
        start: Fraction of the whole at which the part starts.
        end: Fraction of the whole at which it ends.
    """
    whole = current_progress()
    with running(progress=lambda fraction: whole(start + (end - start) * fraction)):
        yield


@contextmanager
def unreported() -> Iterator[None]:
    """Run a part whose progress is not reported."""
    with _changed(progress=None):
        yield
