"""Memory use and termination of a process together with its descendants."""

import contextlib
import threading
import time
from collections import defaultdict

import psutil

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


class ProcessTree:
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
