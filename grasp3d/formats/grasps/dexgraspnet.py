"""Dictionaries of DexGraspNet: a list with one for each grasp.

| key | written | read |
|---|---|---|
| `qpos.WRJTx` `qpos.WRJTy` `qpos.WRJTz` | position [m] | the same |
| `qpos.WRJRx` `qpos.WRJRy` `qpos.WRJRz` | angles [rad] about the fixed axes x, then y, then z | the same |
| `qpos.NAME` | values of the joints by name | the same |
| `scale` | `object_scale`, else metres per unit of the mesh's file | `object_scale` |

The joints of its Shadow hand (`robot0:FFJ3` and so on) are numbered from 0. Descriptions for ROS number them from 1
(`FFJ4`); joints with opposite axes get the opposite sign: `FFJ4`, `MFJ4`, `THJ2` and `THJ1` of the usual URDF. Its
files have no wrist: the pose is that of the palm. Only the posture at the grasp is written.
"""

from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from grasp3d.formats import dictionaries
from grasp3d.formats.checks import has, joints_of, mapping, write_array
from grasp3d.formats.format import Format, Given, register
from grasp3d.formats.poses import GraspPoses
from grasp3d.formats.postures import as_in_model, wrist_of

ROOT = ("WRJTx", "WRJTy", "WRJTz", "WRJRx", "WRJRy", "WRJRz")
"""Keys of a pose: metres, and angles about the fixed axes x, y and z in turn."""


def read(content: Any, given: Given) -> GraspPoses:
    """Poses of the root of DexGraspNet's model, in the order of the file. Raises ContactError."""
    stated = [one.get("qpos") for one in content]
    names = [name for name in mapping(stated[0], "grasp 1: qpos") if name not in ROOT]
    _, values = joints_of(stated, "qpos", (*ROOT, *map(str, names)))
    turned = Rotation.from_euler("xyz", values[:, 3:6]).as_quat(scalar_first=True)
    parts = [{"grasp": row[None]} for row in np.hstack([values[:, :3], turned, values[:, 6:]])]
    content = [{"joint_names": list(map(str, names)), **one} for one in content]
    return dictionaries.grasps_in(content, parts, given, wrist_of(given.hand).beyond)


def write(path: Path, poses: GraspPoses) -> None:
    """Write a list of dictionaries; a Shadow hand gets the joints of DexGraspNet's model."""
    hand: Any = poses.hand
    names, moved = as_in_model(poses, hand)
    angles = Rotation.from_matrix(moved.poses[:, :3, :3]).as_euler("xyz")
    values = np.hstack([moved.poses[:, :3, 3], angles, moved.posture]).tolist()
    keys, scale = (*ROOT, *names), poses.object_scale
    rows = [{"qpos": dict(zip(keys, row, strict=True)), "scale": scale} for row in values]
    write_array(path, np.array(rows, dtype=object))


register(Format(
    name="dexgraspnet", title="DexGraspNet", suffixes=(".npy",), frame="hand", states_frame=True,
    hands=("articulated",), sniff=has("0.qpos"), read=read, write=write,
    holds="dictionaries with the key qpos", about=__doc__ or "",
))  # fmt: skip
