"""Running jobs in processes of this machine; a mesh that kills its process harms no other."""

import logging
import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import TypeVar

import dask
from distributed import Client, KilledWorker, LocalCluster, as_completed

JobT = TypeVar("JobT")
SettingsT = TypeVar("SettingsT")
RowT = TypeVar("RowT")

_CONFIG = {
    # With one task per worker and no second chance, a death is blamed on the mesh that ran.
    "distributed.scheduler.allowed-failures": 0,
    "distributed.scheduler.worker-saturation": 1.0,
    "distributed.worker.memory.spill": False,
    "distributed.worker.memory.target": False,
    "distributed.worker.memory.pause": False,
    "distributed.worker.memory.terminate": 0.95,
    # The workers' own log would only repeat, at length, what the rows say.
    "distributed.nanny.environ": {"DASK_LOGGING__DISTRIBUTED": "critical"},
}


def run(
    task: Callable[[JobT, SettingsT], RowT],
    jobs: Sequence[JobT],
    settings: SettingsT,
    *,
    lost: Callable[[JobT, str], RowT],
    workers: int,
) -> Iterator[RowT]:
    """Do a task for every job and yield each row when it is done.

    Args:
        task: What is done for one job, a function of a module; failures that it foresees are rows.
        jobs: One for each mesh.
        settings: The same for all of them.
        lost: Makes the row of a job whose process did not come back, from the reason.
        workers: Processes to use, one thread each.
    """
    if not jobs:
        return
    with _client(min(workers, len(jobs))) as client:
        futures = client.map(task, jobs, settings=settings, pure=False, batch_size=None)
        job_of = {future.key: job for future, job in zip(futures, jobs, strict=True)}
        for future in as_completed(futures):
            error = future.exception()
            yield future.result() if error is None else lost(job_of[future.key], _told(error))
            future.release()


def _told(error: BaseException) -> str:
    """Say in one sentence what ended a job that did not end by itself."""
    if isinstance(error, KilledWorker):
        return "the process that worked on this mesh died: out of memory, or a crash in a reader"
    return f"unexpected {type(error).__name__}: {error}; please report this mesh"


@contextmanager
def _interrupts_left_to_us() -> Iterator[None]:
    """Start processes that ignore Ctrl-C: it is for the one that plans, which then ends them."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


@contextmanager
def _client(workers: int) -> Iterator[Client]:
    with dask.config.set(_CONFIG):
        logging.getLogger("distributed").setLevel(logging.CRITICAL)
        with _interrupts_left_to_us():
            cluster = LocalCluster(
                n_workers=workers,
                threads_per_worker=1,
                # Any free port of this machine alone: the usual one may be taken by another run.
                dashboard_address="127.0.0.1:0",
                silence_logs=logging.CRITICAL,
            )
        with cluster, Client(cluster) as client:
            yield client
