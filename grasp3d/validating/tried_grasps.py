"""Files of grasps with outcomes: their poses, their gripper, and their object."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path, PurePosixPath, PureWindowsPath
from typing import Any

import numpy as np

from grasp3d.arrays import Floats, Ints, locked, short_repr
from grasp3d.errors import ContactError, MeshError, SettingError
from grasp3d.grasps.evaluation import in_stated_scale
from grasp3d.grasps.pose_files import read_poses
from grasp3d.grasps.pose_files.outcomes import with_outcomes
from grasp3d.grasps.poses import GraspPoses
from grasp3d.hand.hand import Hand
from grasp3d.hand.jaws import IN_METRES
from grasp3d.hand.parallel_gripper import ALIASES, PRESETS, preset
from grasp3d.mesh import MeshSource, ObjectMesh, load_mesh
from grasp3d.quality.loads import Load
from grasp3d.settings import MeshOptions
from grasp3d.settings.units import MASSES, parse_quantity
from grasp3d.surface.load_case import mass_of
from grasp3d.system.documents import is_file, is_folder

ACRONYM = (".h5", ".hdf5")
"""Endings of files whose grasps are of a Franka hand where they state no gripper."""

KEPT = 100_000
"""Most poses of all files that are kept between checking the files and evaluating their poses."""

OUTCOMES = (
    "a table needs a column success (or outcome) with 1, 0 or nothing, GraspGen and ACRONYM "
    "object_in_gripper; what else states it is named with --outcome"
)
"""What states outcomes, for error messages."""

MOST_NAMED = 5
"""Most files that an error names."""


@dataclass(frozen=True)
class MeshFolder:
    """A folder in which the meshes of grasps are looked up, or none.

    Example:
        >>> from pathlib import Path
        >>> from grasp3d.validating.tried_grasps import MeshFolder
        >>> MeshFolder(Path("meshes")).find("scans/mug.glb", Path("log.csv")).name
        'mug.glb'
    """

    folder: Path | None = None

    def __post_init__(self) -> None:
        if self.folder is not None and not is_folder(self.folder):
            problem = "is a file" if is_file(self.folder) else "there is no such folder"
            raise MeshError(f"{self.folder}: {problem}; name the folder of the meshes")

    def find(self, stated: str | None, grasps: Path) -> Path:
        """The mesh file that a file of grasps names.

        It is looked up beside that file and in the folder: first by the path that is stated, then
        by its base name, in the folder also in subfolders.

        Args:
            stated: What the file of grasps states; None: nothing.
            grasps: The file of grasps.

        Raises:
            MeshError: Nothing is stated, or no file or several files fit.
        """
        if stated is None:
            raise MeshError(f"{grasps}: names no mesh file of its object; give it with --mesh FILE")
        relative = _safe(stated)
        by_path = [grasps.parent / relative, *([self.folder / relative] if self.folder else [])]
        by_name = [grasps.parent / relative.name, *self._by_base_name.get(relative.name, [])]
        for files in map(_distinct, (by_path, by_name)):
            if len(files) == 1:
                return files[0]
            if files:
                named = ", ".join(map(str, files[:MOST_NAMED]))
                raise MeshError(
                    f"{grasps}: names the mesh {stated!r}, and {len(files)} files fit: {named}; "
                    "give the one that is meant with --mesh FILE"
                )
        raise MeshError(f"{grasps}: names the mesh {stated!r}, which is not {self._where(grasps)}")

    @cached_property
    def _by_base_name(self) -> dict[str, list[Path]]:
        """All files below the folder by their base names."""
        paths: dict[str, list[Path]] = {}
        for path in sorted(self.folder.rglob("*")) if self.folder is not None else ():
            if path.is_file():
                paths.setdefault(path.name, []).append(path)
        return paths

    def _where(self, grasps: Path) -> str:
        beside = f"beside it in {grasps.parent}"
        if self.folder is None:
            return f"{beside}: give its folder with --meshes FOLDER, or the file with --mesh FILE"
        return f"{beside} nor below {self.folder}: give the file with --mesh FILE"


def _safe(stated: str) -> PurePosixPath:
    """The path that is stated, below some folder: of others only the base name counts."""
    path = PurePosixPath(PureWindowsPath(stated).as_posix())
    inside = not path.is_absolute() and ".." not in path.parts and not PureWindowsPath(stated).drive
    return path if inside else PurePosixPath(path.name)


def _distinct(paths: list[Path]) -> list[Path]:
    """Files that exist, each once."""
    files = {path.resolve(): path for path in reversed(paths) if is_file(path)}
    return list(reversed(files.values()))


@dataclass(frozen=True, eq=False)
class TriedGrasps:
    """The grasps of one file, or of one object in memory, with what they are of."""

    name: str
    path: Path | None
    """None: poses in memory."""
    count: int
    """Grasps with an outcome."""
    held: int
    """Grasps that held."""
    not_tried: int
    """Grasps without an outcome, which are left out."""
    hand: Hand
    hand_from: str
    """Where the gripper is from, in words."""
    mesh: MeshSource
    kept: GraspPoses | None
    stated: Mapping[str, Any]
    """What is stated of the file, as `read_poses` takes it."""

    __repr__ = short_repr

    def poses(self) -> tuple[GraspPoses, Ints]:
        """The poses with an outcome, and the number of each in its file, from 1, shape (k,).

        Raises:
            ContactError: The file is not what it was when it was checked.
        """
        poses = self.kept
        if poses is None:
            assert self.path is not None
            poses = read_poses(self.path, hand=self.hand, **self.stated)
        tried = np.flatnonzero(~np.isnan(poses.outcome))
        if len(tried) != self.count:
            raise ContactError(f"{self.name}: was changed while it was read")
        return poses if len(tried) == poses.count else poses.take(tried), tried + 1


def check_grasps(
    sources: Sequence[str | Path | GraspPoses],
    *,
    mesh: MeshSource | None = None,
    meshes: Path | None = None,
    hand: Hand | None = None,
    outcome: str | None = None,
    load: Load | None = None,
    **stated: Any,
) -> list[TriedGrasps]:
    """Check grasps before any work: outcomes, gripper and mesh of each.

    Args:
        sources: Files of poses, or poses in memory.
        mesh: The mesh of all of them; None: each file names its own.
        meshes: Folder in which these are looked up.
        hand: The gripper of all of them; None: each file names its own.
        outcome: Name of the values that are outcomes; None: those of each format.
        load: What each grasp must hold; without a mass those of the grasps are used.
        stated: What else is stated of the files, as `read_poses` takes it.

    Returns:
        The grasps of each source, in their order; at least one has outcomes.

    Raises:
        ContactError: A file is missing or damaged, has other values than outcomes or masses, none
            has outcomes, or all are alike that `outcome` names.
        SettingError: The gripper is not known.
        MeshError: A mesh is not found.
    """
    if not sources:
        raise ContactError("there are no grasps: name at least one file")
    folder = MeshFolder(meshes)
    checked: list[TriedGrasps] = []
    for source in sources:
        room = KEPT - sum(tried.count for tried in checked if tried.kept is not None)
        checked.append(
            _checked(source, mesh, folder, hand, {"outcome": outcome, **stated}, room, load)
        )
    if not any(grasps.count for grasps in checked):
        names = ", ".join(grasps.name for grasps in checked[:5])
        raise ContactError(f"{names}: no outcome is known of any grasp; {OUTCOMES}")
    _check_varied(checked, outcome)
    return checked


def _check_varied(checked: Sequence[TriedGrasps], outcome: str | None) -> None:
    """Refuse values that are named as outcomes, but are all alike. Raises ContactError."""
    held, count = (sum(getattr(one, name) for one in checked) for name in ("held", "count"))
    if outcome is not None and held in (0, count):
        became = "held" if held else "failed"
        raise ContactError(
            f"{checked[0].name}: with the outcome {outcome!r} all {count} grasps {became}, so "
            "no score can be ranked: name other values"
        )


def _checked(
    source: str | Path | GraspPoses,
    mesh: MeshSource | None,
    folder: MeshFolder,
    hand: Hand | None,
    stated: Mapping[str, Any],
    room: int,
    load: Load | None,
) -> TriedGrasps:
    if isinstance(source, GraspPoses):
        path, poses, name, acronym = None, with_outcomes(source, stated["outcome"]), "poses", False
        for name_of, value in stated.items():
            if value is not None and name_of != "outcome":
                raise SettingError(f"{name_of} is that of files; poses in memory have their own")
    else:
        path, name = Path(source), str(source)
        acronym = path.suffix.lower() in ACRONYM
        poses = read_poses(path, hand=hand, **stated)
    gripper, origin = _gripper(poses, hand, name, acronym=acronym)
    if not gripper.fingers:  # it closes on nothing by itself
        gripper.check_fingers(2)
    if path is not None and acronym and hand is None:  # it states the hand, not the TCP
        poses = read_poses(path, hand=gripper, **stated)
    if mesh is None:
        if path is None:
            raise SettingError("poses in memory need the mesh of their object: mesh=...")
        mesh = folder.find(poses.object_file, path)
    tried = ~np.isnan(poses.outcome)
    if not _has_mass(load):
        try:
            _mass_column(poses.take(np.flatnonzero(tried)))
        except ContactError as error:
            raise ContactError(f"{name}: {error}") from error
    return TriedGrasps(
        name=name,
        path=path,
        count=int(tried.sum()),
        held=int((poses.outcome == 1.0).sum()),
        not_tried=int((~tried).sum()),
        hand=gripper,
        hand_from=origin,
        mesh=mesh,
        kept=poses if path is None or poses.count <= room else None,
        stated=stated,
    )


def _gripper(poses: GraspPoses, hand: Hand | None, name: str, *, acronym: bool) -> tuple[Hand, str]:
    """The gripper that is given, or that the poses state. Raises SettingError."""
    if hand is not None:
        return hand, "as given"
    stated = poses.hand
    if isinstance(stated, Hand):
        return stated, "as the file states"
    if stated is not None and ALIASES.get(stated, stated) in PRESETS:
        return preset(stated), f"as the file states ({stated})"
    if stated is None and acronym:
        return preset("franka"), "ACRONYM's grasps are of a Franka hand"
    reason = "states no gripper" if stated is None else f"states the gripper {stated!r}, unknown"
    raise SettingError(f"{name}: {reason}; give it with --hand NAME|FILE")


FAR = 2.0
"""Distance of a stated centre of mass from the object's centre, in object sizes, that cannot be
meant."""


MASS_COLUMNS = ("mass", "object_mass")
"""Columns of poses that state the object's mass at each grasp [kg], or as texts with a unit."""

OPEN = "is open, and no centre of mass is stated: the load pulls at the middle of its surface"
"""What is assumed of an open mesh under a load."""


@dataclass(frozen=True, eq=False)
class StatedObject:
    """An object as the grasps on it are evaluated."""

    mesh: ObjectMesh
    load: Load | None
    """What each grasp must hold, but for masses of single grasps; None: the mass is not known, and
    no load was given."""
    masses: Floats
    """Mass at each pose [kg], shape (k,); nan: not known."""
    mass_from: str
    """given, file, column NAME, `ONE`, or empty."""
    center_from: str
    """given, file, or what the mesh's report says: volume or surface."""
    warnings: tuple[str, ...] = ()
    """What was assumed of the object, one sentence each."""

    def parts(self, rows: Ints) -> Iterator[tuple[Ints, Load | None]]:
        """Poses with the same load, and that load.

        Args:
            rows: Indices of poses, shape (c,).
        """
        if not self.mass_from.startswith(COLUMN):
            yield rows, self.load
            return
        for mass in np.unique(self.masses[rows]).tolist():
            yield rows[self.masses[rows] == mass], replace(self.load or Load(), mass=mass)


COLUMN, ONE = "column ", "1 kg"
"""Start of the origin of masses of single grasps, and that of a load whose mass is not known."""


def stated_object(
    source: MeshSource, poses: GraspPoses, options: MeshOptions | None, load: Load | None
) -> StatedObject:
    """Read the mesh of some poses, and take over what their file states of the object.

    What the options state is used first: a mass or density of `load`, a centre of mass of
    `options`. An open mesh has no centre of mass: where none is stated, that of its surface is
    used, with a warning.

    Args:
        source: The mesh.
        poses: Poses on it; `object_scale`, a column of `MASS_COLUMNS`, else `mass` [kg], and `com`
            [m] of their settings, as ACRONYM states them, in the frame of the scaled mesh.
        options: How the mesh is read.
        load: What each grasp must hold.

    Raises:
        MeshError: It is no mesh.
        SettingError: Its unit is not known, or the load needs what is not known.
        ContactError: The file states an impossible mass or centre of mass.
    """
    mesh = in_stated_scale(load_mesh(source, options), poses)
    mesh.needs_metres(IN_METRES)
    own_center = mesh.report.center_mass_from == "given"
    mesh = mesh if own_center else _with_center(mesh, poses)
    center_from = mesh.report.center_mass_from
    if center_from == "given" and not own_center:
        center_from = "file"
    masses, origin = np.full(poses.count, math.nan), ""
    if _has_mass(load):
        origin = "given"
    elif (stated := _mass_column(poses)) is not None:
        origin, masses = stated
    elif (mass := poses.settings.get("mass")) is not None:
        mass, origin = _mass(mass, "the mass that the grasps state"), "file"
        load = replace(load or Load(), mass=mass)
    elif load is not None:
        origin = ONE
    warnings: tuple[str, ...] = ()
    if center_from == "surface" and origin:
        warnings = (f"{mesh.report.source}: {OPEN} (--center-of-mass)",)
        mesh = _centered(mesh, mesh.center_mass)
    if load is not None and (known := mass_of(mesh, load)) is not None:
        masses = np.full(poses.count, known)
    return StatedObject(mesh, load, locked(masses), origin, center_from, warnings)


def _with_center(mesh: ObjectMesh, poses: GraspPoses) -> ObjectMesh:
    """The mesh with the centre of mass that a file states."""
    stated = poses.settings.get("com")
    if stated is None:
        return mesh
    try:
        center = np.array(stated, dtype=np.float64)
    except (TypeError, ValueError):
        center = np.zeros(0)
    if center.shape != (3,) or not np.isfinite(center).all():
        raise ContactError("the centre of mass that the grasps state must be three numbers")
    away = float(np.linalg.norm(center - mesh.center)) / mesh.size
    if not away <= FAR:
        raise ContactError(
            f"the centre of mass that the grasps state (object/com) is {away:.3g} object sizes "
            f"away from {mesh.report.source}: is it the right mesh, in the right unit?"
        )
    return _centered(mesh, center)


def _centered(mesh: ObjectMesh, center: Floats) -> ObjectMesh:
    """The mesh with a centre of mass that counts as given."""
    x, y, z = center.tolist()
    return replace(
        mesh,
        center_mass=locked(center),
        options=replace(mesh.options, center_of_mass=(x, y, z)),
        report=replace(mesh.report, center_mass_from="given"),
    )


def _has_mass(load: Load | None) -> bool:
    return load is not None and (load.mass is not None or load.density is not None)


def _mass_column(poses: GraspPoses) -> tuple[str, Floats] | None:
    """Origin and values of a column of masses; None: there is none, or it is empty."""
    for name in filter(poses.columns.__contains__, MASS_COLUMNS):
        values = poses.columns[name].tolist()
        empty = [value in ("", None) or value != value for value in values]  # noqa: PLR0124, nan
        if all(empty):
            continue
        if any(empty):
            raise ContactError(
                f"{poses.names[empty.index(True)]} has no {name}, which other grasps have: state "
                "it, or give one mass for all with --mass"
            )
        pairs = zip(values, poses.names, strict=True)
        return f"{COLUMN}{name}", np.array([_mass(one, f"{name} of {of}") for one, of in pairs])
    return None


def _mass(value: Any, name: str) -> float:
    """A mass that grasps state [kg]. Raises ContactError."""
    try:
        return parse_quantity(name, value, MASSES)
    except SettingError as error:
        raise ContactError(f"{error}") from error
