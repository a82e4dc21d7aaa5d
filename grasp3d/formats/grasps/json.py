"""JSON of grasp3d: everything that is known of poses.

An object: `grasp3d` is about all grasps, `grasps` a list.

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

import numpy as np

from grasp3d.errors import ContactError, OutputError
from grasp3d.formats import checks, own
from grasp3d.formats.format import Format, Given, register
from grasp3d.formats.poses import OWN_NAMES, STAGES, VECTOR_COLUMNS, GraspPoses


def write(path: Path, poses: GraspPoses) -> None:
    """Write what applies to all grasps, then one line for each grasp."""
    names, placed = own.joint_names(poses), {"pose": poses.poses.tolist()}
    for name, values in own.stages_of(poses).items():
        rows = checks.json_numbers(values)
        by_name = values.ndim == 2
        placed[name] = [dict(zip(names, row, strict=True)) for row in rows] if by_name else rows
    further = {name: one for name, one in poses.columns.items() if name not in VECTOR_COLUMNS}
    columns = {
        name: checks.json_numbers(values) if isinstance(values, np.ndarray) else values
        for name, values in {**own.columns_of(poses, **placed), **further}.items()
    }
    if vectors := own.vectors_of(poses):
        keys = [{"contacts": "point", "normals": "normal"}[name] for name in vectors]
        columns["contacts"] = [
            [dict(zip(keys, one, strict=True)) for one in zip(*grasp, strict=True)]
            for grasp in zip(*map(checks.json_numbers, vectors.values()), strict=True)
        ]
    try:
        header = checks.json_text(own.header_of(poses))
    except (TypeError, ValueError) as error:
        raise OutputError(f"{path}: the settings of the poses are no JSON: {error}") from error
    checks.write_rows(path, header, checks.rows_of(columns, poses.count))


def read(content: Any, given: Given) -> GraspPoses:
    """Poses of the content of a JSON file. Raises ContactError."""
    document = checks.mapping(content, "the file")
    entries = checks.entries_of(checks.grasp_list(checks.required(document, "grasps"), "grasps"))
    keys = list(dict.fromkeys(key for entry in entries for key in entry))
    listed = {key: [entry.get(key) for entry in entries] for key in keys}
    further = [key for key in keys if key not in {*OWN_NAMES, *VECTOR_COLUMNS}]
    return own.poses_of(
        listed,
        given,
        poses=checks.numbers(checks.each(entries, "pose"), (4, 4), "pose"),
        **_stages(entries),
        names=tuple(str(one.get("name", f"grasp_{k}")) for k, one in enumerate(entries, 1)),
        columns={key: own.column_of(listed[key], key) for key in further},
        **own.fields_of(
            checks.mapping(document.get("grasp3d", {}), "grasp3d") | own.stated_in(listed), given
        ),
    )


def _stages(entries: checks.Entries) -> dict[str, Any]:
    """Postures, and poses before and after the grasp, as far as they are stated."""
    found: dict[str, Any] = {}
    names: tuple[str, ...] | None = None
    for name in ("posture", *(f"{stage}_posture" for stage in STAGES)):
        if any(name in entry for entry in entries):
            of_stage, values = checks.joints_of(checks.each(entries, name), name)
            names = of_stage if names is None else names
            if {*of_stage} != {*names}:
                raise ContactError(f"{name} must have the joints of the posture")
            order = [of_stage.index(joint) for joint in names]
            found |= {name: values[:, order], "joint_names": names}
    for stage in STAGES:
        if any((key := f"{stage}_pose") in entry for entry in entries):
            found[f"{key}s"] = checks.numbers(checks.each(entries, key), (4, 4), key)
    return found


register(
    Format(
        name="json",
        title="JSON",
        suffixes=(".json",),
        sniff=checks.has("grasps.0.pose"),
        read=read,
        write=write,
        holds="the key grasps with poses, as write_grasps writes them",
        states_frame=True,
        unit="stated",
        hands=(),
        moves=True,
        main=True,
        about=__doc__ or "",
    )
)
