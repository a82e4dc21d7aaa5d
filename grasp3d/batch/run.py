"""Running jobs in processes of this machine; a mesh that kills its process harms no other."""

import logging
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
        jobs: The meshes.
        settings: Model, sampling and mesh options.
        workers: Processes to use, one thread each.
    """
    for folder in {job.target.parent for job in jobs}:
        folder.mkdir(parents=True, exist_ok=True)
    with _client(min(workers, len(jobs))) as client:
        futures = client.map(label_file, jobs, settings=settings, pure=False, batch_size=None)
        names = {future.key: job.name for future, job in zip(futures, jobs, strict=True)}
        for future in as_completed(futures):
            error = future.exception()
            yield future.result() if error is None else Row(names[future.key], error=_told(error))
            future.release()


def _told(error: BaseException) -> str:
    """Say in one sentence what ended a job that did not end by itself."""
    if isinstance(error, KilledWorker):
        return "the process that labelled this mesh died: out of memory, or a crash in a reader"
    return f"unexpected {type(error).__name__}: {error}; please report this mesh"


@contextmanager
def _client(workers: int) -> Iterator[Client]:
    with dask.config.set(_CONFIG):
        logging.getLogger("distributed").setLevel(logging.CRITICAL)
        with (
            LocalCluster(
                n_workers=workers,
                threads_per_worker=1,
                dashboard_address=None,
                silence_logs=logging.CRITICAL,
            ) as cluster,
            Client(cluster) as client,
        ):
            yield client
