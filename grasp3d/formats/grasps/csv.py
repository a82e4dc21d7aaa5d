"""Tables of CSV: a row for each grasp.

Columns are separated by commas, semicolons or tabs, which spaces may follow; with semicolons there
may be decimal commas. Parquet has the header of [JSON](#json) in its metadata. CSV has only its
`unit`, `gripper_frame` and, if poses are in the frame of a robot, `object_pose`, as columns. A
column `frame` is read as in JSON.

| column | |
|---|---|
| `name` `opening` `pregrasp_opening` `score` `outcome` | as in JSON |
| `px` `py` `pz` | position of the TCP; also read as `x` `y` `z` |
| `qx` `qy` `qz` `qw` | quaternion of the rotation, length 1 |
| `unit` | the same in every row |
| `gripper_frame` | the same in every row; only where it is not `tcp` |
| `joint:NAME` `pregrasp_joint:NAME` `squeeze_joint:NAME` | postures as in JSON |
| `pregrasp_px` `pregrasp_qw` `squeeze_px` `squeeze_qw` and others | poses as `px` to `qw`, only where they differ |
| `x1` `y1` `z1` `x2` `y2` `z2` | contacts; with poses for people and other programs, not read |
| `nx1` `ny1` `nz1` `nx2` `ny2` `nz2` | outward normals there |
| others | [further columns](#further-columns) |
"""

import re
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from grasp3d.errors import ContactError
from grasp3d.formats import own
from grasp3d.formats.format import Format, Given, register
from grasp3d.formats.frames import from_quaternions, quaternions
from grasp3d.formats.poses import STAGES, VECTOR_COLUMNS, GraspPoses
from grasp3d.hand.frames import FRAMES

POSITION, PLAIN = ("px", "py", "pz"), ("x", "y", "z")
QUATERNION = ("qx", "qy", "qz", "qw")
REQUIRED = POSITION + QUATERNION

JOINT = "joint:"
"""Prefix of the name of a joint in the name of its column."""

_CONTACT = re.compile(r"n?[xyz][1-9]\d*")


def sniff(path: Path) -> bool:
    """Whether a table has columns of poses. Raises ValueError, OSError."""
    from grasp3d.system.tables import column_names

    return not {*REQUIRED}.isdisjoint(column_names(path))


def write(path: Path, poses: GraspPoses) -> None:
    """Write one row for each grasp; Parquet has the header in its metadata."""
    from grasp3d.system.tables import write_columns

    stated = {"unit": poses.unit or "", "gripper_frame": poses.gripper_frame,
              "object_pose": poses.object_pose}  # fmt: skip
    of_all = {
        name: np.full(poses.count, str(value))
        for name, value in stated.items()
        if value not in {None, FRAMES["tcp"]}
    }
    joints = own.joint_names(poses)
    columns: dict[str, npt.NDArray[Any]] = {}
    for name, values in own.table_of(poses, **of_all).items():
        names, parts = [name], values[None]
        if name in VECTOR_COLUMNS:
            numbers = range(1, values.shape[1] + 1)
            start, parts = "n" * (name == "normals"), values.reshape(poses.count, -1).T
            names = [f"{start}{axis}{number}" for number in numbers for axis in "xyz"]
        elif values.ndim == 3:
            names = [f"{name.removesuffix('pose')}{one}" for one in REQUIRED]
            parts = np.vstack([values[:, :3, 3].T, quaternions(values).T])
        elif values.ndim == 2:
            names = [f"{name.removesuffix('posture')}{JOINT}{joint}" for joint in joints]
            parts = values.T
        columns |= dict(zip(names, parts, strict=True))
    write_columns(path, columns, settings=own.header_of(poses))


def read(path: Path, given: Given) -> GraspPoses:
    """Poses of a CSV or Parquet file. Raises ContactError, ValueError, OSError."""
    from grasp3d.system.tables import read_columns, read_settings

    columns = {name: _stripped(values) for name, values in read_columns(path).items()}
    position = POSITION if any(name in columns for name in POSITION) else PLAIN
    joints = tuple(name.removeprefix(JOINT) for name in columns if name.startswith(JOINT))
    found, used = {}, {*filter(_CONTACT.fullmatch, columns)}
    for stage in STAGES:
        names = [f"{stage}{name}" for name in REQUIRED] if stage else [*position, *QUATERNION]
        if not stage or all(name in columns for name in names):
            values = own.stacked(columns, names, "; poses have px py pz (or x y z) qx qy qz qw")
            if not len(values):
                raise ContactError("there are no grasps in it, only column names")
            found[f"{stage}pose"] = from_quaternions(values)
            used.update(names)
        names = [f"{stage}{JOINT}{joint}" for joint in joints]
        if any(name in columns for name in names):
            found[f"{stage}posture"] = own.stacked(columns, names)
            used.update(names)
    others = {name: values for name, values in columns.items() if name not in used}
    return own.poses_of({**others, **found}, joints, read_settings(path) or {}, given)


def _stripped(values: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Strip spaces around texts, and leave numbers as they are."""
    if values.dtype.kind == "M":  # a column of dates
        values = values.astype(str)
    if values.dtype.kind != "O":
        return values
    stripped = [value.strip() if isinstance(value, str) else value for value in values]
    return np.array([*stripped, None], dtype=object)[:-1]  # None keeps lists as objects


FORMAT = Format(
    name="csv", title="CSV", suffixes=(".csv",), states_frame=True, unit="stated", hands=(),
    moves=True, main=True, sniff=sniff, read=read, write=write,
    holds="columns px py pz (or x y z) qx qy qz qw", about=__doc__ or "",
)  # fmt: skip
register(FORMAT)
