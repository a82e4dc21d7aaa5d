"""Dictionaries of DexGraspBench, each of one grasp or with a row for each grasp.

| key | written | read |
|---|---|---|
| `pregrasp_qpos` `grasp_qpos` `squeeze_qpos` | x, y, z [m], quaternion w, x, y, z, and the joints in the hand's order, at each stage that is known | the same |
| `obj_pose` | pose of the object: that given with `object_pose`, else none | poses become those relative to the object |
| `obj_scale` | `object_scale`, else metres per unit of the mesh's file | `object_scale` |
| `obj_path` | `object_file` | `object_file`; it must be the same in all |

If files state the object's pose elsewhere, in `scene_cfg` or in the file `scene_path`, it must be given. `succ_flag` is
`outcome`. Joints have no names: the order is assumed to be the hand's, and the setting `joint_order` says so. The root is
that of DexGraspBench's MuJoCo models: their palms are moved or turned relative to those of URDF (the Allegro hand's by
the quaternion 0, 1, 0, 1), so give the model itself as the hand.
"""

from pathlib import Path
from typing import Any

import numpy as np

from grasp3d.errors import ContactError
from grasp3d.formats import dictionaries
from grasp3d.formats.checks import has, required, write_array
from grasp3d.formats.format import Format, Given, register
from grasp3d.formats.poses import GraspPoses
from grasp3d.formats.postures import wrist_of


def read(content: Any, given: Given) -> GraspPoses:
    """Poses of the root of a MuJoCo model, in the order of the files. Raises ContactError."""
    parts = []
    for number, rows in enumerate(content, 1):
        where = f"dictionary {number}: "
        required(rows, "grasp_qpos", where)
        part = {
            stage: dictionaries.rows_in(rows.get(key), f"{where}{key}")
            for stage in dictionaries.ALL_STAGES
            if rows.get(key := f"{stage}_qpos") is not None or stage == "grasp"
        }
        if len({len(values) for values in part.values()}) > 1:
            stages = ", ".join(f"{stage}_qpos" for stage in part)
            raise ContactError(f"{where}{stages} must have as many rows")
        parts.append(part)
    return dictionaries.grasps_in(content, parts, given, wrist_of(given.hand).before)


def write(path: Path, poses: GraspPoses) -> None:
    """Write a dictionary with arrays of all grasps; for one grasp, without the first axis."""
    at = np.eye(4) if poses.object_pose is None else poses.object_pose.matrix
    stages = {
        f"{stage}_qpos": values[0] if poses.count == 1 else values
        for stage, values in dictionaries.stages_of(poses).items()
    }
    about = {"obj_pose": dictionaries.qpos_of(at[None], np.zeros((1, 0)))[0],
             "obj_scale": poses.object_scale, "obj_path": poses.object_file or ""}  # fmt: skip
    write_array(path, np.array({**stages, **about}, dtype=object))


register(Format(
    name="dexgraspbench", title="DexGraspBench", suffixes=(".npy",), frame="hand",
    states_frame=True, hands=("articulated",), moves=True, sniff=has("0.grasp_qpos"),
    read=read, write=write, holds="dictionaries with the key grasp_qpos", about=__doc__ or "",
))  # fmt: skip
