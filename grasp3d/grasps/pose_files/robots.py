"""Poses of robots' programs and of simulators, with values of the joints.

`isaac_grasp` is YAML, format version 1.0; MoveIt's is JSON that is a list of ROS messages
`moveit_msgs/Grasp`, field by field.
"""

from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

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
    number_or_none,
    numbers,
    one_number,
    optional_numbers,
    required,
    text_or_none,
    write_yaml,
)
from grasp3d.grasps.pose_files.frames import (
    Given,
    from_quaternions,
    joint_values,
    of_tcp,
    quaternions,
)
from grasp3d.grasps.pose_files.outcomes import outcomes_of_entries
from grasp3d.grasps.poses import GraspPoses
from grasp3d.hand.articulated.articulated_hand import ArticulatedHand
from grasp3d.hand.parallel_gripper import ParallelGripper
from grasp3d.system.documents import described
from grasp3d.system.files import atomic_write

ISAAC, ISAAC_VERSION = "isaac_grasp", 1.0
MOVEIT = "moveit_msgs/Grasp"

DESIRED, LEAST = 0.10, 0.02
"""Desired and smallest length of approach and retreat [m]."""

NO_FORCE_LIMIT = 0.0
"""`max_contact_force` where the gripper states no greatest force: MoveIt then applies none."""


def write_isaac(path: Path, poses: GraspPoses) -> None:
    """Write grasps by name, the gripper's frame relative to the object."""
    hand: Any = poses.hand
    twice = [name for name, count in Counter(poses.names).items() if count > 1]
    if twice:
        raise OutputError(f"two grasps are called {twice[0]!r}: give each a name of its own")
    document = {
        "format": ISAAC,
        "format_version": ISAAC_VERSION,
        "object_frame_link": str(poses.settings.get("object_frame_link", "object")),
        "gripper_frame_link": str(poses.settings.get("gripper_frame_link", hand.name)),
        "object_scale": poses.object_scale,
        "grasps": dict(zip(poses.names, _isaac_entries(poses), strict=True)),
    }
    write_yaml(path, document)


def _isaac_entries(poses: GraspPoses) -> list[dict[str, Any]]:
    outside = np.flatnonzero((poses.scores < 0.0) | (poses.scores > 1.0))
    if len(outside):
        raise OutputError(
            f"the confidence in {ISAAC} files must be from 0 to 1; grasp {outside[0] + 1} has "
            f"{poses.scores[outside[0]]:g}"
        )
    turned = quaternions(poses.poses).tolist()
    hand: Any = poses.hand
    if isinstance(hand, ArticulatedHand):
        values = [poses.posture, poses.pregrasp_posture]
    else:
        openings = poses.opening, poses.pregrasp_opening
        values = [joint_values(hand, one, ISAAC) for one in openings]
    closed, opened = (_named_joints(hand.joint_names, one) for one in values)
    return [
        {
            "confidence": float(poses.scores[k]),
            "position": poses.poses[k, :3, 3].tolist(),
            "orientation": {"w": turned[k][3], "xyz": turned[k][:3]},
            "cspace_position": closed[k],
            "pregrasp_cspace_position": opened[k],
        }
        for k in range(poses.count)
    ]


def _named_joints(names: tuple[str, ...], values: Floats) -> list[dict[str, float]]:
    """Joint values by name; empty where they are not known."""
    if not values.size:
        return [{} for _ in values]
    return [
        {n: v for n, v in zip(names, row, strict=True) if v is not None}
        for row in json_numbers(values)
    ]


def parse_isaac(content: object, given: Given) -> GraspPoses:
    """Grasps of the content of a YAML file, in its order. Raises ContactError."""
    document = mapping(content, "the file")
    if required(document, "format") != ISAAC:
        raise ContactError(f"format must be {ISAAC}; got {described(document['format'])}")
    version = one_number(document.get("format_version", ISAAC_VERSION), "format_version")
    if int(version) != int(ISAAC_VERSION):
        raise ContactError(f"format_version must be {ISAAC_VERSION}; got {version:g}")
    grasps = mapping(required(document, "grasps"), "grasps")
    if not grasps:
        raise ContactError("there are no grasps in it")
    entries = entries_of(grasps.values())
    keys = "cspace_position", "pregrasp_cspace_position"
    fields: dict[str, Any]
    if isinstance(given.hand, ArticulatedHand):
        fields = _stated_postures(entries, *keys)
    else:
        openings = (openings_of_joints(given.hand, _stated_joints(entries, key)) for key in keys)
        fields = dict(zip(("opening", "pregrasp_opening"), openings, strict=True))
    return GraspPoses(
        poses=poses_of_entries(entries),
        **fields,
        scores=optional_numbers(entries, "confidence"),
        outcome=outcomes_of_entries(given.outcome, entries),
        names=tuple(map(str, grasps)),
        object_file=text_or_none(document.get("object_file"), "object_file"),
        object_scale=number_or_none(document.get("object_scale"), "object_scale"),
        settings=_isaac_frames(document),
    )


def poses_of_entries(entries: Entries) -> Floats:
    """Poses that have a position, and an orientation of w and xyz, shape (k, 4, 4)."""
    for number, entry in enumerate(entries, 1):
        if isinstance(entry.get("orientation"), list):
            raise ContactError(
                f"grasp {number}: orientation must be w and xyz: a list of numbers does not state "
                "whether w is the first or the last"
            )
    positions = numbers(each(entries, "position"), (3,), "position")
    w = numbers(each(entries, "orientation", "w"), (), "orientation.w")
    xyz = numbers(each(entries, "orientation", "xyz"), (3,), "orientation.xyz")
    return from_quaternions(positions, np.column_stack([xyz, w]))


def _stated_joints(entries: list[dict[str, Any]], key: str) -> list[dict[str, Any]]:
    return [
        mapping({} if entry.get(key) is None else entry[key], f"grasp {number}: {key}")
        for number, entry in enumerate(entries, 1)
    ]


def _stated_postures(entries: list[dict[str, Any]], key: str, before: str) -> dict[str, Any]:
    """Postures by name; of before the grasp where all grasps state one."""
    names, posture = joints_of(each(entries, key), key)
    fields: dict[str, Any] = {"posture": posture, "joint_names": names}
    stated = [entry for entry in entries if entry.get(before)]
    if stated:
        own, values = joints_of(each(stated, before), before)
        if {*own} != {*names}:
            raise ContactError(f"{before} must have the joints of {key}")
        known = np.array([bool(entry.get(before)) for entry in entries])
        fields["pregrasp_posture"] = np.full(posture.shape, np.nan)
        fields["pregrasp_posture"][known] = values[:, [own.index(name) for name in names]]
    return fields


def _isaac_frames(document: dict[str, Any]) -> dict[str, str]:
    """Names of the frames; the editor calls them ..._link, other programs do not."""
    names: dict[str, str] = {}
    for key in ("object_frame_link", "gripper_frame_link"):
        value = document.get(key, document.get(key.removesuffix("_link")))
        if isinstance(value, str):
            names[key] = value
    return names


def write_moveit(path: Path, poses: GraspPoses) -> None:
    """Write one message for each grasp."""
    hand: Any = poses.hand
    frame = "object" if poses.object_pose is None else poses.object_pose.frame
    turned = quaternions(poses.poses)
    approaches = of_tcp(poses).poses[:, :3, 2]
    before = json_numbers(joint_values(hand, poses.pregrasp_opening, MOVEIT))
    closed = json_numbers(joint_values(hand, poses.opening, MOVEIT))
    messages: list[dict[str, Any]] = []
    for k in range(poses.count):
        approach = approaches[k]
        messages.append(
            {
                "id": poses.names[k],
                "pre_grasp_posture": _posture(hand, before[k], frame),
                "grasp_posture": _posture(hand, closed[k], frame),
                "grasp_pose": {
                    "header": _header(frame),
                    "pose": {
                        "position": _letters(poses.poses[k, :3, 3], "xyz"),
                        "orientation": _letters(turned[k], "xyzw"),
                    },
                },
                "grasp_quality": float(np.nan_to_num(poses.scores[k])),
                "pre_grasp_approach": _translation(approach, frame),
                "post_grasp_retreat": _translation(-approach, frame),
                "post_place_retreat": _translation(-approach, frame),
                "max_contact_force": NO_FORCE_LIMIT if hand.max_force is None else hand.max_force,
                "allowed_touch_objects": [],
            }
        )
    if np.isinf(poses.scores).any():
        raise OutputError(f"the scores of {MOVEIT} messages must be finite")
    with atomic_write(path) as part, part.open("w", encoding="utf-8") as stream:
        stream.write("[\n" + ",\n".join(map(json_text, messages)) + "\n]\n")


def _header(frame: str) -> dict[str, Any]:
    """std_msgs/Header of ROS 2."""
    return {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": frame}


def _letters(values: Floats, letters: str) -> dict[str, float]:
    return dict(zip(letters, values.tolist(), strict=True))


def _posture(hand: ParallelGripper, values: list[Any], frame: str) -> dict[str, Any]:
    """trajectory_msgs/JointTrajectory of one point; of none where the opening is not known."""
    is_known = bool(values) and None not in values
    point = {
        "positions": values, "velocities": [], "accelerations": [], "effort": [],
        "time_from_start": {"sec": 0, "nanosec": 0},
    }  # fmt: skip
    return {
        "header": _header(frame),
        "joint_names": list(hand.joint_names) if is_known else [],
        "points": [point] if is_known else [],
    }


def _translation(direction: Floats, frame: str) -> dict[str, Any]:
    """moveit_msgs/GripperTranslation."""
    return {
        "direction": {"header": _header(frame), "vector": _letters(direction, "xyz")},
        "desired_distance": DESIRED,
        "min_distance": LEAST,
    }


def parse_moveit(content: object, given: Given) -> GraspPoses:
    """Poses of the content of a JSON file, a list of messages or one. Raises ContactError."""
    messages = entries_of(
        grasp_list(content if isinstance(content, list) else [content], "the file")
    )
    hand = given.hand
    return GraspPoses(
        poses=_moveit_poses(messages),
        opening=_moveit_openings(hand, messages, "grasp_posture"),
        pregrasp_opening=_moveit_openings(hand, messages, "pre_grasp_posture"),
        scores=optional_numbers(messages, "grasp_quality"),
        outcome=outcomes_of_entries(given.outcome, messages),
        names=tuple(str(m.get("id", f"grasp_{number}")) for number, m in enumerate(messages, 1)),
        settings=_moveit_frame(messages),
    )


def _moveit_poses(messages: list[dict[str, Any]]) -> Floats:
    """Poses of the gripper's frame, shape (k, 4, 4)."""
    where = ("grasp_pose", "pose")
    position, turned = (
        np.column_stack(
            [
                numbers(each(messages, *where, part, letter), (), f"{part}.{letter}")
                for letter in letters
            ]
        )
        for part, letters in (("position", "xyz"), ("orientation", "xyzw"))
    )
    return from_quaternions(position, turned)


def _moveit_openings(hand: ParallelGripper, messages: list[dict[str, Any]], key: str) -> Floats:
    """Openings [m] at the last point of the postures, (k,); nan: not stated."""
    joints = []
    for number, message in enumerate(messages, 1):
        where = f"grasp {number}: {key}"
        posture = mapping(message.get(key, {}), where)
        names, points = posture.get("joint_names", []), posture.get("points", [])
        if not isinstance(names, list) or not isinstance(points, list):
            raise ContactError(f"{where} must have lists joint_names and points")
        last = mapping(points[-1], f"{where}: a point") if points else {}
        positions = last.get("positions", [])
        if not isinstance(positions, list) or (points and len(positions) != len(names)):
            raise ContactError(
                f"{where} must have a position of each of {len(names)} joints; got "
                f"{described(positions)}"
            )
        joints.append(dict(zip(map(str, names), positions, strict=False)))
    return openings_of_joints(hand, joints)


def _moveit_frame(messages: list[dict[str, Any]]) -> dict[str, str]:
    """The frame that all poses are in."""
    frames = {
        text_or_none(
            mapping(message["grasp_pose"].get("header", {}), "grasp_pose.header").get("frame_id"),
            "frame_id",
        )
        for message in messages
    }
    if len(frames) > 1:
        raise ContactError(
            f"all grasps must be in the frame of the object; got {len(frames)} values of frame_id"
        )
    (frame,) = frames
    return {"frame_id": frame} if frame else {}


def openings_of_joints(hand: ParallelGripper, joints: Sequence[dict[str, Any]]) -> Floats:
    """Openings [m] from joint values by name, the mean over the joints, (k,); nan: not stated.

    Raises:
        ContactError: The joints are those of another gripper.
    """
    names = {name: k for k, name in enumerate(hand.joint_names) if hand.joint_scale[k]}
    openings = np.full(len(joints), np.nan)
    for number, values in enumerate(joints):
        own = [name for name in values if name in names]
        if not own:
            if values and names:
                stated = ", ".join(str(name)[:40] for name in list(values)[:4])
                raise ContactError(
                    f"its joints ({stated}) are not those of gripper {hand.name!r} "
                    f"({', '.join(names)}): give the gripper that the file was written for"
                )
            continue
        indices = [names[name] for name in own]
        positions = numbers([[values[name] for name in own]], (len(own),), "joint values")[0]
        scale = np.array(hand.joint_scale)[indices]
        opening = float(((positions - np.array(hand.joint_closed)[indices]) / scale).mean())
        if opening < -0.1 * hand.max_opening:
            raise ContactError(
                f"grasp {number + 1}: its joint values mean an opening of {opening:.4g} m: are "
                f"they those of gripper {hand.name!r}?"
            )
        openings[number] = max(opening, 0.0)  # below 0 where fingers are pressed together
    return openings
