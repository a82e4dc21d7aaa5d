"""Tables of CSV: a row for each grasp.

Columns are separated by commas, semicolons or tabs, which spaces may follow; with semicolons there
may be decimal commas. The header of [JSON](#json) is in the metadata of Parquet; CSV has the unit
only, and where poses are in the frame of a robot a column `object_pose`. A column `frame` is read
as that of JSON.

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
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from grasp3d.arrays import Floats
from grasp3d.errors import ContactError
from grasp3d.formats import checks, own
from grasp3d.formats.format import Format, Given, register
from grasp3d.formats.frames import from_quaternions, quaternions
from grasp3d.formats.poses import OWN_NAMES, STAGES, VECTOR_COLUMNS, GraspPoses
from grasp3d.hand.frames import FRAMES

Columns = Mapping[str, npt.NDArray[Any]]

POSITION, PLAIN = ("px", "py", "pz"), ("x", "y", "z")
QUATERNION = ("qx", "qy", "qz", "qw")
REQUIRED = POSITION + QUATERNION

JOINT = "joint:"
"""Before the name of a joint in the name of its column."""


_CONTACT = re.compile(r"n?[xyz][1-9]\d*")


def sniff(path: Path) -> bool:
    """Whether a table has columns of poses. Raises ValueError, OSError."""
    from grasp3d.system.tables import column_names

    return not {*REQUIRED}.isdisjoint(column_names(path))


def write(path: Path, poses: GraspPoses) -> None:
    """Write one row for each grasp; Parquet has the header in its metadata."""
    from grasp3d.system.tables import write_columns

    placed = _pose_columns("", poses.poses)
    for name, values in own.stages_of(poses).items():
        if values.ndim == 3:
            placed |= _pose_columns(name.removesuffix("pose"), values)
        else:
            joints = _joint_columns(name, own.joint_names(poses))
            placed |= dict(zip(joints, values.T, strict=True))
    columns = own.columns_of(poses, **placed)
    stated = {"unit": poses.unit or "", "gripper_frame": poses.gripper_frame,
              "object_pose": poses.object_pose}  # fmt: skip
    for name, value in stated.items():
        if value not in {None, FRAMES["tcp"]}:
            columns[name] = np.full(poses.count, str(value))
    columns |= {name: one for name, one in poses.columns.items() if name not in VECTOR_COLUMNS}
    for name, values in own.vectors_of(poses).items():
        start, numbers = "n" * (name == "normals"), range(1, values.shape[1] + 1)
        parts = [f"{start}{axis}{number}" for number in numbers for axis in "xyz"]
        columns |= dict(zip(parts, values.reshape(poses.count, -1).T, strict=True))
    write_columns(path, columns, settings=own.header_of(poses))


def _pose_columns(prefix: str, poses: Floats) -> dict[str, npt.NDArray[Any]]:
    """Columns of positions and quaternions."""
    names = (prefix + name for name in REQUIRED)
    return dict(zip(names, (*poses[:, :3, 3].T, *quaternions(poses).T), strict=True))


def _joint_columns(name: str, joints: tuple[str, ...]) -> list[str]:
    """Names of the columns of a posture."""
    return [f"{name.removesuffix('posture')}{JOINT}{joint}" for joint in joints]


def read(path: Path, given: Given) -> GraspPoses:
    """Poses of a CSV or Parquet file. Raises ContactError, ValueError, OSError."""
    from grasp3d.system.tables import read_columns, read_settings

    columns = {name: _stripped(values) for name, values in read_columns(path).items()}
    position = POSITION if any(name in columns for name in POSITION) else PLAIN
    if missing := [name for name in (*position, *QUATERNION) if name not in columns]:
        raise ContactError(
            f"column {missing[0]} is missing of px py pz (or x y z) {' '.join(QUATERNION)}; found "
            f"{checks.short_list([*columns])}"
        )
    if not len(columns["qx"]):
        raise ContactError("there are no grasps in it, only column names")
    joints, stages = _stages(columns)
    used = {*OWN_NAMES, *position, *joints, *filter(_CONTACT.fullmatch, columns)}
    return own.poses_of(
        columns,
        given,
        poses=_poses(columns, (*position, *QUATERNION)),
        **stages,
        names=tuple("" if one is None else str(one) for one in columns.get("name", ())),
        columns={
            name: own.column_of(one, name) for name, one in columns.items() if name not in used
        },
        **own.fields_of((read_settings(path) or {}) | own.stated_in(columns), given),
    )


def _stripped(values: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Texts without the spaces around them; numbers as they are."""
    if values.dtype.kind != "O":
        return values
    stripped = [value.strip() if isinstance(value, str) else value for value in values]
    return np.array([*stripped, None], dtype=object)[:-1]  # also where all are lists


def _poses(columns: Columns, names: tuple[str, ...]) -> Floats:
    values = _stacked(columns, names)
    return from_quaternions(values[:, :3], values[:, 3:])


def _stages(columns: Columns) -> tuple[list[str], dict[str, Any]]:
    """The columns of postures, and of poses before and after the grasp, and what they state."""
    used: list[str] = []
    found: dict[str, Any] = {}
    joints = tuple(name.removeprefix(JOINT) for name in columns if name.startswith(JOINT))
    for name in ("posture", *(f"{stage}_posture" for stage in STAGES)):
        names = _joint_columns(name, joints)
        if any(one in columns for one in names):
            if missing := [one for one in names if one not in columns]:
                raise ContactError(f"column {missing[0]} is missing of {' '.join(names)}")
            found |= {name: _stacked(columns, tuple(names)), "joint_names": joints}
            used += names
    for stage in STAGES:
        names = [f"{stage}_{name}" for name in REQUIRED]
        if all(name in columns for name in names):
            found[f"{stage}_poses"] = _poses(columns, tuple(names))
            used += names
    return used, found


def _stacked(columns: Columns, names: tuple[str, ...]) -> Floats:
    return np.stack([own.numbers_of(columns[name], name) for name in names], axis=1)


FORMAT = Format(
    name="csv",
    title="CSV",
    suffixes=(".csv",),
    sniff=sniff,
    read=read,
    write=write,
    holds="columns px py pz (or x y z) qx qy qz qw",
    states_frame=True,
    unit="stated",
    hands=(),
    moves=True,
    main=True,
    about=__doc__ or "",
)
register(FORMAT)
