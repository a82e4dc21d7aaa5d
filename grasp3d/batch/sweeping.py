"""Sweeps of many targets: shapes in closed form, mesh files, folders of meshes."""

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from grasp3d.batch.inputs import MeshFile, find_meshes, real_path, with_unique_names
from grasp3d.batch.storage.files import local_copy, local_path
from grasp3d.errors import GraspError, SettingError
from grasp3d.hand.reach_settings import ReachSettings
from grasp3d.planar import Circle, square
from grasp3d.settings import (
    AnySampling,
    GraspModel,
    MeshOptions,
    Sampling,
    check_search_settings,
    search_cone,
)
from grasp3d.settings.lengths import AnyLength
from grasp3d.settings.sampling import check_search_angle
from grasp3d.stability.angle_distributions import AngleDistribution, SampledAngles, SphereAngles
from grasp3d.stability.label import Mode
from grasp3d.surface.sweeps import AxisValues, LocatedGrasps, Sweep, mean_sweep, sweep
from grasp3d.surface.sweeps.axes import NAMES, axis_values
from grasp3d.system.context import running, within

if TYPE_CHECKING:
    from grasp3d.surface.labels import SurfaceLabels

SHAPES: dict[str, Callable[[], AngleDistribution]] = {
    "circle": Circle,
    "square": square,
    "sphere": SphereAngles,
}
"""Shapes in closed form, with one finger fixed (on the square in the middle of a side)."""

MAX_SEARCHES = 5
"""Most searches for the grasps of one mesh."""

MAX_SHOWN_MEMBERS = 6
"""Meshes of a folder up to which each of them is shown."""


@dataclass(frozen=True)
class SweepSettings:
    """Values of the uncertainties in a sweep, of which two may have several, and how to label.

    Attributes:
        friction: Coulomb coefficients.
        sensor_resolution: Resolutions alpha [rad].
        sampling: How grasps are searched for, see `SearchSettings.fitted`. Its search angle, if
            given, must cover all frictions and resolutions.
        friction_error: Largest differences between the true friction and `friction`.
        normal_error: Largest angles between true and perceived normals beyond alpha/2 [rad].
        location_error: Largest distances between true and perceived contact points, lengths.
    """

    friction: tuple[float, ...]
    sensor_resolution: tuple[float, ...]
    sampling: AnySampling = field(default_factory=Sampling)
    mesh: MeshOptions = field(default_factory=MeshOptions)
    fingers: int = 2
    reach: ReachSettings = field(default_factory=ReachSettings)
    friction_error: tuple[float, ...] = (0.0,)
    normal_error: tuple[float, ...] = (0.0,)
    location_error: tuple[AnyLength, ...] = (0.0,)

    def __post_init__(self) -> None:
        if not self.friction or not self.sensor_resolution:
            raise SettingError("a sweep needs at least one friction and one sensor resolution")
        _ = self.axes.rows_and_columns  # raises an error if there are more than two
        object.__setattr__(self, "sampling", self.sampling.fitted(self.fingers))
        check_search_settings(self.model, self.sampling)
        check_search_angle(self.sampling, search_cone(self.model))

    @property
    def values(self) -> dict[str, Any]:
        """The values of each uncertainty, as `sweep` takes them."""
        return {name: getattr(self, name) for name in NAMES}

    @property
    def axes(self) -> AxisValues:
        """The values of each uncertainty, in order."""
        return axis_values(**self.values)

    @property
    def model(self) -> GraspModel:
        """Largest friction and coarsest resolution, which need the widest search."""
        return GraspModel(
            friction=max(self.friction),
            sensor_resolution=max(self.sensor_resolution),
            fingers=self.fingers,
            friction_error=max(self.friction_error),
            normal_error=max(self.normal_error),
        )


@dataclass(frozen=True)
class Target:
    """One target of a sweep: a shape, a mesh file, or a folder, pattern or list of mesh files."""

    name: str
    given: str = ""
    """The input, as given."""
    files: tuple[MeshFile, ...] = ()
    """The file, or the meshes of a folder, pattern or list; none for a shape."""
    folder: bool = False
    """Whether the target is a folder, a pattern or a list."""


@dataclass(frozen=True, eq=False)
class SweptMesh:
    """The sweep of one mesh; `error` is empty if it succeeded."""

    name: str
    sweep: Sweep | None = None
    error: str = ""
    warnings: tuple[str, ...] = ()
    crease_fraction: float = 0.0
    """As in `ObjectMesh`."""


@dataclass(frozen=True, eq=False)
class SweptTarget:
    """The sweep of one target."""

    name: str
    sweep: Sweep | None
    """Sweep of the shape or file, or the mean over the folder; None: no mesh could be swept."""
    members: tuple[Sweep, ...] = ()
    """For a folder, the sweeps of its meshes, over which the mean is taken."""

    @property
    def sweeps(self) -> tuple[Sweep, ...]:
        """All sweeps, the mean last."""
        return self.members if self.sweep is None else (*self.members, self.sweep)

    @property
    def shown(self) -> tuple[Sweep, ...]:
        """Sweeps to show; for a folder with many meshes only the mean."""
        return self.sweeps if len(self.members) <= MAX_SHOWN_MEMBERS else self.sweeps[-1:]


def find_targets(inputs: Iterable[str]) -> list[Target]:
    """Find the targets of a sweep; the name of a shape takes precedence over a file name.

    Args:
        inputs: Names of shapes, or inputs of `find_meshes`; `./circle` is always a path.

    Returns:
        In their order, each once. Meshes are named by their file name, those of a folder by their
        path below it; where two names would be equal, as given.

    Raises:
        SettingError: There is no target.
        MeshError: A path is missing, or a folder contains no mesh.
    """
    found = {
        item: () if item in SHAPES else tuple(find_meshes([item])) for item in dict.fromkeys(inputs)
    }
    if not found:
        raise SettingError(
            f"nothing to sweep: name a mesh file, a folder of meshes, or {', '.join(SHAPES)}"
        )
    distinct = {real_path(mesh.source): mesh for meshes in found.values() for mesh in meshes}
    named = dict(zip(distinct, with_unique_names(distinct.values()), strict=True))
    targets: dict[str, Target] = {}
    for item, meshes in found.items():
        if not meshes:
            targets[item] = Target(item)
            continue
        path, files = local_path(item), tuple(named[real_path(mesh.source)] for mesh in meshes)
        source = item.rstrip("/") if path is None else str(path)
        key, name = real_path(source), files[0].name
        folder = len(meshes) != 1 or meshes[0].source != source
        if folder:
            key, name = f"{key}/", source.rpartition("/")[2] if path is None else path.name
            if path is not None and name in {"", ".."}:
                name = path.resolve().name
        targets.setdefault(key, Target(name, source, files, folder))
    counts = Counter(target.name for target in targets.values())
    return [
        replace(one, name=one.given) if one.folder and counts[one.name] > 1 else one
        for one in targets.values()
    ]


def check_fingers(targets: Iterable[Target], settings: SweepSettings) -> None:
    """Refuse shapes in closed form for more than two fingers.

    Raises:
        SettingError: One of the targets is such a shape.
    """
    shapes = [target.name for target in targets if not target.files and not target.folder]
    if shapes and settings.fingers != 2:
        raise SettingError(
            f"{shapes[0]} is known in closed form for two fingers only; got {settings.fingers}"
        )


def meshes_of(targets: Iterable[Target]) -> list[MeshFile]:
    """Every mesh of the targets, each once."""
    return list(dict.fromkeys(mesh for target in targets for mesh in target.files))


@dataclass(frozen=True, eq=False)
class BestOfSeveral:
    """Labels of one surface from several searches, of which each vertex has the best grasp.

    Locations that are known less well cost a wide grasp less than a narrow one, so that at another
    location error other grasps are best.
    """

    searches: Sequence["SurfaceLabels"]

    def angle_distribution(self, *, location_error: Any) -> SampledAngles:
        """Distribution of critical angles at a location error; see `SurfaceLabels`."""
        angles = [one.angle_distribution(location_error=location_error) for one in self.searches]
        return replace(
            angles[0],
            worst=np.minimum.reduce([one.worst for one in angles]),
            best=np.minimum.reduce([one.best for one in angles]),
            limit=min(one.limit for one in angles),
        )


def search_at_each(
    label: Callable[[GraspModel], "SurfaceLabels"],
    model: GraspModel,
    location_errors: Sequence[AnyLength],
) -> BestOfSeveral:
    """Search for the grasps of a mesh at several location errors.

    Args:
        label: Labels the mesh with a model.
        model: The model of every search, but for its location error.
        location_errors: In increasing order; of more than `MAX_SEARCHES` some, from the smallest to
            the largest.
    """
    last = len(location_errors) - 1
    indices = {round(index) for index in np.linspace(0, last, min(last + 1, MAX_SEARCHES))}
    searches = []
    for number, index in enumerate(sorted(indices)):
        with within(number / len(indices), (number + 1) / len(indices)):
            searches.append(label(replace(model, location_error=location_errors[index])))
    return BestOfSeveral(searches)


def sweep_mesh(mesh: MeshFile, settings: SweepSettings, *, force: bool = False) -> SweptMesh:
    """Label a mesh file and compute its area fractions at all values of the uncertainties.

    It is labelled once for each location error, at most `MAX_SEARCHES` times.

    Args:
        mesh: The file.
        settings: Frictions, sensor resolutions, and how to label.
        force: Accept lengths that cannot be meant for an object of this size.

    Returns:
        The sweep, or the reason why the mesh cannot be labelled.
    """
    # Imported here: the process that plans needs neither ray tracing nor the compiler.
    from grasp3d.hand.scene import Scene
    from grasp3d.mesh import load_mesh
    from grasp3d.mesh.plausible_lengths import refuse_lengths
    from grasp3d.surface.labelling import label_surface

    try:
        with local_copy(mesh.source) as path:
            surface = load_mesh(path, settings.mesh)
        if not force:
            largest = settings.axes.location_errors()[-1]
            refuse_lengths(surface, settings.sampling, location_error=largest)
        scene = Scene.of(settings.reach, surface)
        grasps = search_at_each(
            lambda model: label_surface(surface, model, sampling=settings.sampling, scene=scene),
            settings.model,
            settings.axes.location_errors(),
        )
    except GraspError as error:
        return SweptMesh(mesh.name, error=str(error))
    return SweptMesh(
        mesh.name,
        _swept(mesh.name, grasps, settings, mode="label"),
        warnings=grasps.searches[0].warnings,
        crease_fraction=surface.crease_fraction,
    )


def sweep_on_one_thread(mesh: MeshFile, settings: SweepSettings, *, force: bool) -> SweptMesh:
    """As `sweep_mesh`, in one of as many processes as there are processors.

    Args:
        mesh: The file.
        settings: As in `sweep_mesh`.
        force: As in `sweep_mesh`.
    """
    with running(threads=1):
        return sweep_mesh(mesh, settings, force=force)


def lost_mesh(mesh: MeshFile, reason: str) -> SweptMesh:
    """The result of a mesh whose process failed.

    Args:
        mesh: The file.
        reason: What ended the process.
    """
    return SweptMesh(mesh.name, error=f"{mesh.source}: {reason}")


def gather(
    targets: Iterable[Target], swept: Sequence[SweptMesh], settings: SweepSettings
) -> list[SweptTarget]:
    """Collect the sweep of each target: shapes in closed form, folders as the mean of their meshes.

    Args:
        targets: From `find_targets`.
        swept: All meshes of the targets, in any order.
        settings: Frictions and sensor resolutions of the sweep.
    """
    by_name = {mesh.name: mesh.sweep for mesh in swept}
    gathered = []
    for target in targets:
        sweeps = [by_name[mesh.name] for mesh in target.files]
        if not sweeps:
            shape = _swept(target.name, SHAPES[target.name](), settings, mode="scan")
            gathered.append(SweptTarget(target.name, shape))
        elif not target.folder:
            gathered.append(SweptTarget(target.name, sweeps[0]))
        else:
            members = tuple(one for one in sweeps if one is not None)
            name = f"{target.name} (mean of {len(members)})"
            mean = mean_sweep(members, name=name) if members else None
            gathered.append(SweptTarget(name, mean, members))
    return gathered


def _swept(
    name: str, source: AngleDistribution | LocatedGrasps, settings: SweepSettings, *, mode: Mode
) -> Sweep:
    return sweep(source, **settings.values, name=name, mode=mode)
