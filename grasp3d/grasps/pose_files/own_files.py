"""Poses in the project's own formats: JSON, CSV and Parquet."""

from collections.abc import Iterable, Mapping
from itertools import count, takewhile
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from grasp3d.arrays import Floats
from grasp3d.errors import ContactError, OutputError
from grasp3d.grasps.pose_files.documents import (
    Entries,
    each,
    entries_of,
    grasp_list,
    json_numbers,
    json_text,
    mapping,
    numbers,
    required,
    rows_of,
    write_rows,
)
from grasp3d.grasps.pose_files.frames import (
    Given,
    fields_of,
    from_quaternions,
    header_of,
    quaternions,
)
from grasp3d.grasps.pose_files.outcomes import Values, outcomes_of
from grasp3d.grasps.poses import OWN_NAMES, GraspPoses
from grasp3d.hand.frames import FRAMES
from grasp3d.settings.outcome import Outcome
from grasp3d.system.documents import MEGABYTE, described

Columns = Mapping[str, npt.NDArray[Any]]

POSITION = ("px", "py", "pz")
QUATERNION = ("qx", "qy", "qz", "qw")
REQUIRED = POSITION + QUATERNION

VECTORS = {"contacts": "", "normals": "n"}
"""Columns of poses that are contacts and outward normals, and how their names begin in a table."""


def is_own(content: object) -> bool:
    """Whether the content of a JSON file is in this format."""
    grasps = content.get("grasps") if isinstance(content, dict) else None
    first = grasps[0] if isinstance(grasps, list) and grasps else None
    return isinstance(first, dict) and "pose" in first


def are_poses(names: list[str]) -> bool:
    """Whether a table with these columns holds poses."""
    return any(name in names for name in REQUIRED)


def write_json(path: Path, poses: GraspPoses) -> None:
    """Write what applies to all grasps, then one line for each grasp."""
    posture = {"posture": poses.posture} if poses.posture.size else {}
    further = {name: values for name, values in poses.columns.items() if name not in VECTORS}
    columns = {
        name: json_numbers(values)
        for name, values in {**_columns(poses, {"pose": poses.poses}, posture), **further}.items()
    }
    if len(further) < len(poses.columns):
        columns["contacts"] = _contacts(poses.columns)
    try:
        header = json_text(header_of(poses))
    except (TypeError, ValueError) as error:
        raise OutputError(f"{path}: the settings of the poses are no JSON: {error}") from error
    write_rows(path, header, rows_of(columns, poses.count))


def write_table(path: Path, poses: GraspPoses) -> None:
    """Write one row for each grasp; Parquet has the header in its metadata."""
    from grasp3d.system.tables import write_columns

    pose = dict(zip(POSITION, poses.poses[:, :3, 3].T, strict=True))
    pose |= dict(zip(QUATERNION, quaternions(poses.poses).T, strict=True))
    posture = {f"posture{k + 1}": values for k, values in enumerate(poses.posture.T)}
    columns = {**_columns(poses, pose, posture), "unit": np.full(poses.count, poses.unit or "")}
    if poses.gripper_frame != FRAMES["tcp"]:
        columns["gripper_frame"] = np.full(poses.count, str(poses.gripper_frame))
    if poses.object_pose is not None:
        columns["object_pose"] = np.full(poses.count, str(poses.object_pose))
    for name, values in poses.columns.items():
        if name in VECTORS:
            parts = _parts(name, values.shape[1])
            outward = _turned(name, values).reshape(poses.count, -1)
            columns |= dict(zip(parts, outward.T, strict=True))
        else:
            columns[name] = values
    write_columns(path, columns, settings=header_of(poses))


def _columns(poses: GraspPoses, pose: Columns, posture: Columns) -> dict[str, npt.NDArray[Any]]:
    """The columns of every file, with the pose and the posture as this one has them."""
    return {
        "name": np.array(poses.names),
        **pose,
        "opening": poses.opening,
        "pregrasp_opening": poses.pregrasp_opening,
        **posture,
        "score": poses.scores,
        "outcome": poses.outcome,
    }


def _turned(name: str, values: Floats) -> Floats:
    """Vectors of a file from those of poses and back: the normals of files are outward."""
    return 0.0 - values if name == "normals" else values


def _contacts(columns: Columns) -> list[list[dict[str, Any]]]:
    """The contacts of each grasp, normals outward."""
    parts = {
        key: json_numbers(_turned(name, columns[name]))
        for key, name in (("point", "contacts"), ("normal", "normals"))
        if name in columns
    }
    return [
        [dict(zip(parts, contact, strict=True)) for contact in zip(*grasp, strict=True)]
        for grasp in zip(*parts.values(), strict=True)
    ]


LARGEST_TEXTS = 2048 * MEGABYTE
"""Most memory of a column of texts [bytes]."""

NUMBERS = ("opening", "pregrasp_opening", "score")
"""Columns of one number for each pose, but outcomes."""


def _poses(table: Mapping[str, Values], stated: Outcome | None, **fields: Any) -> GraspPoses:
    """Poses with the numbers that files of every kind have in columns of the same names."""
    rows = len(fields["poses"])
    opening, pregrasp_opening, scores = (
        _numbers(table[name], name) if name in table else np.full(rows, np.nan) for name in NUMBERS
    )
    return GraspPoses(
        opening=opening,
        pregrasp_opening=pregrasp_opening,
        scores=scores,
        outcome=outcomes_of(stated, rows, table, table.__getitem__),
        **fields,
    )


def _numbers(values: Values, name: str) -> Floats:
    if not isinstance(values, np.ndarray):
        return numbers(values, (), name)
    if values.dtype.kind in "fiub":
        return values.astype(np.float64)
    return numbers(values.tolist(), (), name)


def parse_json(content: object, given: Given) -> GraspPoses:
    """Poses of the content of a JSON file. Raises ContactError."""
    document = mapping(content, "the file")
    entries = entries_of(grasp_list(required(document, "grasps"), "grasps"))
    keys = list(dict.fromkeys(key for entry in entries for key in entry))
    listed = {key: [entry.get(key) for entry in entries] for key in keys}
    further = [key for key in keys if key not in OWN_NAMES | VECTORS.keys()]
    return _poses(
        listed,
        given.outcome,
        poses=numbers(each(entries, "pose"), (4, 4), "pose"),
        posture=_posture(entries),
        names=tuple(str(one.get("name", f"grasp_{k}")) for k, one in enumerate(entries, 1)),
        columns={
            **{key: _column(listed[key], key) for key in further},
            **(_vectors(entries) if "contacts" in keys else {}),
        },
        **fields_of(mapping(document.get("grasp3d", {}), "grasp3d") | _stated(listed), given),
    )


def _posture(entries: Entries) -> Floats:
    """Values of further joints, shape (k, p)."""
    if "posture" not in entries[0]:
        return np.zeros((0, 0))
    first = entries[0]["posture"]
    joints = len(first) if isinstance(first, list) else 0
    return numbers(each(entries, "posture"), (joints,), "posture")


def _column(values: list[Any], key: str) -> npt.NDArray[Any]:
    """Text if there is any text, otherwise numbers."""
    if any(isinstance(value, str) for value in values):
        wrong = next((v for v in values if isinstance(v, list | dict)), None)
        if wrong is not None:
            raise ContactError(f"{key} must be text in all grasps; got {described(wrong)}")
        return _texts(values, key)
    return numbers(values, (), key)


def _vectors(entries: Entries) -> dict[str, Floats]:
    """Contacts and normals into the object, shape (k, n, 3), as many of each grasp."""
    first = entries[0].get("contacts")
    fingers = len(first) if isinstance(first, list) and len(first) > 2 else 2
    grasps: list[list[dict[str, Any]]] = []
    for number, entry in enumerate(entries, 1):
        contacts = entry.get("contacts")
        if not isinstance(contacts, list) or len(contacts) != fingers:
            raise ContactError(
                f"grasp {number}: contacts must be a list of {fingers}; got {described(contacts)}"
            )
        grasps.append([mapping(contact, f"grasp {number}: a contact") for contact in contacts])
    return {
        name: _turned(
            name,
            numbers(
                [[contact[key] for contact in contacts] for contacts in grasps],
                (fingers, 3),
                f"{key} of contacts",
            ),
        )
        for key, name in (("point", "contacts"), ("normal", "normals"))
        if all(key in contact for contacts in grasps for contact in contacts)
    }


def read_table(path: Path, given: Given) -> GraspPoses:
    """Poses of a CSV or Parquet file. Raises ContactError, ValueError, OSError."""
    from grasp3d.system.tables import read_columns, read_settings

    columns = read_columns(path)
    missing = [name for name in REQUIRED if name not in columns]
    if missing:
        listed = " ".join(list(columns)[:12]) + (" ..." if len(columns) > 12 else "")
        raise ContactError(
            f"column {missing[0]} is missing of {' '.join(REQUIRED)}; found {listed}"
        )
    if not len(columns["px"]):
        raise ContactError("there are no grasps in it, only column names")
    header = read_settings(path) if path.suffix.lower() == ".parquet" else None
    joints = tuple(takewhile(columns.__contains__, (f"posture{k}" for k in count(1))))
    vectors = _vector_columns(columns)
    used = {*OWN_NAMES, *joints, *(part for parts in vectors.values() for part in parts)}
    return _poses(
        columns,
        given.outcome,
        poses=from_quaternions(_stacked(columns, POSITION), _stacked(columns, QUATERNION)),
        posture=_stacked(columns, joints) if joints else np.zeros((0, 0)),
        names=tuple(map(_text, columns["name"].tolist())) if "name" in columns else (),
        columns={
            **{
                name: _turned(name, _stacked(columns, parts).reshape(-1, len(parts) // 3, 3))
                for name, parts in vectors.items()
            },
            **{
                name: _further(values, name) for name, values in columns.items() if name not in used
            },
        },
        **fields_of((header or {}) | _stated(columns), given),
    )


def _stated(columns: Mapping[str, Iterable[Any]]) -> dict[str, str]:
    """What all rows of a file state, as its header may."""
    stated: dict[str, str] = {}
    for name in filter(columns.__contains__, ("unit", "object_pose", "frame", "gripper_frame")):
        stated[name], *others = {_text(value) for value in columns[name]}
        if others:
            raise ContactError(f"all grasps must have the same {name}")
    return stated


def _stacked(columns: Columns, names: tuple[str, ...]) -> Floats:
    return np.stack([_numbers(columns[name], name) for name in names], axis=1)


def _parts(name: str, fingers: int) -> tuple[str, ...]:
    """Columns of a table for vectors at as many contacts."""
    return tuple(f"{VECTORS[name]}{axis}{k + 1}" for k in range(fingers) for axis in "xyz")


def _vector_columns(columns: Columns) -> dict[str, tuple[str, ...]]:
    """The columns of contacts and normals, where there are those of two fingers at least."""
    complete = {
        name: next(n for n in count() if not set(_parts(name, n + 1)) <= columns.keys())
        for name in VECTORS
    }
    return {name: _parts(name, fingers) for name, fingers in complete.items() if fingers > 1}


def _further(values: npt.NDArray[Any], name: str) -> npt.NDArray[Any]:
    """Numbers, or text."""
    if values.dtype.kind in "fiub":
        return values
    listed = values.tolist()
    if all(value is None for value in listed):
        return np.full(len(listed), np.nan)
    return _texts(listed, name)


def _texts(values: list[Any], name: str) -> npt.NDArray[Any]:
    """A column of texts, of which each takes as much memory as the longest. Raises ContactError."""
    texts = [_text(value) for value in values]
    longest = max(map(len, texts))
    if 4 * longest * len(texts) > LARGEST_TEXTS:
        raise ContactError(
            f"{name} has a text of {longest:,} characters, too long with {len(texts):,} grasps: "
            "shorten it, or leave this column out"
        )
    column = np.array(texts)
    column.flags.writeable = False  # so that poses need no copy of it
    return column


def _text(value: object) -> str:
    return "" if value is None else str(value)
