"""Settings of the processes that run jobs, on this machine or on a cluster."""

import math
from dataclasses import dataclass

from grasp3d.errors import SettingError
from grasp3d.settings.checks import check_range

MIN_WORKER_MEMORY = 0.5
"""Smallest memory of a worker process [GB]."""


@dataclass(frozen=True)
class ClusterSettings:
    """Processes that label the meshes: on this machine, or of a running Dask cluster.

    Attributes:
        workers: Processes on this machine. Each has one thread, or more when fewer meshes than
            processes are left. none: one per processor; 0: no child processes, one mesh after the
            other, without limits, for debugging.
        scheduler: Address (tcp://HOST:8786) or scheduler file of a running Dask cluster.
        worker_memory: Memory limit of a process [GB]; a mesh that needs more is given up. none: an
            equal part of this machine's memory, or of the memory of the running cluster's workers.
        timeout: Time limit for a mesh [s]; a mesh that takes longer is given up. none: no limit.
    """

    workers: int | None = None
    scheduler: str | None = None
    worker_memory: float | None = None
    timeout: float | None = 3600.0

    def __post_init__(self) -> None:
        if self.workers is not None:
            check_range("workers", self.workers, 0)
        if self.workers is not None and self.scheduler is not None:
            raise SettingError(
                "workers and scheduler exclude each other: a running cluster has its own workers"
            )
        memory, least = self.worker_memory, MIN_WORKER_MEMORY
        if memory is not None:
            check_range("worker memory", memory, least, ends="[)", unit="GB")
        if self.timeout is not None and not (self.timeout > 0.0 and math.isfinite(self.timeout)):
            raise SettingError(f"timeout must be a finite time above 0 s; got {self.timeout:g}")
