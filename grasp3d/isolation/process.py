"""Child processes that run this package, kept from one request to the next.

They are started anew, never forked: what threads and compilers hold does not survive a fork.
"""

import atexit
import contextlib
import os
import signal
import subprocess
import sys
import threading
import time
import weakref
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, cast

import grasp3d

if TYPE_CHECKING:
    import io

_START = """
import importlib, sys, typing
package, module, *paths = sys.argv[1:]
sys.path.insert(0, package)
import grasp3d
sys.path[:] = sys.path[1:] + [path for path in paths if path not in sys.path[1:]]
importlib.import_module(module).main()
"""
"""The package is this process's own; no other module may come from its folder, or from the one that
this process works in, before those of Python."""


class Child:
    """A process, and the pipes to it."""

    def __init__(self, module: str, environment: Mapping[str, str]) -> None:
        package = str(Path(grasp3d.__file__).parents[1])
        self.process = subprocess.Popen(  # noqa: S603, nothing of a file is in the command
            [sys.executable, *_flags(), "-c", _START, package, module, *_paths()],
            bufsize=0,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            start_new_session=True,  # Ctrl-C is for us alone
            cwd=package,
            env={**os.environ, **environment},
        )
        self.requests = cast("io.RawIOBase", self.process.stdin)
        self.answers = cast("io.RawIOBase", self.process.stdout)
        self.idle_since = time.monotonic()
        self.used = False
        """Whether it has answered a request before."""
        self.kill_below: Callable[[], None] | None = None
        """Set while it is at work: ends what it started in sessions of their own."""
        _children.add(self)

    @property
    def alive(self) -> bool:
        """Whether it can be asked."""
        return self.process.poll() is None

    def send(self, data: bytes) -> None:
        """Write all of a request."""
        left = memoryview(data)
        while left:
            left = left[self.requests.write(left) :]

    def receive(self, count: int) -> bytearray:
        """Wait for so many bytes of an answer.

        Raises:
            EOFError: The process ended before.
        """
        data = bytearray(count)
        left = memoryview(data)
        while left:
            got = self.answers.readinto(left)
            if not got:
                raise EOFError
            left = left[got:]
        return data

    def kill(self) -> None:
        """End the process, and what it started."""
        if self.kill_below is not None:
            self.kill_below()
        if self.process.returncode is not None:  # its number may be another's by now
            return
        if hasattr(os, "killpg"):
            with contextlib.suppress(OSError):
                os.killpg(self.process.pid, signal.SIGKILL)
        self.process.kill()

    def close(self) -> int:
        """End it; returns its exit code, which tells what ended it if it had ended already."""
        self.kill()
        self.requests.close()
        self.answers.close()
        _children.discard(self)
        return self.process.wait()

    def leave(self) -> None:
        """Let go of it, as a process must that was forked from the one that asks."""
        self.requests.close()
        self.answers.close()
        self.process.returncode = 0  # it is no child of this process, which must not wait for it


class Pool:
    """Children of one kind: as many as are busy at once, idle ones first."""

    def __init__(
        self, module: str, environment: Mapping[str, str] | None = None, keep: float | None = None
    ) -> None:
        """Start nothing yet.

        Args:
            module: Its `main` answers requests until its input ends.
            environment: Variables to set.
            keep: How long an idle child is kept [s]; none: as long as this process.
        """
        self._module, self._environment, self._keep = module, environment or {}, keep
        self.renew()
        _pools.add(self)

    def renew(self) -> None:
        """Begin anew, without any child."""
        self._lock = threading.Lock()
        self._idle: list[Child] = []
        self._timer: threading.Timer | None = None

    def take(self, *, fresh: bool = False) -> Child:
        """Give a child that is alive to one who asks, and who gives it back or closes it.

        Args:
            fresh: Whether it must be a new one.

        Raises:
            OSError: None can be started.
        """
        while True:
            with self._lock:
                child = self._idle.pop() if self._idle and not fresh else None
            if child is None:
                return Child(self._module, self._environment)
            if child.alive:
                return child
            child.close()

    def give_back(self, child: Child) -> None:
        """Keep a child for the next request."""
        child.idle_since = time.monotonic()
        with self._lock:
            self._idle.append(child)
            self._look_later()

    def end_idle(self) -> None:
        """End the children that nobody uses."""
        self._end(float("inf"))

    def _look_later(self) -> None:
        """See to it that children that stay idle are ended; the lock is held."""
        if self._keep is not None and self._timer is None and self._idle:
            self._timer = threading.Timer(self._keep, self._end_old)
            self._timer.daemon = True
            self._timer.start()

    def _end_old(self) -> None:
        self._end(time.monotonic() - (self._keep or 0.0))
        with self._lock:
            self._timer = None
            self._look_later()

    def _end(self, before: float) -> None:
        with self._lock:
            old = [child for child in self._idle if child.idle_since < before]
            self._idle = [child for child in self._idle if child.idle_since >= before]
        for child in old:
            child.close()


_children: "weakref.WeakSet[Child]" = weakref.WeakSet()
_pools: "weakref.WeakSet[Pool]" = weakref.WeakSet()


def _flags() -> list[str]:
    return ["-I"] if sys.flags.isolated else ["-P"]


def _paths() -> list[str]:
    """Where this process finds modules, its working folder left out."""
    with contextlib.suppress(OSError):
        here = os.getcwd()  # noqa: PTH109, compared as text
        return [path for path in sys.path if Path(path).is_absolute() and path != here]
    return []


def _end_all() -> None:
    """End all children together with this process."""
    for child in list(_children):
        child.close()


def _leave_all() -> None:
    """Leave the children to the parent after a fork, and begin anew."""
    for child in list(_children):
        child.leave()
    _children.clear()
    for pool in list(_pools):
        pool.renew()


atexit.register(_end_all)
if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_leave_all)
