"""Running jobs in processes of this machine; a mesh that kills its process harms no other."""

import logging
import signal
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import dask
from distributed import Client, KilledWorker, LocalCluster, as_completed

from grasp3d.batch.job import BatchSettings, Job, Row, label_file

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


def run(jobs: Sequence[Job], settings: BatchSettings, *, workers: int) -> Iterator[Row]:
    """Label the jobs' meshes and yield each row when it is done.

    Args:
        jobs: The meshes; the folders of their results exist.
        settings: Model, sampling and mesh options.
        workers: Processes to use, one thread each.
    """
    with _client(min(workers, len(jobs))) as client:
        futures = client.map(label_file, jobs, settings=settings, pure=False, batch_size=None)
        job_of = {future.key: job for future, job in zip(futures, jobs, strict=True)}
        for future in as_completed(futures):
            error = future.exception()
            yield future.result() if error is None else _lost(job_of[future.key], error)
            future.release()


def _lost(job: Job, error: BaseException) -> Row:
    return Row(job.name, str(job.source), f"{job.source}: {_told(error)}")


def _told(error: BaseException) -> str:
    """Say in one sentence what ended a job that did not end by itself."""
    if isinstance(error, KilledWorker):
        return "the process that labelled this mesh died: out of memory, or a crash in a reader"
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
                dashboard_address=None,
                silence_logs=logging.CRITICAL,
            )
        with cluster, Client(cluster) as client:
            yield client
