"""Time limit of a command's computations, with a message that names the step that took the time."""

import _thread
import math
import os
import signal
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass

from grasp3d.errors import GraspError, SettingError
from grasp3d.system.context import StepTimes, recorded_steps
from grasp3d.system.names import printable

GRACE = 3.0
"""Time after which a computation that was interrupted is ended with its process [s]."""

BAD_INPUT = 2


class TimeLimitError(GraspError):
    """A command's computations took longer than its time limit."""


@dataclass(frozen=True, kw_only=True)
class TimeLimited:
    """The option of commands whose time is limited."""

    timeout: float | None = 3600.0
    """Time limit for reading, repairing and labelling the mesh; none: no limit."""

    def __post_init__(self) -> None:
        if self.timeout is not None and not (self.timeout > 0.0 and math.isfinite(self.timeout)):
            raise SettingError(f"timeout must be a finite time above 0 s; got {self.timeout:g}")


@contextmanager
def time_limit(seconds: float | None, what: str) -> Iterator[None]:
    """Limit the time of the context, which writes no files.

    When the time is over, the main thread is interrupted. If it is still in compiled code after a
    while, the message is printed and this process is ended, with its child processes.

    Args:
        seconds: The limit; None: no limit.
        what: Name of the mesh, for the message.

    Raises:
        TimeLimitError: The time was over.
    """
    if seconds is None:
        yield
        return
    with recorded_steps() as times, _interrupts_raised():
        watch = _Watch(seconds, what, times)
        try:
            yield
        except KeyboardInterrupt:
            if not watch.expired:
                raise
        finally:
            watch.stop()
        if watch.expired:
            raise TimeLimitError(watch.message)


@contextmanager
def _interrupts_raised() -> Iterator[None]:
    """Let SIGINT raise KeyboardInterrupt in the main thread, whatever libraries made of it."""
    before = signal.getsignal(signal.SIGINT)
    replaced = callable(before) and before is not signal.default_int_handler
    if replaced:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        yield
    finally:
        if replaced:
            signal.signal(signal.SIGINT, before)


class _Watch:
    """A thread that interrupts the main thread when a time is over."""

    def __init__(self, seconds: float, what: str, times: StepTimes) -> None:
        self.expired = False
        self.message = ""
        self._seconds, self._what, self._times = seconds, what, times
        self._done = threading.Event()
        self._lock = threading.Lock()
        threading.Thread(target=self._watch, daemon=True).start()

    def stop(self) -> None:
        """Stop watching; an interrupt that is already sent is received here."""
        self._done.set()
        with suppress(KeyboardInterrupt), self._lock:
            if self.expired:
                time.sleep(0.1)

    def _watch(self) -> None:
        if self._done.wait(self._seconds):
            return
        with self._lock:
            if self._done.is_set():
                return
            self.message = (
                f"{self._what}: took longer than {self._seconds:g} s (--timeout): {self._times}; "
                "simplify the mesh, or give a longer --timeout"
            )
            self.expired = True
            _thread.interrupt_main()
        if not self._done.wait(GRACE):
            self._end_process()

    def _end_process(self) -> None:
        """Print the message and end this process, whatever its main thread does."""
        from grasp3d.system.isolation.process import end_all

        with suppress(OSError, ValueError):
            print(f"\ngrasp3d: {printable(self.message)}", file=sys.stderr, flush=True)  # noqa: T201
        end_all()
        os._exit(BAD_INPUT)
