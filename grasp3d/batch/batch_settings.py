"""Settings of a batch: how meshes are labelled, and which processes label them."""

import math
from dataclasses import dataclass, field
from typing import Any

from grasp3d.errors import SettingError
from grasp3d.hand.reach_settings import ReachSettings
from grasp3d.quality.loads import Load
from grasp3d.settings import GraspModel, MeshOptions, Sampling, check_search_settings
from grasp3d.settings.checks import check_range
from grasp3d.settings.regions import Mask

MIN_WORKER_MEMORY = 0.5
"""Least memory of a worker process [GB]."""


@dataclass(frozen=True)
class BatchSettings:
    """Settings with which all meshes are labelled, or for which they are checked.

    Each may also be a dict of fields, and the load a mass, '0.5kg'.

    Attributes:
        sampling: How grasps are searched for.
        reach: The gripper that must reach each grasp, and the table.
        load: What each grasp must hold, and with which force; None: nothing.
        best: Number of best distinct grasps that the summary keeps of each mesh; 0: none.
    """

    model: GraspModel = field(default_factory=GraspModel)
    sampling: Sampling = field(default_factory=Sampling)
    mesh: MeshOptions = field(default_factory=MeshOptions)
    best: int = 5
    reach: ReachSettings = field(default_factory=ReachSettings)
    load: Load | None = None

    def __post_init__(self) -> None:
        kinds: dict[str, Any] = {
            "model": GraspModel, "sampling": Sampling, "mesh": MeshOptions,
            "reach": ReachSettings, "load": Load,
        }  # fmt: skip
        for name, kind in kinds.items():
            given = kind.given(name, getattr(self, name))
            object.__setattr__(self, name, given if name == "load" else given or kind())
        check_range("the number of best grasps", self.best, 0)
        if self.reach.pose_error and not self.best:
            raise SettingError("a pose error tries wrong poses of the best grasps; ask for one")
        if isinstance(self.mesh.region, Mask):
            raise SettingError(f"{self.mesh.region} is of one mesh; a library takes a box")
        check_search_settings(self.model, self.sampling)


@dataclass(frozen=True)
class ClusterSettings:
    """Which processes label the meshes: this machine's, or those of a running Dask cluster.

    Attributes:
        workers: Processes on this machine, one thread each, and more where fewer meshes than
            processes are left; none: one per processor; 0: no child processes, one mesh after the
            other and without limits, for debugging.
        scheduler: Address (tcp://HOST:8786) or scheduler file of a running Dask cluster.
        worker_memory: Memory limit of a process [GB]; a mesh that needs more is labelled once more,
            alone; none: an equal part of this machine's memory, or the memory limit of the running
            cluster's workers.
        timeout: Time limit for a mesh [s]; a mesh that takes longer is given up; none: no limit.
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
