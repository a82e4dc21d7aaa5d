"""Reusable child processes, each of which runs the main loop of `child`.

They are spawned, not forked, since locks of threads and compilers do not survive a fork.
"""

import atexit
import contextlib
import os
import signal
import struct
import subprocess
import sys
import threading
import time
import weakref
from pathlib import Path
from typing import TYPE_CHECKING, cast

import grasp3d

if TYPE_CHECKING:
    import io
    from collections.abc import Callable

LENGTH = struct.Struct("<Q")
"""Format of the length that precedes each request and each answer."""

IDLE = 30.0
"""Time after which an idle child process is ended [s]."""

_ONE_THREAD = {
    f"{library}_NUM_THREADS": "1"
    for library in ("NUMBA", "OMP", "OPENBLAS", "MKL", "NUMEXPR", "VECLIB_MAXIMUM")
}
"""Environment for one thread per child process, since each processor has a child already."""

_START = """
import gc, importlib, sys, typing
gc.disable()  # nothing that modules make is garbage
package, needed, *paths = sys.argv[1:]
sys.path.insert(0, package)
import grasp3d
sys.path[:] = sys.path[1:] + [path for path in paths if path not in sys.path[1:]]
from grasp3d.system.isolation.child import main
importlib.import_module(needed)
gc.enable()
main()
"""
"""Start code of a child: imports this process's own copy of the package, and the module that the
first call needs. Modules in the package's parent folder or in the working folder must not shadow
those of Python."""


class ChildProcess:
    """A child process, and the pipes to it; `needed`: a module that its first call needs."""

    def __init__(self, needed: str = "grasp3d") -> None:
        package = str(Path(grasp3d.__file__).parents[1])
        self.process = subprocess.Popen(  # noqa: S603, the command contains no user input
            [sys.executable, *_flags(), "-c", _START, package, needed, *_paths()],
            bufsize=0,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            start_new_session=True,  # Ctrl-C must reach this process only
            cwd=package,
            env={**os.environ, **_ONE_THREAD},
        )
        self.requests = cast("io.RawIOBase", self.process.stdin)
        self.answers = cast("io.RawIOBase", self.process.stdout)
        self.idle_since = time.monotonic()
        self.used = False
        """Whether it has answered a request."""
        self.kill_descendants: Callable[[], None] | None = None
        """Set during a request: ends descendants, also those in sessions of their own."""
        _children.add(self)

    @property
    def alive(self) -> bool:
        """Whether the process is running."""
        return self.process.poll() is None

    def send(self, data: bytes) -> None:
        """Write a request completely."""
        rest = memoryview(LENGTH.pack(len(data)) + data)
        while rest:
            rest = rest[self.requests.write(rest) :]

    def receive(self) -> bytearray:
        """Read an answer.

        Raises:
            EOFError: The process ended before it was complete.
        """
        return self._read(*LENGTH.unpack(self._read(LENGTH.size)))

    def _read(self, count: int) -> bytearray:
        """Read a number of bytes."""
        data = bytearray(count)
        rest = memoryview(data)
        while rest:
            size = self.answers.readinto(rest)
            if not size:
                raise EOFError
            rest = rest[size:]
        return data

    def kill(self) -> None:
        """End the process and its descendants."""
        if self.kill_descendants is not None:
            self.kill_descendants()
        if self.process.returncode is not None:  # the id may belong to another process by now
            return
        if hasattr(os, "killpg"):
            with contextlib.suppress(OSError):
                os.killpg(self.process.pid, signal.SIGKILL)
        self.process.kill()

    def close(self) -> int:
        """End the process, and return its exit code; unchanged if it had ended before."""
        self.kill()
        self.requests.close()
        self.answers.close()
        _children.discard(self)
        return self.process.wait()

    def detach(self) -> None:
        """Close the pipes without ending the process; for forks of the parent process."""
        self.requests.close()
        self.answers.close()
        self.process.returncode = 0  # the fork is not its parent and must not wait for it


class ProcessPool:
    """Child processes, of which idle ones are reused before others start."""

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forget all children, after a fork."""
        self._lock = threading.Lock()
        self._idle: list[ChildProcess] = []
        self._timer: threading.Timer | None = None

    def take(self, *, fresh: bool = False) -> ChildProcess:
        """Return a running child; the caller gives it back or closes it.

        Args:
            fresh: Whether to start a new process in any case.

        Raises:
            OSError: No process can be started.
        """
        while True:
            with self._lock:
                child = self._idle.pop() if self._idle and not fresh else None
            if child is None:
                return ChildProcess()
            if child.alive:
                return child
            child.close()

    def begin(self, needed: str) -> None:
        """Start a child that imports a module and then waits for a request."""
        with contextlib.suppress(OSError):  # the request will say that no process can be started
            self.give_back(ChildProcess(needed))

    def give_back(self, child: ChildProcess) -> None:
        """Return a child to the pool for the next request."""
        child.idle_since = time.monotonic()
        with self._lock:
            self._idle.append(child)
            self._schedule_end()

    def end_idle(self) -> None:
        """End all idle children."""
        self._end(float("inf"))

    def _schedule_end(self) -> None:
        """Start the timer that ends idle children; the caller holds the lock."""
        if self._timer is None and self._idle:
            self._timer = threading.Timer(IDLE, self._end_old)
            self._timer.daemon = True
            self._timer.start()

    def _end_old(self) -> None:
        self._end(time.monotonic() - IDLE)
        with self._lock:
            self._timer = None
            self._schedule_end()

    def _end(self, before: float) -> None:
        with self._lock:
            old = [child for child in self._idle if child.idle_since < before]
            self._idle = [child for child in self._idle if child.idle_since >= before]
        for child in old:
            child.close()


_children: "weakref.WeakSet[ChildProcess]" = weakref.WeakSet()
pool = ProcessPool()
"""The children of this process."""


def _flags() -> list[str]:
    return ["-I"] if sys.flags.isolated else ["-P"]


def _paths() -> list[str]:
    """Return the module search path of this process without its working folder."""
    with contextlib.suppress(OSError):
        folder = os.getcwd()  # noqa: PTH109, compared as text
        return [path for path in sys.path if Path(path).is_absolute() and path != folder]
    return []


def end_all() -> None:
    """End all children, as when this process ends."""
    for child in list(_children):
        child.close()


def _detach_all() -> None:
    """Leave all children to the parent process after a fork."""
    for child in list(_children):
        child.detach()
    _children.clear()
    pool.reset()


atexit.register(end_all)
if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_detach_all)
