"""Poses as tables: CSV and Parquet."""

from collections.abc import Mapping
from itertools import count, takewhile
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from grasp3d.arrays import Floats
from grasp3d.errors import ContactError
from grasp3d.grasps.pose_files.documents import numbers
from grasp3d.grasps.pose_files.frames import from_quaternions, quaternions
from grasp3d.grasps.pose_files.header import fields_of, header_of, outcomes_of
from grasp3d.grasps.poses import OWN_NAMES, GraspPoses
from grasp3d.hand.hand import Hand
from grasp3d.settings.lengths import Unit

Columns = Mapping[str, npt.NDArray[Any]]

POSITION = ("px", "py", "pz")
QUATERNION = ("qx", "qy", "qz", "qw")
REQUIRED = POSITION + QUATERNION

VECTORS = {"contacts": "", "normals": "n"}
"""Columns of poses that are contacts and outward normals, and how their names begin in a table."""


def write_table(path: Path, poses: GraspPoses) -> None:
    """Write one row for each grasp; Parquet has the header in its metadata."""
    from grasp3d.system.tables import write_columns

    write_columns(path, _columns(poses), settings=header_of(poses))


def _columns(poses: GraspPoses) -> dict[str, npt.NDArray[Any]]:
    positions, turned = poses.poses[:, :3, 3], quaternions(poses.poses)
    columns: dict[str, npt.NDArray[Any]] = {
        "name": np.array(poses.names),
        **{name: positions[:, k] for k, name in enumerate(POSITION)},
        **{name: turned[:, k] for k, name in enumerate(QUATERNION)},
        "opening": poses.opening,
        "pregrasp_opening": poses.pregrasp_opening,
        **{f"posture{k + 1}": values for k, values in enumerate(poses.posture.T)},
        "score": poses.scores,
        "outcome": poses.outcome,
        "unit": np.full(poses.count, poses.unit or ""),
    }
    for name, values in poses.columns.items():
        if name in VECTORS:
            outward = 0.0 - values if name == "normals" else values
            parts = _parts(VECTORS[name], outward.shape[1])
            columns |= dict(zip(parts, outward.reshape(poses.count, -1).T, strict=True))
        else:
            columns[name] = values
    return columns


def _parts(start: str, fingers: int) -> tuple[str, ...]:
    """Columns of a table for vectors at as many contacts."""
    return tuple(f"{start}{axis}{k + 1}" for k in range(fingers) for axis in "xyz")


def _joints(columns: Columns) -> tuple[str, ...]:
    """Columns of a table for the posture."""
    names = (f"posture{k}" for k in count(1))
    return tuple(takewhile(columns.__contains__, names))


def _posture(columns: Columns) -> Floats:
    names = _joints(columns)
    return _stacked(columns, names) if names else np.zeros((0, 0))


def are_poses(names: list[str]) -> bool:
    """Whether a table with these columns holds poses."""
    return any(name in names for name in REQUIRED)


def read_table(path: Path, hand: Hand | None, unit: Unit | None) -> GraspPoses:
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
    stated = dict(header or {})
    stated.setdefault("unit", _unit(columns))
    rows = len(columns["px"])
    common = fields_of(stated, hand, unit)
    return GraspPoses(
        poses=from_quaternions(_stacked(columns, POSITION), _stacked(columns, QUATERNION)),
        opening=_optional(columns, "opening", rows),
        pregrasp_opening=_optional(columns, "pregrasp_opening", rows),
        posture=_posture(columns),
        scores=_optional(columns, "score", rows),
        outcome=outcomes_of(columns, rows),
        names=tuple(map(_text, columns["name"].tolist())) if "name" in columns else (),
        columns=_others(columns),
        **common,
    )


def _unit(columns: Columns) -> str | None:
    """The unit that all rows state."""
    stated = {_text(value) for value in columns["unit"].tolist()} if "unit" in columns else set()
    if len(stated) > 1:
        raise ContactError("all grasps must have the same unit")
    return stated.pop() if stated else None


def _stacked(columns: Columns, names: tuple[str, ...]) -> Floats:
    return np.stack([_numbers(columns[name], name) for name in names], axis=1)


def _optional(columns: Columns, name: str, count: int) -> Floats:
    return _numbers(columns[name], name) if name in columns else np.full(count, np.nan)


def _numbers(values: npt.NDArray[Any], name: str) -> Floats:
    if values.dtype.kind in "fiub":
        return values.astype(np.float64)
    return numbers(values.tolist(), (), name)


def _others(columns: Columns) -> dict[str, npt.NDArray[Any]]:
    """Further columns; contacts and normals put together."""
    others: dict[str, npt.NDArray[Any]] = {}
    vectors: set[str] = set()
    for name, start in VECTORS.items():
        fingers = next(n for n in count() if not set(_parts(start, n + 1)) <= columns.keys())
        if fingers > 1:
            parts = _parts(start, fingers)
            values = _stacked(columns, parts).reshape(-1, fingers, 3)
            others[name] = 0.0 - values if name == "normals" else values
            vectors |= set(parts)
    for name, column in columns.items():
        if name not in OWN_NAMES and name not in vectors and name not in _joints(columns):
            others[name] = _column(column)
    return others


def _column(values: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Numbers, or text."""
    if values.dtype.kind in "fiub":
        return values
    listed = values.tolist()
    if all(value is None for value in listed):
        return np.full(len(listed), np.nan)
    return np.array([_text(value) for value in listed])


def _text(value: object) -> str:
    return "" if value is None else str(value)
