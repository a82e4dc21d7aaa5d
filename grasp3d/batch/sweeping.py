"""Sweeps of shapes in closed form and of many mesh files, and the mean over these."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field

from grasp3d.batch.inputs import MeshFile, find_meshes
from grasp3d.batch.storage.files import local_copy
from grasp3d.errors import GraspError, SettingError
from grasp3d.hand.reach_settings import ReachSettings
from grasp3d.planar import Circle, Square
from grasp3d.settings import (
    GraspModel,
    MeshOptions,
    Sampling,
    check_search_settings,
    search_cone,
)
from grasp3d.settings.sampling import check_search_angle
from grasp3d.stability.angle_distributions import AngleDistribution, SphereAngles
from grasp3d.stability.label import Mode
from grasp3d.surface.sweeps import Sweep, mean_sweep, sweep
from grasp3d.system.context import running

SHAPES: dict[str, Callable[[], AngleDistribution]] = {
    "circle": Circle,
    "square": Square,
    "sphere": SphereAngles,
}
"""Shapes in closed form, with one finger fixed (on the square in the middle of a side)."""


@dataclass(frozen=True)
class SweepSettings:
    """Frictions and sensor resolutions of a sweep, and how to label.

    Attributes:
        friction: Coulomb coefficients.
        sensor_resolution: Resolutions alpha [rad].
        sampling: How grasps are searched for. Its search angle, if given, must cover all frictions
            and resolutions.
    """

    friction: tuple[float, ...]
    sensor_resolution: tuple[float, ...]
    sampling: Sampling = field(default_factory=Sampling)
    mesh: MeshOptions = field(default_factory=MeshOptions)
    fingers: int = 2
    reach: ReachSettings = field(default_factory=ReachSettings)

    def __post_init__(self) -> None:
        if not self.friction or not self.sensor_resolution:
            raise SettingError("a sweep needs at least one friction and one sensor resolution")
        for friction in self.friction:
            GraspModel(friction=friction)
        for resolution in self.sensor_resolution:
            GraspModel(sensor_resolution=resolution)
        check_search_settings(self.model, self.sampling)
        check_search_angle(self.sampling, search_cone(self.model))

    @property
    def model(self) -> GraspModel:
        """Largest friction and coarsest resolution, which need the widest search."""
        return GraspModel(
            friction=max(self.friction),
            sensor_resolution=max(self.sensor_resolution),
            fingers=self.fingers,
        )


@dataclass(frozen=True, eq=False)
class SweptMesh:
    """The sweep of one mesh; `error` is empty if it succeeded."""

    name: str
    sweep: Sweep | None = None
    error: str = ""
    warnings: tuple[str, ...] = ()


def find_targets(inputs: Iterable[str]) -> tuple[list[str], list[MeshFile]]:
    """Find the shapes and meshes to sweep; the name of a shape takes precedence over a file name.

    Args:
        inputs: Names of shapes, or inputs of `find_meshes`; `./circle` is always a path.

    Returns:
        Names of shapes, and meshes; each once.

    Raises:
        SettingError: There is no input.
        MeshError: A path is missing, or there is no mesh in the inputs that are no shapes.
    """
    distinct = list(dict.fromkeys(inputs))
    if not distinct:
        raise SettingError(
            f"nothing to sweep: name a mesh file, a folder of meshes, or {', '.join(SHAPES)}"
        )
    paths = [item for item in distinct if item not in SHAPES]
    shapes = [item for item in distinct if item in SHAPES]
    return shapes, find_meshes(paths) if paths else []


def sweep_mesh(mesh: MeshFile, settings: SweepSettings, *, force: bool = False) -> SweptMesh:
    """Label a mesh file once, and compute its area fractions at all frictions and resolutions.

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
            refuse_lengths(surface, settings.sampling)
        scene = Scene.of(settings.reach, surface)
        labels = label_surface(surface, settings.model, sampling=settings.sampling, scene=scene)
    except GraspError as error:
        return SweptMesh(mesh.name, error=str(error))
    return SweptMesh(
        mesh.name,
        _swept(mesh.name, labels.angle_distribution(), settings, mode="label"),
        warnings=labels.warnings,
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


def sweep_shape(name: str, settings: SweepSettings) -> Sweep:
    """Compute the area fractions of a shape in closed form.

    Args:
        name: One of `SHAPES`.
        settings: Frictions and sensor resolutions of two fingers.

    Raises:
        SettingError: The settings are for more fingers.
    """
    if settings.fingers != 2:
        raise SettingError(
            f"{name} is known in closed form for two fingers only; got {settings.fingers}"
        )
    return _swept(name, SHAPES[name](), settings, mode="scan")


def mean_of(sweeps: Sequence[Sweep]) -> list[Sweep]:
    """The mean over the sweeps of meshes, if there are several.

    Args:
        sweeps: The sweeps.
    """
    if len(sweeps) < 2:
        return []
    return [mean_sweep(sweeps, name=f"mean of {len(sweeps)} meshes")]


def _swept(name: str, angles: AngleDistribution, settings: SweepSettings, *, mode: Mode) -> Sweep:
    return sweep(
        angles,
        friction=settings.friction,
        sensor_resolution=settings.sensor_resolution,
        name=name,
        mode=mode,
    )
