"""A process with all processes below it: what they take together, and their end."""

import contextlib
import threading
import time
from collections import defaultdict

import psutil

REFRESH = 1.0
"""How old a list of the machine's processes may be [s]; it takes tens of milliseconds to make."""


class _Table:
    """Who started whom, for all threads of this process."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._made = float("-inf")
        self._below: dict[int, list[psutil.Process]] = {}

    def below(self, pid: int, since: float) -> list[psutil.Process]:
        """List the processes below one, as of some time after `since`."""
        with self._lock:
            if self._made < since:
                self._below = _read_table()
                self._made = time.monotonic()
            found, queue = [], [pid]
            while queue:
                below = self._below.get(queue.pop(), [])
                found += below
                queue += [process.pid for process in below]
        return found


def _read_table() -> dict[int, list[psutil.Process]]:
    table = defaultdict(list)
    for process in psutil.process_iter():
        with contextlib.suppress(psutil.Error):
            table[process.ppid()].append(process)
    return dict(table)


_table = _Table()


class Tree:
    """A child and all below it."""

    def __init__(self, pid: int) -> None:
        self._root = psutil.Process(pid)
        self._below: list[psutil.Process] = []
        self._looked = time.monotonic()

    def memory(self) -> float:
        """What they have in memory together [GB]; a process that is gone takes nothing."""
        if time.monotonic() - self._looked > REFRESH:
            self._look(self._looked)
        total = 0
        for process in (self._root, *self._below):
            with contextlib.suppress(psutil.Error):
                total += process.memory_info().rss
        return total / 1e9

    def kill(self) -> None:
        """End all of them, the root first: it could start more."""
        with contextlib.suppress(psutil.Error):
            self._root.suspend()
            self._look(time.monotonic())
        for process in (self._root, *self._below):
            with contextlib.suppress(psutil.Error):
                process.kill()

    def _look(self, since: float) -> None:
        """Bring the list up to date; those whose parent is gone are kept on it."""
        now = _table.below(self._root.pid, since)
        self._below = list({*self._below, *now})
        self._looked = time.monotonic()
