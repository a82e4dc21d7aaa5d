"""Poses in the project's own formats: JSON, CSV and Parquet."""

from collections.abc import Iterable, Mapping
from itertools import count as naturals
from itertools import takewhile
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
    joints_of,
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
from grasp3d.grasps.poses import OWN_NAMES, STAGES, GraspPoses
from grasp3d.hand.frames import FRAMES
from grasp3d.system.documents import described

Columns = Mapping[str, npt.NDArray[Any]]

POSITION = ("px", "py", "pz")
QUATERNION = ("qx", "qy", "qz", "qw")
REQUIRED = POSITION + QUATERNION

JOINT = "joint:"
"""Before the name of a joint in the name of its column."""

VECTORS = {"contacts": "", "normals": "n"}
"""Columns of poses that are contacts and outward normals, and how their names begin in a table."""


def are_poses(names: list[str]) -> bool:
    """Whether a table with these columns holds poses."""
    return any(name in names for name in REQUIRED)


def write_json(path: Path, poses: GraspPoses) -> None:
    """Write what applies to all grasps, then one line for each grasp."""
    posture = {
        name: values if values.shape[1:] == (4, 4) else _by_name(values, poses.joint_names)
        for name, values in _further_stages(poses).items()
    }
    further = {name: values for name, values in poses.columns.items() if name not in VECTORS}
    columns = {
        name: json_numbers(values) if isinstance(values, np.ndarray) else values
        for name, values in {**_columns(poses, {"pose": poses.poses}, posture), **further}.items()
    }
    if len(further) < len(poses.columns):
        columns["contacts"] = _contacts(poses.columns)
    try:
        header = json_text(header_of(poses))
    except (TypeError, ValueError) as error:
        raise OutputError(f"{path}: the settings of the poses are no JSON: {error}") from error
    write_rows(path, header, rows_of(columns, poses.count))


def _further_stages(poses: GraspPoses) -> dict[str, Floats]:
    """Postures, and postures and poses before and after the grasp, as far as they are known."""
    found = {"posture": poses.posture}
    for stage in STAGES:
        found[f"{stage}_posture"] = getattr(poses, f"{stage}_posture")
        if (moved := getattr(poses, f"{stage}_poses")) is not None:
            found[f"{stage}_pose"] = moved
    return {name: values for name, values in found.items() if values.size}


def _by_name(values: Floats, names: tuple[str, ...]) -> Any:
    """Values of joints as JSON has them: by name, or a list where joints have no names."""
    rows = json_numbers(values)
    return [dict(zip(names, row, strict=True)) for row in rows] if names else rows


def write_table(path: Path, poses: GraspPoses) -> None:
    """Write one row for each grasp; Parquet has the header in its metadata."""
    from grasp3d.system.tables import write_columns

    pose, posture = _pose_columns("", poses.poses), dict[str, npt.NDArray[Any]]()
    for name, values in _further_stages(poses).items():
        if values.shape[1:] == (4, 4):
            posture |= _pose_columns(name.removesuffix("pose"), values)
        else:
            names = _joint_columns(name, poses.joint_names, values.shape[1])
            posture |= dict(zip(names, values.T, strict=True))
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


def _pose_columns(prefix: str, poses: Floats) -> dict[str, npt.NDArray[Any]]:
    """Columns of positions and quaternions."""
    names = (prefix + name for name in REQUIRED)
    values = (*poses[:, :3, 3].T, *quaternions(poses).T)
    return dict(zip(names, values, strict=True))


def _joint_columns(name: str, joints: tuple[str, ...], count: int) -> list[str]:
    """Names of the columns of a posture: with those of its joints, or with numbers."""
    if joints:
        return [f"{name.removesuffix('posture')}{JOINT}{joint}" for joint in joints]
    return [f"{name}{k + 1}" for k in range(count)]


def _columns(poses: GraspPoses, pose: Columns, posture: Mapping[str, Any]) -> dict[str, Any]:
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


LARGEST_TEXTS = 2**31
"""Most memory of a column of texts [bytes]."""

NUMBERS = ("opening", "pregrasp_opening", "score")
"""Columns of one number for each pose, but outcomes."""


def _poses(table: Mapping[str, Values], stated: str | None, **fields: Any) -> GraspPoses:
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
        **_postures(entries),
        names=tuple(str(one.get("name", f"grasp_{k}")) for k, one in enumerate(entries, 1)),
        columns={
            **{key: _column(listed[key], key) for key in further},
            **(_vectors(entries) if "contacts" in keys else {}),
        },
        **fields_of(mapping(document.get("grasp3d", {}), "grasp3d") | _stated(listed), given),
    )


def _postures(entries: Entries) -> dict[str, Any]:
    """Postures, and poses before and after the grasp, as far as they are stated."""
    found: dict[str, Any] = {}
    names: tuple[str, ...] | None = None
    for name in ("posture", *(f"{stage}_posture" for stage in STAGES)):
        if any(name in entry for entry in entries):
            own, found[name] = joints_of(each(entries, name), name)
            found["joint_names"] = names = own if names is None else names
            if set(own) != set(names):
                raise ContactError(f"{name} must have the joints of the posture")
            if own != names:
                found[name] = found[name][:, [own.index(joint) for joint in names]]
    for stage in STAGES:
        if any(f"{stage}_pose" in entry for entry in entries):
            key = f"{stage}_pose"
            found[f"{stage}_poses"] = numbers(each(entries, key), (4, 4), key)
    return found


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
    if path.suffix.lower() == ".csv":  # a space may follow each comma
        columns = {name: _stripped(values) for name, values in columns.items()}
    missing = [name for name in REQUIRED if name not in columns]
    if missing:
        listed = " ".join(list(columns)[:12]) + (" ..." if len(columns) > 12 else "")
        raise ContactError(
            f"column {missing[0]} is missing of {' '.join(REQUIRED)}; found {listed}"
        )
    if not len(columns["px"]):
        raise ContactError("there are no grasps in it, only column names")
    header = read_settings(path) if path.suffix.lower() == ".parquet" else None
    vectors, (joints, postures) = _vector_columns(columns), _posture_columns(columns)
    used = {*OWN_NAMES, *joints, *(part for parts in vectors.values() for part in parts)}
    return _poses(
        columns,
        given.outcome,
        poses=_poses_in(columns, ""),
        **postures,
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


def _stripped(values: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Texts without the spaces around them; numbers as they are."""
    if values.dtype.kind != "O":
        return values
    stripped = [value.strip() if isinstance(value, str) else value for value in values]
    return np.array(stripped, dtype=object)


def _poses_in(columns: Columns, prefix: str) -> Floats:
    position, turned = (
        _stacked(columns, tuple(prefix + name for name in names))
        for names in (POSITION, QUATERNION)
    )
    return from_quaternions(position, turned)


def _posture_columns(columns: Columns) -> tuple[list[str], dict[str, Any]]:
    """The columns of postures, and of poses before and after the grasp, and what they state."""
    used: list[str] = []
    found: dict[str, Any] = {}
    joints = tuple(name.removeprefix(JOINT) for name in columns if name.startswith(JOINT))
    count = sum(1 for _ in takewhile(columns.__contains__, (f"posture{k}" for k in naturals(1))))
    for name in ("posture", *(f"{stage}_posture" for stage in STAGES)):
        names = _joint_columns(name, joints, count)
        if any(one in columns for one in names):
            missing = [one for one in names if one not in columns]
            if missing:
                raise ContactError(f"column {missing[0]} is missing of {' '.join(names)}")
            found |= {name: _stacked(columns, tuple(names)), "joint_names": joints}
            used += names
    for stage in STAGES:
        names = [f"{stage}_{name}" for name in REQUIRED]
        if all(name in columns for name in names):
            found[f"{stage}_poses"] = _poses_in(columns, f"{stage}_")
            used += names
    return used, found


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
        name: next(n for n in naturals() if not set(_parts(name, n + 1)) <= columns.keys())
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
