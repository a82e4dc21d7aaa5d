"""The project's own formats (JSON, CSV, Parquet): contacts, and what their files of poses share."""

import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from grasp3d.arrays import Floats
from grasp3d.errors import ContactError, OutputError, SettingError
from grasp3d.formats import checks
from grasp3d.formats.checks import Values, outcomes_of
from grasp3d.formats.format import Given
from grasp3d.formats.poses import OWN_NAMES, STAGES, VECTOR_COLUMNS, GraspPoses
from grasp3d.hand.frames import GripperFrame, ObjectPose
from grasp3d.hand.hand import Hand
from grasp3d.hand.hand_files import hand_of
from grasp3d.hand.robot_files import FORMAT as ARTICULATED
from grasp3d.mesh.object_mesh import scale_of
from grasp3d.settings import MAX_FINGERS
from grasp3d.settings.units import METRES, Unit
from grasp3d.surface.grasp_table import GraspTable
from grasp3d.system.documents import described, load_json, newer_version, package_version
from grasp3d.system.files import check_suffix
from grasp3d.system.limited_reading import read_file
from grasp3d.system.names import unsupported

OBJECT = (None, "", "object")
"""Values that mean the object's frame, also where none is stated."""

CONVENTIONS = {"normals": "outward", "angles": "radians"}

CONTENT = (
    "poses of the gripper: z approach direction, x closing axis from finger 1 to finger 2, origin "
    "at the tool centre point between the fingertips, unless gripper_frame states another frame"
)

OF_ALL = ("unit", "object_pose", "frame", "gripper_frame")
"""Columns that have the same value in every row."""


def header_of(poses: GraspPoses) -> dict[str, Any]:
    """Header of a file: version, unit, frames, normals' direction, gripper, object, settings."""
    hand, at = poses.hand, poses.object_pose
    return {
        **poses.settings,
        "version": package_version(),
        "content": CONTENT,
        "unit": poses.unit or "unknown",
        "frame": "object" if at is None else at.frame,
        "gripper_frame": str(poses.gripper_frame),
        **CONVENTIONS,
        "gripper": hand if hand is None or isinstance(hand, str) else hand.description(),
        "object_file": poses.object_file,
        "object_scale": poses.object_scale,
        "object_pose": at and str(at),
    }


STATED = frozenset({
    "version", "content", "gripper", "object_file", "object_scale", *OF_ALL, *CONVENTIONS
})  # fmt: skip
"""Keys of a header that are no settings."""


def _fields_of(header: Mapping[str, Any], given: Given) -> dict[str, Any]:
    """Fields of `GraspPoses` that a header states; a given gripper replaces that of the file."""
    at, frame, of_gripper, file = (
        checks.text_or_none(header.get(name), name)
        for name in ("object_pose", "frame", "gripper_frame", "object_file")
    )
    for name, value in CONVENTIONS.items():
        if header.get(name, value) != value:
            raise ContactError(f"{name} must be {value}; got {described(header[name])}")
    if newer := newer_version(header.get("version")):
        raise ContactError(newer)
    other = {} if at or frame in OBJECT else {"frame": frame}
    return {
        "unit": stated_unit(header.get("unit"), given.unit),
        "hand": given.hand or _gripper(header.get("gripper")),
        "object_file": file,
        "object_scale": checks.number_or_none(header.get("object_scale"), "object_scale"),
        "object_pose": ObjectPose.of(at) if at else None,
        "gripper_frame": GripperFrame.of(of_gripper or "tcp"),
        "assumes_frame": not of_gripper,
        "settings": other | {name: value for name, value in header.items() if name not in STATED},
    }


def stated_unit(stated: object, default: Unit | None) -> Unit | None:
    """The unit that a file states, or else the given one.

    Raises:
        ContactError: The file states no valid unit, or one that differs from the given one.
    """
    if stated in (None, "", "unknown"):
        return default
    unit = next((unit for unit in METRES if unit == stated), None)
    if unit is None:
        raise ContactError(f"the unit must be one of {', '.join(METRES)}; got {described(stated)}")
    if default not in {None, unit}:
        raise ContactError(f"it states the unit {unit}, not {default}: read it without a unit")
    return unit


def _gripper(value: object) -> Hand | str | None:
    if value is None or isinstance(value, str):
        return value
    try:
        return hand_of(value)
    except SettingError as error:
        if isinstance(value, dict) and value.get("format") == ARTICULATED:
            return str(value.get("name", "a hand with joints"))  # its model is in another file
        raise ContactError(f"its gripper {error}") from error


def stated_in(columns: Mapping[str, Iterable[Any]]) -> dict[str, str]:
    """Values of columns that must be the same in all rows. Raises ContactError if they differ."""
    stated: dict[str, str] = {}
    for name in filter(columns.__contains__, OF_ALL):
        stated[name], *others = {"" if value is None else str(value) for value in columns[name]}
        if others:
            raise ContactError(f"all grasps must have the same {name}")
    return stated


def joint_names(poses: GraspPoses) -> tuple[str, ...]:
    """Names of the joints of postures, or else of the hand. Raises OutputError."""
    names = poses.joint_names or getattr(poses.hand, "joint_names", ())
    if poses.posture.shape[1] not in {0, len(names)}:
        raise OutputError("the joints of the postures have no names: give the hand")
    return names


def table_of(poses: GraspPoses, **stated: npt.NDArray[Any]) -> dict[str, npt.NDArray[Any]]:
    """Columns of all that is known about each grasp, named as in files, with outward normals.

    Args:
        poses: The poses.
        stated: Columns that only some kinds of files have.

    Returns:
        Columns in their order: poses (k, 4, 4), postures (k, p), numbers and texts (k,), and
        vectors (k, n, 3).
    """
    placed = {"name": np.array(poses.names), "pose": poses.poses}
    for stage in STAGES:
        placed[f"{stage}posture"] = getattr(poses, f"{stage}posture")
        if (moved := getattr(poses, f"{stage}poses")) is not None:
            placed[f"{stage}pose"] = moved
    numbers = {"opening": poses.opening, "pregrasp_opening": poses.pregrasp_opening,
               "score": poses.scores, "outcome": poses.outcome}  # fmt: skip
    further = {name: one for name, one in poses.columns.items() if name not in VECTOR_COLUMNS}
    vectors = {name: poses.columns[name] for name in VECTOR_COLUMNS if name in poses.columns}
    if "normals" in vectors:
        vectors["normals"] = 0.0 - vectors["normals"]
    known = {name: values for name, values in placed.items() if values.size}
    return {**known, **numbers, **stated, **further, **vectors}


def poses_of(
    table: Mapping[str, Values], joints: tuple[str, ...], header: Mapping[str, Any], given: Given
) -> GraspPoses:
    """Make poses from the columns of a file of any kind, and from its header.

    Args:
        table: Values of each grasp by name, as `table_of` returns them; contacts are not read.
        joints: Names of the joints of postures.
        header: What applies to all grasps.
        given: What the caller states in addition to the file.

    Raises:
        ContactError: Values are missing or wrong.
    """
    placed = {"pose": "poses", "posture": "posture"}
    fields: dict[str, Any] = {
        f"{stage}{field}": table[f"{stage}{name}"]
        for stage in STAGES for name, field in placed.items() if f"{stage}{name}" in table
    }  # fmt: skip
    for name in filter(table.__contains__, ("opening", "pregrasp_opening", "score")):
        fields[name.replace("score", "scores")] = checks.numbers(table[name], (), name)
    known = {*OWN_NAMES, *VECTOR_COLUMNS}
    fields["columns"] = {name: one for name, one in table.items() if name not in known}
    named = enumerate(table.get("name", ()), 1)
    return GraspPoses(
        joint_names=joints,
        outcome=outcomes_of(given.outcome, len(fields["poses"]), table, table.__getitem__),
        names=tuple(f"grasp_{k}" if name is None else str(name) for k, name in named),
        **fields,
        **_fields_of(dict(header) | stated_in(table), given),
    )


def stacked(table: Mapping[str, Values], names: Sequence[str], words: str = "") -> Floats:
    """Numbers of columns, shape (k, columns).

    Args:
        table: Values of each grasp by name.
        names: Names of the columns.
        words: What the message about a missing column adds.

    Raises:
        ContactError: A column is missing, or has no numbers.
    """
    if missing := [name for name in names if name not in table]:
        found = " ".join([*table][:12]) + " ..." * (len(table) > 12)
        raise ContactError(f"column {missing[0]} is missing{words}; found {found}")
    return np.stack([checks.numbers(table[name], (), name) for name in names], axis=1)


SUFFIXES = (".csv", ".parquet", ".json")

_COORDINATE = re.compile(r"[xyz][1-9]\d*")


def read_contacts(path: str | Path, *, unit: Unit | None = None) -> Floats:
    """Read the contacts of grasps, also from files that `write_grasps` wrote; see `read_grasps`.

    CSV and Parquet have columns x1 y1 z1 x2 y2 z2 ..., a row for each grasp; other columns are
    ignored. JSON is a list of grasps, each a list of contacts [x, y, z].

    Args:
        path: File to read; .csv, .parquet or .json.
        unit: Unit of the coordinates, if the file states none.

    Returns:
        Contacts in the order of the file, shape (b, n, 3) with b at least 1, n from 2 to 32; in
        metres, or as in the file if no unit is known.

    Raises:
        ContactError: The file is missing, or contains no such contacts.
    """
    contacts, stated = contacts_in(Path(path))
    with checks.reading(Path(path)):
        return np.asarray(contacts * scale_of(stated_unit(stated, unit)))


def contacts_in(path: Path) -> tuple[Floats, Unit | None]:
    """Contacts as they are in a file, and the unit that it states; see `read_contacts`."""
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise ContactError(unsupported(path, SUFFIXES, "contacts"))
    with checks.reading(path):
        points, stated = read_file(_from_json if suffix == ".json" else _from_table, path)
        if (frame := stated.get("frame")) not in OBJECT:
            raise ContactError(f"its contacts are in the frame {str(frame)!r}; known: 'object'")
        if not len(points):
            raise ContactError("there are no grasps in it, only column names")
        if not 2 <= points.shape[1] <= MAX_FINGERS:
            raise ContactError(f"a grasp has 2 to {MAX_FINGERS} contacts; got {points.shape[1]}")
        if len(bad := np.argwhere(~np.isfinite(points))):
            raise ContactError(f"grasp {bad[0, 0] + 1}: contact {bad[0, 1] + 1} is not finite")
        return points, stated_unit(stated.get("unit"), None)


def _from_table(path: Path) -> tuple[Floats, Mapping[str, Any]]:
    """Contacts of a table, and its unit and frame. Raises ContactError, ValueError, OSError."""
    from grasp3d.system.tables import read_columns

    table = read_columns(path)
    numbers = [int(name[1:]) for name in table if _COORDINATE.fullmatch(name)]
    count = min(max(numbers, default=2), MAX_FINGERS + 1)
    required = [f"{axis}{number}" for number in range(1, count + 1) for axis in "xyz"]
    points = stacked(table, required, "; contacts have x1 y1 z1 x2 y2 z2 ...").reshape(-1, count, 3)
    stated: dict[str, Any] = {name: table[name] for name in ("unit", "frame") if name in table}
    return points, stated_in(stated) if len(points) else {}


def _from_json(path: Path) -> tuple[Floats, Mapping[str, Any]]:
    """Contacts of a JSON file, and its header. Raises ContactError, ValueError, OSError."""
    content = load_json(path)
    stated = content if isinstance(content, dict) else {}
    listed = stated.get("grasps") if stated else content
    rows = checks.grasp_list(listed, "its grasps, each a list of contacts [x, y, z],")

    def plain(value: Any, key: str) -> Any:  # in files that write_grasps wrote
        return value.get(key, value) if isinstance(value, dict) else value

    rows = [plain(row, "contacts") for row in rows]
    grasps = [[plain(c, "point") for c in row] if isinstance(row, list) else row for row in rows]
    count = len(grasps[0]) if isinstance(grasps[0], list) else 0
    points = checks.numbers(grasps, (count, 3), "its contacts, as many as of grasp 1,")
    header = stated.get("grasp3d")
    return points, header if isinstance(header, dict) else stated


def write_contacts(path: Path, grasps: GraspTable, metrics: Mapping[str, Floats] | None) -> None:
    """Write grasps with contacts; see `write_grasps`. Raises OutputError."""
    check_suffix(path, SUFFIXES, "table")
    settings = grasps.settings()
    if path.suffix.lower() != ".json":
        from grasp3d.system.tables import write_columns

        write_columns(path, grasps.table_columns(metrics), settings=settings)
        return
    columns = {name: checks.json_values(one) for name, one in grasps.columns(metrics).items()}
    contacts = {field.name: values for field, values in grasps.contact_values()}
    columns["contacts"] = checks.nested(contacts)
    header = {name: checks.json_values(np.array(one)) for name, one in settings.items()}
    checks.write_rows(path, header, columns)
