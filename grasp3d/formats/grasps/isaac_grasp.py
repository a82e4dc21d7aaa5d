"""YAML of isaac_grasp 1.0, with values of the joints.

| key | written | read |
|---|---|---|
| `format` `format_version` | `isaac_grasp`, 1.0 | the same; the version also as text |
| `object_frame_link` `gripper_frame_link` | settings of these names, else `object` and the gripper's name | also without `_link`; information only |
| `object_scale` | `object_scale`, else metres per unit of the mesh's file | `object_scale` |
| `grasps.NAME` | names must differ | order of the file |
| `confidence` | `scores`, 0 to 1; `.nan`: not known | `scores`; [outcomes](#outcomes) with `--outcome confidence` |
| `position` | of the hand [m] | |
| `orientation` | `w` and `xyz` of the quaternion | a list of four numbers is refused, as its order is not stated |
| `cspace_position` | joint values at `opening`: `joint_closed` + `joint_scale` × opening; empty: not known. Of hands with joints `posture` | mean over the joints that the gripper has; `posture`, which all grasps must state |
| `pregrasp_cspace_position` | the same at `pregrasp_opening`; `pregrasp_posture` | |

`object_scale`, here and in the other formats, is the factor from the numbers of the object's mesh file to metres. A mesh
of unknown unit is scaled by it. A different stated unit is an error if `object_file` is the name of the mesh, else a
warning, as the poses may have been made for another file of the object.

GraspDataGen writes isaac_grasp too; its `confidence` says whether the grasp held in simulation: `--outcome confidence`.
"""

from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np

from grasp3d.arrays import Floats
from grasp3d.errors import ContactError, OutputError
from grasp3d.formats import checks, frames
from grasp3d.formats.format import Format, Given, register
from grasp3d.formats.poses import GraspPoses
from grasp3d.hand.articulated_hand import ArticulatedHand
from grasp3d.system.documents import described, number_of

NAME, VERSION = "isaac_grasp", 1.0

AT, BEFORE = "cspace_position", "pregrasp_cspace_position"
"""Keys of the joint values at the grasp and before it."""

LINKS = ("object_frame_link", "gripper_frame_link")


def write(path: Path, poses: GraspPoses) -> None:
    """Write grasps by name, as poses of the gripper's frame relative to the object."""
    if twice := [name for name, count in Counter(poses.names).items() if count > 1]:
        raise OutputError(f"two grasps are called {twice[0]!r}: give each a name of its own")
    if len(outside := np.flatnonzero((poses.scores < 0.0) | (poses.scores > 1.0))):
        one = f"grasp {outside[0] + 1} has {poses.scores[outside[0]]:g}"
        raise OutputError(f"the confidence in {NAME} files must be from 0 to 1; {one}")
    hand: Any = poses.hand
    values = [poses.posture, poses.pregrasp_posture]
    if not isinstance(hand, ArticulatedHand):
        values = [frames.joint_values(hand, one) for one in (poses.opening, poses.pregrasp_opening)]

    def by_name(values: Floats, k: int) -> dict[str, float]:
        """Joint values of a grasp; empty where they are not known."""
        row = checks.json_values(values[k]) if values.size else ()
        return {n: v for n, v in zip(hand.joint_names, row, strict=False) if v is not None}

    turned, position = frames.quaternions(poses.poses).tolist(), poses.poses[:, :3, 3].tolist()
    grasps = {
        name: {
            "confidence": float(poses.scores[k]),
            "position": position[k],
            "orientation": {"w": turned[k][3], "xyz": turned[k][:3]},
            **{key: by_name(one, k) for key, one in zip((AT, BEFORE), values, strict=True)},
        }
        for k, name in enumerate(poses.names)
    }
    links = zip(LINKS, ("object", hand.name), strict=True)
    about = {key: str(poses.settings.get(key, name)) for key, name in links}
    head = {"format": NAME, "format_version": VERSION, **about, "object_scale": poses.object_scale}
    checks.write_yaml(path, {**head, "grasps": grasps})


def read(content: Any, given: Given) -> GraspPoses:
    """Grasps of the content of a YAML file, in its order. Raises ContactError."""
    document = checks.mapping(content, "the file")
    if checks.required(document, "format") != NAME:
        raise ContactError(f"format must be {NAME}; got {described(document['format'])}")
    version = document.get("format_version", VERSION)
    if not VERSION <= number_of(version) < VERSION + 1.0:
        raise ContactError(f"format_version must be {VERSION}; got {described(version)}")
    grasps = checks.mapping(checks.required(document, "grasps"), "grasps")
    entries = checks.entries_of(list(grasps.values()), "grasps")
    stated = {key: document.get(key, document.get(key.removesuffix("_link"))) for key in LINKS}
    fields = _postures(entries) if isinstance(given.hand, ArticulatedHand) else {
        field: frames.openings_of_joints(given.hand, [one.get(key) or {} for one in entries], key)
        for field, key in (("opening", AT), ("pregrasp_opening", BEFORE))
    }  # fmt: skip
    return GraspPoses(
        poses=_poses(entries),
        **fields,
        scores=checks.optional_numbers(entries, "confidence"),
        outcome=checks.outcomes_of_entries(given.outcome, entries),
        names=tuple(map(str, grasps)),
        object_file=checks.text_or_none(document.get("object_file"), "object_file"),
        object_scale=checks.number_or_none(document.get("object_scale"), "object_scale"),
        settings={key: value for key, value in stated.items() if isinstance(value, str)},
    )


def _poses(entries: checks.Entries) -> Floats:
    """Poses from a position and an orientation of w and xyz, shape (k, 4, 4)."""
    if any(isinstance(entry.get("orientation"), list) for entry in entries):
        raise ContactError("orientation must be w and xyz: a list does not state where w is")
    position = checks.numbers(checks.each(entries, "position"), (3,), "position")
    w = checks.numbers(checks.each(entries, "orientation", "w"), (), "orientation.w")
    xyz = checks.numbers(checks.each(entries, "orientation", "xyz"), (3,), "orientation.xyz")
    return frames.from_quaternions(np.column_stack([position, xyz, w]))


def _postures(entries: checks.Entries) -> dict[str, Any]:
    """Fields of postures by name, with those before the grasp if any grasp states one."""
    names, posture = checks.joints_of(checks.each(entries, AT), AT)
    fields: dict[str, Any] = {"posture": posture, "joint_names": names}
    if any(entry.get(BEFORE) for entry in entries):
        stated = [entry.get(BEFORE) or dict.fromkeys(names) for entry in entries]
        _, fields["pregrasp_posture"] = checks.joints_of(stated, BEFORE, names)
    return fields


register(Format(
    name=NAME, title=NAME, suffixes=(".yaml", ".yml"), frame="hand",
    hands=("gripper", "articulated"), joints=True, needs=("yaml", "PyYAML"), sniff=checks.has("format"), read=read, write=write,
    holds="the key format with isaac_grasp", about=__doc__ or "",
))  # fmt: skip
