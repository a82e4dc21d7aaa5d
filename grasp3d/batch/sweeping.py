"""Sweeping what a command line names: shapes in closed form, mesh files, folders of meshes."""

import math
import time
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace

from grasp3d.batch.batch_settings import ROUNDING
from grasp3d.batch.inputs import MeshFile, find_meshes, real_place
from grasp3d.errors import GraspError, SettingError
from grasp3d.planar import Circle, square
from grasp3d.settings import GraspModel, MeshOptions, Sampling, check_searched, search_cone
from grasp3d.stability.angle_distributions import AngleDistribution, SphereAngles
from grasp3d.stability.label import Mode
from grasp3d.storage import local_copy, local_path
from grasp3d.sweeps import Sweep, mean_sweep, sweep
from grasp3d.system.progress import Progress

SHAPES: dict[str, Callable[[], AngleDistribution]] = {
    "circle": Circle,
    "square": square,
    "sphere": SphereAngles,
}
"""What is known in closed form: one finger fixed (on the square in the middle of a side)."""

FEW = 6
"""Meshes of a folder that are shown one by one."""


@dataclass(frozen=True)
class SweepSettings:
    """What all meshes are swept over, and how they are labelled."""

    friction: tuple[float, ...]
    """Coulomb coefficients."""
    sensor_resolution: tuple[float, ...]
    """Resolutions alpha [rad]."""
    sampling: Sampling = field(default_factory=Sampling)
    """Its search angle, if given, is wide enough for all of them."""
    mesh: MeshOptions = field(default_factory=MeshOptions)
    fingers: int = 2

    def __post_init__(self) -> None:
        if not self.friction or not self.sensor_resolution:
            raise SettingError("a sweep needs at least one friction and one sensor resolution")
        for friction in self.friction:
            GraspModel(friction=friction)
        for resolution in self.sensor_resolution:
            GraspModel(sensor_resolution=resolution)
        check_searched(self.model, self.sampling)
        given, needed = self.sampling.search_angle, search_cone(self.model, Sampling())
        if given is not None and given < needed - ROUNDING:
            raise SettingError(
                f"search angle must be at least atan(friction) + alpha/2 of the largest of both, "
                f"{math.degrees(needed):.4g} degrees; got {math.degrees(given):.4g}"
            )

    @property
    def model(self) -> GraspModel:
        """Largest friction and coarsest resolution: they need the widest search."""
        return GraspModel(
            friction=max(self.friction),
            sensor_resolution=max(self.sensor_resolution),
            fingers=self.fingers,
        )


@dataclass(frozen=True)
class Target:
    """One thing to sweep: a shape, a mesh file, or several: a folder, a pattern, a list."""

    name: str
    given: str = ""
    """As it was given."""
    files: tuple[MeshFile, ...] = ()
    """Of a file this one, of a folder its meshes, of a shape none."""
    folder: bool = False
    """Whether it is several: a folder, a pattern or a list."""


@dataclass(frozen=True, eq=False)
class SweptMesh:
    """What came of one mesh; `error` is empty for one that was swept."""

    name: str
    sweep: Sweep | None = None
    error: str = ""
    warnings: tuple[str, ...] = ()
    crease_fraction: float = 0.0
    """As in `ObjectMesh`."""
    seconds: float = 0.0


@dataclass(frozen=True, eq=False)
class SweptTarget:
    """What came of one target."""

    name: str
    sweep: Sweep | None
    """Its own; of a folder the mean over its meshes; None: no mesh of it could be swept."""
    members: tuple[Sweep, ...] = ()
    """Of a folder the sweeps that the mean was taken over."""

    @property
    def sweeps(self) -> tuple[Sweep, ...]:
        """All of them, the mean last."""
        return self.members if self.sweep is None else (*self.members, self.sweep)

    @property
    def shown(self) -> tuple[Sweep, ...]:
        """Those to look at: of a folder with more than a few meshes the mean alone."""
        return self.sweeps if len(self.members) <= FEW else self.sweeps[-1:]


def find_targets(words: Iterable[str]) -> list[Target]:
    """Tell shapes, mesh files and folders apart; a word is a shape before it is a file.

    Args:
        words: The name of a shape, or an input of `find_meshes`; `./circle` is a path in any case.

    Returns:
        In their order, each once. Meshes are called by their file's name, those of a folder with
        their path below it; where two names meet, as they were given.

    Raises:
        SettingError: There is none.
        MeshError: A path is missing, or a folder holds no mesh.
    """
    targets: dict[str, Target] = {}
    for word in words:
        if word in SHAPES:
            targets.setdefault(word, Target(word))
            continue
        found = tuple(find_meshes([word]))
        path = local_path(word)
        given = word.rstrip("/") if path is None else str(path)
        folder = len(found) != 1 or found[0].source != given
        name = found[0].name
        if folder:
            name = given.rpartition("/")[2] if path is None else path.name
            if path is not None and name in {"", ".."}:
                name = path.resolve().name
        place = real_place(given)
        targets.setdefault(f"{place}/" if folder else place, Target(name, given, found, folder))
    if not targets:
        raise SettingError(
            f"nothing to sweep: name a mesh file, a folder of meshes, or {', '.join(SHAPES)}"
        )
    return _told_apart(list(targets.values()))


def _told_apart(targets: list[Target]) -> list[Target]:
    """Name meshes and folders as they were given where short names meet; one name for each file."""
    first: dict[str, MeshFile] = {}
    for target in targets:
        for mesh in target.files:
            first.setdefault(real_place(mesh.source), mesh)
    often = Counter(mesh.name for mesh in first.values())
    often.update(target.name for target in targets if target.folder or not target.files)
    named = {
        place: mesh if often[mesh.name] == 1 else replace(mesh, name=mesh.source)
        for place, mesh in first.items()
    }
    told = []
    for target in targets:
        files = tuple(named[real_place(mesh.source)] for mesh in target.files)
        name = target.name
        if target.folder:
            name = target.name if often[target.name] == 1 else target.given
        elif files:
            name = files[0].name
        told.append(replace(target, name=name, files=files))
    return told


def check_fingers(targets: Iterable[Target], settings: SweepSettings) -> None:
    """Refuse shapes in closed form for more fingers than they are known for.

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


def sweep_mesh(
    mesh: MeshFile,
    settings: SweepSettings,
    *,
    threads: int | None = 1,
    progress: Progress | None = None,
) -> SweptMesh:
    """Label a mesh file once and take its shares at all frictions and resolutions.

    Args:
        mesh: The file.
        settings: What to sweep over, and how to label.
        threads: Threads to use; None: one per processor.
        progress: Called with the share of the work done, from 0 to 1.

    Returns:
        The sweep; of a mesh that cannot be labelled the reason.
    """
    # Loaded here: whoever plans a sweep needs no rays and no compiler.
    from grasp3d.diagnosis import length_warnings
    from grasp3d.mesh import prepare_file
    from grasp3d.surface.labelling import label_surface

    begun = time.perf_counter()
    try:
        with local_copy(mesh.source) as path:
            surface = prepare_file(path, settings.mesh, threads=threads)
        labels = label_surface(
            surface,
            settings.model,
            sampling=settings.sampling,
            threads=threads,
            progress=progress,
        )
    except GraspError as error:
        return SweptMesh(mesh.name, error=str(error), seconds=time.perf_counter() - begun)
    warnings = length_warnings(
        surface.size, surface.unit, settings.model, settings.sampling, settings.mesh
    )
    return SweptMesh(
        mesh.name,
        _swept(mesh.name, labels.angle_distribution(), settings, mode=labels.mode),
        warnings=(*surface.report.warnings, *warnings),
        crease_fraction=surface.crease_fraction,
        seconds=time.perf_counter() - begun,
    )


def lost_mesh(mesh: MeshFile, reason: str) -> SweptMesh:
    """What came of a mesh whose process did not come back.

    Args:
        mesh: The file.
        reason: What ended the process.
    """
    return SweptMesh(mesh.name, error=f"{mesh.source}: {reason}")


def gather(
    targets: Iterable[Target], swept: Sequence[SweptMesh], settings: SweepSettings
) -> list[SweptTarget]:
    """Give each target its sweep: shapes in closed form, folders the mean of what was swept.

    Args:
        targets: From `find_targets`.
        swept: Every mesh of theirs, in any order.
        settings: What was swept over.
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
    name: str, distribution: AngleDistribution, settings: SweepSettings, *, mode: Mode
) -> Sweep:
    return sweep(
        distribution,
        friction=settings.friction,
        sensor_resolution=settings.sensor_resolution,
        name=name,
        mode=mode,
    )
