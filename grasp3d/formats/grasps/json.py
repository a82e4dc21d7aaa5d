"""JSON of grasp3d: everything that is known about poses.

An object of two keys: `grasp3d` applies to all grasps, and `grasps` is a list of them.

| key of `grasp3d` | |
|---|---|
| `version` `content` | version of grasp3d; what poses are, in words |
| `unit` | unit of all lengths: m, `unknown` where that of the mesh is not known; in files of others also cm, mm or in |
| `frame` `normals` `angles` | `object`, or the name of the robot's frame in which the poses are; `outward`; `radians`. In files by others `frame` may be absent; another frame than `object` is refused unless its object's pose is given (`--object-pose`), as are other normals and angles |
| `gripper_frame` | frame of the gripper in which the poses are: a name, or the text of the matrix that `--frame` takes, `[[1.0, 0.0, …], …]`; absent: `tcp` |
| `gripper` | the gripper as in `gripper.json`, its name, or null |
| `object_file` `object_scale` | mesh file, and factor from its numbers to metres, or null |
| `object_pose` | null: the poses are in the object's frame; else they are in the frame of a robot, and this is the object's pose there, as `--object-pose` takes it: `0.4,0.0,0.1,0.0,0.0,0.0,1.0,base_link` |
| others | the settings of the grasps |

| key of a grasp | |
|---|---|
| `name` | text |
| `pose` | 4×4 matrix, a list of four rows |
| `opening` | distance of the contacts at the grasp; null: not known |
| `posture` `pregrasp_posture` `squeeze_posture` | only of hands with joints: values of the joints [rad or m], an object by their names; at the grasp, before it, and as commanded to press |
| `pregrasp_pose` `squeeze_pose` | only where they differ from `pose` |
| `pregrasp_opening` | opening with which the gripper approaches; null: not known |
| `score` | confidence or another quality, larger is better; null: not known. Of [best grasps](#scores) their order |
| `outcome` | 1: the grasp held, 0: it failed; null: not tried. Read also as `success`, and as [true and false](#outcomes) |
| `contacts` | list of two: `point` `[x, y, z]` and outward `normal`; with poses for people and other programs, not read |
| others | [further columns](#further-columns) |
"""

from pathlib import Path
from typing import Any

from grasp3d.formats import checks, own
from grasp3d.formats.format import Format, Given, register
from grasp3d.formats.poses import STAGES, GraspPoses


def write(path: Path, poses: GraspPoses) -> None:
    """Write what applies to all grasps, then one line for each grasp."""
    names, table = own.joint_names(poses), own.table_of(poses)
    keys = {"contacts": "point", "normals": "normal"}
    vectors = {key: table.pop(name) for name, key in keys.items() if name in table}
    columns = {name: checks.json_values(values) for name, values in table.items()}
    for name in {f"{stage}posture" for stage in STAGES} & columns.keys():
        columns[name] = [dict(zip(names, row, strict=True)) for row in columns[name]]
    if vectors:
        columns["contacts"] = checks.nested(vectors)
    checks.write_rows(path, own.header_of(poses), columns)


def read(content: Any, given: Given) -> GraspPoses:
    """Poses of the content of a JSON file. Raises ContactError."""
    document = checks.mapping(content, "the file")
    entries = checks.entries_of(checks.required(document, "grasps"), "grasps")
    keys = dict.fromkeys(("pose", *(key for entry in entries for key in entry)))
    table: dict[str, Any] = {key: [entry.get(key) for entry in entries] for key in keys}
    joints: tuple[str, ...] = ()
    for stage in STAGES:
        if (key := f"{stage}pose") in table:
            table[key] = checks.numbers(checks.each(entries, key), (4, 4), key)
        if (key := f"{stage}posture") in table:
            joints, table[key] = checks.joints_of(checks.each(entries, key), key, joints)
    header = checks.mapping(document.get("grasp3d", {}), "grasp3d")
    return own.poses_of(table, joints, header, given)


register(Format(
    name="json", title="JSON", suffixes=(".json",), states_frame=True, unit="stated", hands=(),
    moves=True, main=True, sniff=checks.has("grasps.0.pose"), read=read, write=write,
    holds="the key grasps with poses, as write_grasps writes them", about=__doc__ or "",
))  # fmt: skip
