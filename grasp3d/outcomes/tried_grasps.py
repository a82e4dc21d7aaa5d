"""Grasps with outcomes, from files or memory: their poses, gripper and object."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path, PurePosixPath, PureWindowsPath
from typing import Any

import numpy as np

from grasp3d.arrays import Floats, Ints, locked, short_repr
from grasp3d.errors import ContactError, MeshError, SettingError
from grasp3d.formats import read_poses
from grasp3d.formats.poses import GraspPoses
from grasp3d.grasps.evaluation import in_stated_scale
from grasp3d.hand.hand import Hand
from grasp3d.hand.jaws import IN_METRES
from grasp3d.hand.parallel_gripper import ALIASES, PRESETS, ParallelGripper
from grasp3d.mesh import MeshSource, ObjectMesh, load_mesh
from grasp3d.quality.loads import Load
from grasp3d.settings import MeshOptions
from grasp3d.settings.units import MASSES, parse_quantity
from grasp3d.surface.load_case import mass_of
from grasp3d.system.documents import is_file, is_folder
from grasp3d.system.names import short_number

OUTCOMES = (
    "a table needs a column success (or outcome) with 1, 0 or nothing; name any other column or "
    "key with --outcome"
)
"""Ways to state outcomes, for error messages."""

MOST_NAMED = 5
"""Largest number of files that an error names."""


@dataclass(frozen=True)
class MeshFolder:
    """Folder in which the meshes of grasps are looked up, if any.

    Example:
        >>> from pathlib import Path
        >>> from grasp3d.outcomes.tried_grasps import MeshFolder
        >>> MeshFolder(Path("meshes")).find("scans/mug.glb", Path("log.csv")).name
        'mug.glb'
    """

    folder: Path | None = None

    def __post_init__(self) -> None:
        if self.folder is not None and not is_folder(self.folder):
            problem = "is a file" if is_file(self.folder) else "there is no such folder"
            raise MeshError(f"{self.folder}: {problem}; name the folder of the meshes")

    def find(self, stated: str | None, grasps: Path) -> Path:
        """Return the mesh file that a file of grasps names.

        The search covers the folder of that file and this folder: first the stated path, then its
        base name, which may also be in a subfolder of this folder.

        Args:
            stated: Path that the file of grasps states; None: it states none.
            grasps: The file of grasps.

        Raises:
            MeshError: Nothing is stated, or no file or several files fit.
        """
        if stated is None:
            raise MeshError(f"{grasps}: names no mesh file of its object; give it with --mesh FILE")
        windows, folder = PureWindowsPath(stated), self.folder
        path = PurePosixPath(windows.as_posix())
        if windows.drive or path.is_absolute() or ".." in path.parts:  # never out of the folder
            path = PurePosixPath(path.name)
        by_path = [grasps.parent / path, *([folder / path] if folder else [])]
        by_name = [grasps.parent / path.name, *self._by_base_name.get(path.name, [])]
        for tried in (by_path, by_name):
            files = list({file.resolve(): file for file in tried if is_file(file)}.values())
            if len(files) == 1:
                return files[0]
            if files:
                named = ", ".join(map(str, files[:MOST_NAMED]))
                raise MeshError(
                    f"{grasps}: names the mesh {stated!r}, and {len(files)} files fit: {named}; "
                    "give the one that is meant with --mesh FILE"
                )
        where = f"nor below {folder}" if folder else "(--meshes FOLDER: its folder)"
        raise MeshError(
            f"{grasps}: names the mesh {stated!r}, which is not beside it in {grasps.parent} "
            f"{where}: give the file with --mesh FILE"
        )

    @cached_property
    def _by_base_name(self) -> dict[str, list[Path]]:
        """All files below the folder, by base name."""
        paths: dict[str, list[Path]] = {}
        for path in sorted(self.folder.rglob("*")) if self.folder is not None else ():
            paths.setdefault(path.name, []).append(path)
        return paths


@dataclass(frozen=True, eq=False)
class TriedGrasps:
    """Grasps with outcomes, of one file or one object in memory, with their hand and mesh."""

    name: str
    poses: GraspPoses
    """The k poses that have an outcome."""
    numbers: Ints
    """Number of each in its file, from 1, shape (k,)."""
    not_tried: int
    """Number of grasps without an outcome, which are left out."""
    hand: Hand
    hand_from: str
    """Origin of the gripper, in words."""
    mesh: MeshSource

    __repr__ = short_repr


def check_grasps(
    sources: Sequence[str | Path | GraspPoses],
    *,
    mesh: MeshSource | None = None,
    meshes: Path | None = None,
    hand: Hand | None = None,
    outcome: str | None = None,
    **stated: Any,
) -> list[TriedGrasps]:
    """Read grasps and check them before any work: outcomes, gripper and mesh.

    Args:
        sources: Files of poses, or poses in memory.
        mesh: The mesh of all grasps; None: each file names its own.
        meshes: Folder in which the named meshes are looked up.
        hand: The gripper of all grasps; None: each file names its own.
        outcome: Name of the values that are outcomes; None: those of each format.
        stated: What else is known of the files, as `read_poses` takes it.

    Returns:
        The grasps of each source, in their order; at least one has outcomes.

    Raises:
        ContactError: A file is missing or damaged or has invalid outcomes, or no file has outcomes.
        SettingError: The gripper is not known.
        MeshError: A mesh is not found.
    """
    if not sources:
        raise ContactError("there are no grasps: name at least one file")
    folder, given = MeshFolder(meshes), {"outcome": outcome, **stated}
    checked = [_checked(source, mesh, folder, hand, given) for source in sources]
    if not any(grasps.poses.count for grasps in checked):
        names = ", ".join(grasps.name for grasps in checked[:MOST_NAMED])
        raise ContactError(f"{names}: no outcome is known of any grasp; {OUTCOMES}")
    return checked


def _checked(
    source: str | Path | GraspPoses,
    mesh: MeshSource | None,
    folder: MeshFolder,
    hand: Hand | None,
    stated: Mapping[str, Any],
) -> TriedGrasps:
    if isinstance(source, GraspPoses):
        path, poses, name = None, source.with_outcomes(stated["outcome"]), "poses"
        for name_of, value in stated.items():
            if value is not None and name_of != "outcome":
                raise SettingError(f"{name_of} applies to files; poses in memory have their own")
    else:
        path, name = Path(source), str(source)
        poses = read_poses(path, hand=hand, **stated)
    gripper, origin = _gripper(poses, hand, name)
    if path is not None and isinstance(poses.hand, str):  # the file states the hand, not the TCP
        poses = read_poses(path, hand=gripper, **stated)
    if mesh is None:
        if path is None:
            raise SettingError("poses in memory need the mesh of their object: mesh=...")
        mesh = folder.find(poses.object_file, path)
    tried = np.flatnonzero(~np.isnan(poses.outcome))
    return TriedGrasps(
        name=name,
        poses=poses if len(tried) == poses.count else poses.take(tried),
        numbers=tried + 1,
        not_tried=poses.count - len(tried),
        hand=gripper,
        hand_from=origin,
        mesh=mesh,
    )


def _gripper(poses: GraspPoses, hand: Hand | None, name: str) -> tuple[Hand, str]:
    """Return the given gripper, or the one that the poses state. Raises SettingError."""
    stated = poses.hand
    if hand is not None:
        return hand, "as given"
    if isinstance(stated, Hand):
        return stated, "as the file states"
    if stated is not None and ALIASES.get(stated, stated) in PRESETS:
        return ParallelGripper.preset(stated), f"as the file states ({stated})"
    reason = "states no gripper" if stated is None else f"states the gripper {stated!r}, unknown"
    raise SettingError(f"{name}: {reason}; give it with --hand NAME|FILE")


FAR = 2.0
"""Distance of a stated centre of mass from the object's centre, in object sizes, beyond which it
cannot be right."""

MASS_COLUMNS = ("mass", "object_mass")
"""Columns of poses that state the object's mass at each grasp [kg], or as texts with a unit."""

GIVEN, STATED, COLUMN = "as given", "as the file states", "by the column "
"""Origins of masses and centres of mass, in words."""

CENTERS = {
    "given": GIVEN,
    "volume": "of the volume, at uniform density",
    "surface": "not known, as the mesh is open: the middle of its surface",
}
"""Origins of a mesh's centre of mass, in words."""


@dataclass(frozen=True, eq=False)
class StatedObject:
    """Object as it is used to evaluate the grasps on it."""

    mesh: ObjectMesh
    load: Load | None
    """What each grasp must hold, except for masses of single grasps; None: the mass is not known,
    and no load was given."""
    masses: Floats
    """Mass at each pose [kg], shape (k,); nan: not known."""
    mass_from: str
    """Origin of the mass in words; empty if the mass is not known."""
    center_from: str
    """Origin of the centre of mass, in words."""

    @property
    def sources(self) -> str:
        """Mass and centre of mass with their origins, in words."""
        known = self.masses[~np.isnan(self.masses)]
        without = "no grip force" if self.load is None else "forces are for 1 kg"
        mass = f"not known, so {without} (give it with --mass)"
        if len(known):
            ends = dict.fromkeys(map(short_number, (known.min(), known.max())))
            mass = f"{' to '.join(ends)} kg, {self.mass_from}"
        return f"mass {mass}; centre of mass {self.center_from}"

    def parts(self, rows: Ints) -> Iterator[tuple[Ints, Load | None]]:
        """Yield the poses that have the same load, with that load.

        Args:
            rows: Indices of poses, shape (c,).
        """
        if not self.mass_from.startswith(COLUMN):
            yield rows, self.load
            return
        for mass in np.unique(self.masses[rows]).tolist():
            yield rows[self.masses[rows] == mass], replace(self.load or Load(), mass=mass)


def stated_object(
    source: MeshSource, poses: GraspPoses, options: MeshOptions | None, load: Load | None
) -> StatedObject:
    """Read the mesh of some poses, and apply what their file states about the object.

    Options take precedence: a mass or density of `load`, a centre of mass of `options`. For an open
    mesh, which has no centre of mass, the middle of the surface is used if none is stated.

    Args:
        source: The mesh.
        poses: Poses on it. Used are `object_scale`, a column of `MASS_COLUMNS`, else `mass` [kg],
            and `com` [m] of their settings, as in ACRONYM, in the frame of the scaled mesh.
        options: How the mesh is read.
        load: What each grasp must hold.

    Raises:
        MeshError: The input is not a mesh.
        SettingError: The unit is not known, or the load needs a value that is not known.
        ContactError: The file states an impossible mass or centre of mass.
    """
    mesh = in_stated_scale(load_mesh(source, options), poses)
    mesh.needs_metres(IN_METRES)
    center_from = CENTERS[mesh.report.center_mass_from]
    if center_from != GIVEN and poses.settings.get("com") is not None:
        mesh, center_from = _centered(mesh, _center(poses.settings["com"], mesh)), STATED
    masses, mass_from = np.full(poses.count, math.nan), ""
    if load is not None and (load.mass is not None or load.density is not None):
        mass_from = GIVEN
    elif (stated := _mass_column(poses)) is not None:
        mass_from, masses = stated
    elif (mass := poses.settings.get("mass")) is not None:
        load = replace(load or Load(), mass=_mass(mass, "the mass that the grasps state"))
        mass_from = STATED
    if center_from == CENTERS["surface"] and (load is not None or mass_from):
        mesh = _centered(mesh, mesh.center_mass)
    if load is not None and (known := mass_of(mesh, load)) is not None:
        masses = np.full(poses.count, known)
    return StatedObject(mesh, load, locked(masses), mass_from, center_from)


def _center(stated: Any, mesh: ObjectMesh) -> Floats:
    """Return the centre of mass that a file states. Raises ContactError."""
    try:
        center = np.array(stated, dtype=np.float64).reshape(3)
        away = float(np.linalg.norm(center - mesh.center)) / mesh.size
    except (TypeError, ValueError):
        away = math.nan
    if not away <= FAR:
        raise ContactError(
            f"the centre of mass that the grasps state (object/com), {stated!r}, must be three "
            f"numbers [m] near {mesh.report.source}: is it the right mesh, in the right unit?"
        )
    return center


def _centered(mesh: ObjectMesh, center: Floats) -> ObjectMesh:
    """Return the mesh with a centre of mass that counts as given."""
    x, y, z = center.tolist()
    options = replace(mesh.options, center_of_mass=(x, y, z))
    report = replace(mesh.report, center_mass_from="given")
    return replace(mesh, center_mass=locked(center), options=options, report=report)


def _mass_column(poses: GraspPoses) -> tuple[str, Floats] | None:
    """Origin and values of a column of masses; None if there is none, or only an empty one."""
    for name in filter(poses.columns.__contains__, MASS_COLUMNS):
        values = poses.columns[name].tolist()
        if all(value in ("", None) or value != value for value in values):  # noqa: PLR0124, nan
            continue
        pairs = zip(values, poses.names, strict=True)
        return f"{COLUMN}{name}", np.array([_mass(one, f"{name} of {of}") for one, of in pairs])
    return None


def _mass(value: Any, name: str) -> float:
    """Return a mass that grasps state [kg]. Raises ContactError."""
    try:
        return parse_quantity(name, value, MASSES)
    except SettingError as error:
        raise ContactError(f"{error}") from error
