"""Requests to a child process, with a thread that enforces the limits meanwhile."""

import contextlib
import threading
import time
from collections import defaultdict
from collections.abc import Iterator

import psutil

from grasp3d.system.isolation.limits import (
    CallFailedError,
    CallFailure,
    Limits,
    failure_from_exit_code,
)
from grasp3d.system.isolation.process import ChildProcess

VALUE, RAISED, NO_MEMORY = range(3)
"""Codes that begin an answer: before the pickled result or exception, or without more memory."""

PERIOD = 0.1
"""Time between two checks of the limits [s]."""

REFRESH = 1.0
"""Largest age of the list of all processes [s]; reading it takes tens of milliseconds."""


class _ProcessTable:
    """All processes of the machine by their parent, shared by the threads of this process."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._read_at = float("-inf")
        self._children: dict[int, list[psutil.Process]] = {}

    def descendants(self, pid: int, since: float) -> list[psutil.Process]:
        """Return the descendants of a process, from a table read after the time `since`."""
        with self._lock:
            if self._read_at < since:
                self._children = _read_children()
                self._read_at = time.monotonic()
            processes, queue = [], [pid]
            while queue:
                children = self._children.get(queue.pop(), [])
                processes += children
                queue += [process.pid for process in children]
        return processes


def _read_children() -> dict[int, list[psutil.Process]]:
    """Return the child processes of each process, by its id."""
    children = defaultdict(list)
    for process in psutil.process_iter():
        with contextlib.suppress(psutil.Error):
            children[process.ppid()].append(process)
    return dict(children)


_table = _ProcessTable()


class _ProcessTree:
    """A process and its descendants."""

    def __init__(self, pid: int) -> None:
        self._root = psutil.Process(pid)
        self._descendants: list[psutil.Process] = []
        self._updated = time.monotonic()

    def memory(self) -> float:
        """Return the resident memory of all processes together [GB]."""
        if time.monotonic() - self._updated > REFRESH:
            self._update(self._updated)
        total = 0
        for process in (self._root, *self._descendants):
            with contextlib.suppress(psutil.Error):
                total += process.memory_info().rss
        return total / 1e9

    def kill(self) -> None:
        """End all processes, the root first, since it could start more."""
        with contextlib.suppress(psutil.Error):
            self._root.suspend()
            self._update(time.monotonic())
        for process in (self._root, *self._descendants):
            with contextlib.suppress(psutil.Error):
                process.kill()

    def _update(self, since: float) -> None:
        """Update the descendants; known ones stay in the list after their parent has ended."""
        processes = _table.descendants(self._root.pid, since)
        self._descendants = list({*self._descendants, *processes})
        self._updated = time.monotonic()


class _LimitMonitor:
    """A thread that ends a process tree when it exceeds a limit."""

    def __init__(self, tree: _ProcessTree, limits: Limits) -> None:
        self.failure: CallFailedError | None = None
        self._tree, self._limits = tree, limits
        self._done = threading.Event()
        self._started = time.monotonic()
        self._thread = threading.Thread(target=self._monitor, daemon=True)

    @contextlib.contextmanager
    def running(self) -> Iterator[None]:
        self._thread.start()
        try:
            yield
        finally:
            self._done.set()
            self._thread.join()

    def _monitor(self) -> None:
        while self.failure is None and not self._done.wait(self._pause()):
            self.failure = self._exceeded()
        if self.failure is not None:
            self._tree.kill()

    def _pause(self) -> float:
        """Return the time until the next check [s]."""
        if self._limits.seconds is None:
            return PERIOD
        return max(0.0, min(PERIOD, self._started + self._limits.seconds - time.monotonic()))

    def _exceeded(self) -> CallFailedError | None:
        """Return the error for a limit that is exceeded; None: none is."""
        memory, seconds = self._limits.memory, self._limits.seconds
        if self._limits.cancelled():
            return CallFailedError(CallFailure.CANCELLED, "was cancelled")
        if seconds is not None and time.monotonic() - self._started >= seconds:
            return CallFailedError(
                CallFailure.OUT_OF_TIME, f"took longer than {seconds:g} s and was ended"
            )
        if memory is not None and self._tree.memory() > memory:
            return CallFailedError(
                CallFailure.OUT_OF_MEMORY,
                f"took more than {round(memory, 2):g} GB of memory and was ended",
            )
        return None


def answer_of(child: ChildProcess, request: bytes, limits: Limits) -> bytearray:
    """Send a request and read the answer; after any error the child process is closed.

    Args:
        child: The child process.
        request: Bytes to send.
        limits: Limits of the request.

    Raises:
        CallFailedError: The child exceeded a limit and was ended, or it ended by itself.
    """
    tree = _ProcessTree(child.process.pid)
    monitor = _LimitMonitor(tree, limits)
    child.kill_descendants = tree.kill
    try:
        with monitor.running():
            child.send(request)
            answer = child.receive()
    except (OSError, ValueError, EOFError) as error:
        code = child.close()
        raise monitor.failure or failure_from_exit_code(code) from error
    except BaseException:  # Ctrl-C included: half an answer must not be read by the next request
        child.close()
        raise
    child.kill_descendants = None
    if answer[0] == NO_MEMORY:
        child.close()
        raise CallFailedError(
            CallFailure.OUT_OF_MEMORY, "requested more memory than is available and was ended"
        )
    return answer
