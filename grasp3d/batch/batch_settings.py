"""What a batch is run with: how meshes are labelled, and who does the work."""

import math
from dataclasses import dataclass, field, replace

from grasp3d.errors import SettingError
from grasp3d.settings import DEGREE, GraspModel, MeshOptions, Sampling, search_cone

USUAL_RESOLUTIONS = tuple(5.0 * step * DEGREE for step in range(13))
"""Sensor resolutions at which shares are taken where none are asked for: 0 to 60 degrees [rad]."""

MIN_WORKER_MEMORY = 0.5

ROUNDING = 1e-9
"""Angle by which a question may exceed the cone that was searched [rad]."""


@dataclass(frozen=True)
class FractionGrid:
    """Frictions and sensor resolutions at which the shares of S, M and U of each mesh are taken."""

    friction: tuple[float, ...] = ()
    """Coulomb coefficients; none: that of the model."""
    sensor_resolution: tuple[float, ...] = ()
    """Resolutions alpha [rad]; none: 0 to 60 degrees in steps of 5, and that of the model."""

    def __post_init__(self) -> None:
        for friction in self.friction:
            GraspModel(friction=friction)
        for resolution in self.sensor_resolution:
            GraspModel(sensor_resolution=resolution)


@dataclass(frozen=True)
class BatchSettings:
    """What all meshes are labelled with, or checked for."""

    model: GraspModel = field(default_factory=GraspModel)
    sampling: Sampling = field(default_factory=Sampling)
    mesh: MeshOptions = field(default_factory=MeshOptions)
    grid: FractionGrid = field(default_factory=FractionGrid)
    best: int = 5
    """Best distinct grasps that are kept of each mesh; 0: none."""

    def __post_init__(self) -> None:
        if self.best < 0:
            raise SettingError(f"the number of best grasps must be at least 0; got {self.best}")
        given, needed = self.sampling.search_angle, self._needed
        if self.grid != FractionGrid() and given is not None and given < needed - ROUNDING:
            raise SettingError(
                "search angle must be at least atan(friction) + alpha/2 of the largest of both in "
                f"the grid, {math.degrees(needed):.4g} degrees; got {math.degrees(given):.4g}"
            )

    @property
    def frictions(self) -> tuple[float, ...]:
        """Coulomb coefficients of the grid, in increasing order."""
        return tuple(sorted(set(self.grid.friction))) or (self.model.friction,)

    @property
    def resolutions(self) -> tuple[float, ...]:
        """Sensor resolutions of the grid, in increasing order [rad]."""
        given = self.grid.sensor_resolution or (*USUAL_RESOLUTIONS, self.model.sensor_resolution)
        return tuple(sorted(set(given)))

    @property
    def search(self) -> Sampling:
        """How grasps are searched: as wide as the model and a grid that was asked for need."""
        if self.sampling.search_angle is not None or self.grid == FractionGrid():
            return self.sampling
        return replace(self.sampling, search_angle=self._needed)

    @property
    def _needed(self) -> float:
        """Search angle that tells M from U for the model and over the whole grid [rad]."""
        widest = replace(
            self.model,
            friction=max(self.model.friction, *self.frictions),
            sensor_resolution=max(self.model.sensor_resolution, *self.resolutions),
        )
        return search_cone(widest, Sampling())


@dataclass(frozen=True)
class ClusterSettings:
    """Who does the work: processes of this machine, or a Dask cluster that runs already."""

    workers: int | None = None
    """Processes of this machine, one thread each; none: one per processor; 0: no processes, one
    mesh after the other and without limits, to look for the cause of a failure."""

    scheduler: str | None = None
    """Address (tcp://HOST:8786) or scheduler file of a Dask cluster that runs already."""

    worker_memory: float | None = None
    """Memory of a process [GB]; a mesh that takes more is tried once more alone; none: an equal
    share of this machine's, or what the workers of a running cluster were given."""

    timeout: float | None = 3600.0
    """Time for a mesh [s]; one that takes longer is given up; none: any."""

    def __post_init__(self) -> None:
        if self.workers is not None and self.workers < 0:
            raise SettingError(f"workers must be at least 0; got {self.workers}")
        if self.workers is not None and self.scheduler is not None:
            raise SettingError("workers are those of the running cluster; leave --workers out")
        memory = self.worker_memory
        if memory is not None and not (memory >= MIN_WORKER_MEMORY and math.isfinite(memory)):
            raise SettingError(
                f"worker memory must be at least {MIN_WORKER_MEMORY} GB; got {memory:g}"
            )
        if self.timeout is not None and not (self.timeout > 0.0 and math.isfinite(self.timeout)):
            raise SettingError(f"timeout must be a finite time above 0 s; got {self.timeout:g}")
