"""A format that only the tests have: what it takes to add one.

| line | |
|---|---|
| first | `# gpd` |
| of a grasp | x y z [m] and the quaternion x y z w of the hand |
"""

from pathlib import Path

import numpy as np

from grasp3d.errors import ContactError
from grasp3d.formats import Format, Given, GraspPoses, register
from grasp3d.formats.frames import from_quaternions, quaternions

HEAD = "# gpd"


def sniff(path: Path) -> bool:
    with path.open(encoding="utf-8") as stream:
        return stream.readline().strip() == HEAD


def read(path: Path, given: Given) -> GraspPoses:
    del given
    rows = np.loadtxt(path, ndmin=2)
    if rows.shape[1] != 7:
        raise ContactError(f"a line must have 7 numbers; got {rows.shape[1]}")
    return GraspPoses(poses=from_quaternions(rows))


def write(path: Path, poses: GraspPoses) -> None:
    rows = np.hstack([poses.poses[:, :3, 3], quaternions(poses.poses)])
    np.savetxt(path, rows, fmt="%.17g", header=HEAD.removeprefix("# "))


FORMAT = Format(
    name="gpd_text",
    title="Text of GPD",
    suffixes=(".gpd",),
    sniff=sniff,
    read=read,
    write=write,
    holds=f"lines of 7 numbers after {HEAD!r}",
    frame="gpd",
    about=__doc__ or "",
)


def add() -> None:
    """Register the format."""
    register(FORMAT)
