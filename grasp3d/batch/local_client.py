"""The processes of this machine that run the jobs."""

import queue
import threading
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from itertools import count

from grasp3d.batch.batch_settings import MIN_WORKER_MEMORY, ClusterSettings
from grasp3d.batch.job_requests import USABLE_MEMORY, Request, Result, result_of
from grasp3d.system.context import available_processors
from grasp3d.system.isolation import end_idle
from grasp3d.system.isolation.limits import machine_memory

REQUESTS_PER_PROCESS = 2
"""Requests sent for each process, so that no process waits for the next one."""

WAIT = 1.0
"""Longest time of a wait for a result [s]."""


class LocalClient:
    """Runs requests on this machine: a thread for each child process, which watches it."""

    def __init__(self, processes: int) -> None:
        """Start nothing yet.

        Args:
            processes: How many requests run at once.
        """
        self.processes = processes
        self._usable = USABLE_MEMORY * machine_memory()
        self._numbers = count()
        self._done: queue.SimpleQueue[tuple[int, Result]] = queue.SimpleQueue()
        self._closed = threading.Event()
        self._threads = ThreadPoolExecutor(processes, "grasp3d-batch")

    @property
    def window(self) -> int:
        """How many requests should be pending at any time."""
        return REQUESTS_PER_PROCESS * self.processes

    def submit(self, request: Request) -> int:
        """Run a request when a process is free; returns its number."""
        number = next(self._numbers)
        self._threads.submit(self._run, number, request)
        return number

    def wait(self) -> tuple[int, Result] | None:
        """Wait for a result for a limited time; returns its number and value, or none."""
        try:
            return self._done.get(timeout=WAIT)
        except queue.Empty:
            return None

    def largest_worker(self) -> tuple[str, float]:
        """Name of this machine, and the memory that jobs may take [GB]."""
        return "this machine", self._usable

    def close(self) -> None:
        """End the running requests, and forget the others."""
        self._closed.set()
        self._threads.shutdown(cancel_futures=True)

    def _run(self, number: int, request: Request) -> None:
        if request.alone:
            end_idle()  # the memory of idle children is part of what the job may take
        memory = request.memory_limit(self._usable, self.processes)
        self._done.put((number, result_of(request, memory, self._closed.is_set)))


@contextmanager
def open_local_client(settings: ClusterSettings) -> Iterator[LocalClient]:
    """Run requests on this machine for the duration of the context, then end all processes."""
    client = LocalClient(local_workers(settings))
    try:
        yield client
    finally:
        client.close()
        end_idle()


def local_workers(settings: ClusterSettings) -> int:
    """Jobs to run at once on this machine, limited by its processors and its memory."""
    if settings.workers is not None:
        return settings.workers
    least = settings.worker_memory or MIN_WORKER_MEMORY
    return max(1, min(available_processors(), int(USABLE_MEMORY * machine_memory() / least)))
