"""Settings of a batch: how meshes are labelled, and which processes label them."""

import math
from dataclasses import dataclass, field, replace
from functools import lru_cache
from itertools import product
from typing import Annotated, Any

from grasp3d.errors import SettingError
from grasp3d.hand.reach_settings import ReachSettings
from grasp3d.quality.loads import Load
from grasp3d.settings import (
    DEGREE,
    AnySampling,
    GraspModel,
    MeshOptions,
    Sampling,
    search_cone,
)
from grasp3d.settings.checks import check_range
from grasp3d.settings.lengths import Lengths, settings_in_unit
from grasp3d.settings.parsing import Main, Settings
from grasp3d.settings.regions import Box, Sphere
from grasp3d.settings.sampling import check_search_angle

DEFAULT_RESOLUTIONS = tuple(5.0 * step * DEGREE for step in range(13))
"""Default sensor resolutions of the grid: 0 to 60 degrees in steps of 5 [rad]."""

UNCERTAINTIES = (
    "friction", "friction_error", "normal_error", "location_error", "sensor_resolution",
)  # fmt: skip
"""Fields of a grid and of a model, the one that varies fastest last."""

MIN_WORKER_MEMORY = 0.5
"""Least memory of a worker process [GB]."""


@dataclass(frozen=True)
class FractionGrid(Settings):
    """Uncertainties at which the area fractions of S, M and U are computed: all combinations.

    Attributes:
        friction: Coulomb coefficients; none: the model's.
        sensor_resolution: Resolutions alpha [rad]; none: 0 to 60 degrees in steps of 5, and the
            model's.
        friction_error: Largest differences between the true friction and `friction`; none: the
            model's.
        normal_error: Largest angles between true and perceived normals beyond alpha/2 [rad]; none:
            the model's.
        location_error: Largest distances between true and perceived contact points, lengths; none:
            the model's. The grasps are those that were found at the model's.
    """

    friction: tuple[float, ...] = ()
    sensor_resolution: tuple[float, ...] = ()
    friction_error: tuple[float, ...] = ()
    normal_error: tuple[float, ...] = ()
    location_error: Lengths = Lengths(())

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in UNCERTAINTIES:  # how large a friction error may be depends on the friction
            for value in getattr(self, name) if name != "friction_error" else ():
                GraspModel(**{name: value})


@dataclass(frozen=True)
class BatchSettings:
    """Settings with which all meshes are labelled, or for which they are checked.

    Attributes:
        sampling: How grasps are searched for; settings that state nothing but a search angle or a
            tolerance are for any number of fingers.
        reach: The gripper that must reach each grasp, and the table.
        load: What each grasp must hold, and with which force; None: nothing.
        best: Number of best distinct grasps that the summary keeps of each mesh; 0: none.
    """

    model: GraspModel = field(default_factory=GraspModel)
    sampling: AnySampling = field(default_factory=Sampling)
    mesh: MeshOptions = field(default_factory=MeshOptions)
    grid: FractionGrid = field(default_factory=FractionGrid)
    best: int = 5
    reach: ReachSettings = field(default_factory=ReachSettings)
    load: Load | None = None

    def __post_init__(self) -> None:
        check_range("the number of best grasps", self.best, 0)
        if self.reach.pose_error and not self.best:
            raise SettingError("a pose error tries wrong poses of the best grasps; ask for one")
        for part in (*self.mesh.only, *self.mesh.avoid):
            if not isinstance(part, Box | Sphere):
                raise SettingError(f"{part} is of one mesh; a library takes boxes and spheres")
        object.__setattr__(self, "sampling", self.sampling.fitted(self.model.fingers))
        values = self.grid_values
        for friction, error in product(values["friction"], values["friction_error"]):
            GraspModel(friction=friction, friction_error=error)
        if self.grid != FractionGrid():
            check_search_angle(self.sampling, self._needed_search_angle, " of the grid")

    @property
    def grid_values(self) -> dict[str, tuple[Any, ...]]:
        """Values of each uncertainty at which fractions are computed, by its name in `GraspModel`.

        Numbers are in increasing order; locations, which may have units, in that of the grid.
        """
        model, values = self.model, {}
        for name in UNCERTAINTIES:
            others = DEFAULT_RESOLUTIONS if name == "sensor_resolution" else ()
            entries = getattr(self.grid, name) or (*others, getattr(model, name))
            once = dict.fromkeys(entries)
            values[name] = tuple(once) if name == "location_error" else tuple(sorted(once))
        return values

    def grid_models(self, model: GraspModel, unit: Any = None) -> tuple[GraspModel, ...]:
        """The model at every combination of the grid, all resolutions of each one by one.

        Args:
            model: The model of the labels, in the mesh's unit.
            unit: Unit of the mesh; None: it is not known.

        Raises:
            SettingError: A location error has a unit, but that of the mesh is not known.
        """
        return _grid_models(self, model, unit)

    @property
    def search(self) -> AnySampling:
        """How grasps are searched; the search angle covers the model and a grid that is given."""
        if self.sampling.search_angle is not None or self.grid == FractionGrid():
            return self.sampling
        return replace(self.sampling, search_angle=self._needed_search_angle)

    @property
    def _needed_search_angle(self) -> float:
        """Search angle that separates M from U for the model and over the whole grid [rad]."""
        widest = {
            name: max(getattr(self.model, name), *values)
            for name, values in self.grid_values.items()
            if name != "location_error"
        }
        return search_cone(replace(self.model, **widest))


@lru_cache(maxsize=16)  # most meshes of a library have the same unit
def _grid_models(settings: BatchSettings, model: GraspModel, unit: Any) -> tuple[GraspModel, ...]:
    """See `BatchSettings.grid_models`."""
    (grid,) = settings_in_unit(unit, settings.grid)
    locations = grid.location_error or (model.location_error,)
    values = settings.grid_values | {"location_error": tuple(dict.fromkeys(locations))}
    return tuple(
        # Thresholds on critical angles, whatever the labels are from.
        replace(model, method="exact", **dict(zip(values, one, strict=True)))
        for one in product(*values.values())
    )


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

    workers: Annotated[int | None, Main("processes on this machine")] = None
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
