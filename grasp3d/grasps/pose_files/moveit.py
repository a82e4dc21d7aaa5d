"""Poses as JSON that is a list of ROS messages `moveit_msgs/Grasp`, field by field."""

from pathlib import Path
from typing import Any

import numpy as np

from grasp3d.arrays import Floats
from grasp3d.errors import ContactError, OutputError
from grasp3d.grasps.pose_files.documents import (
    each,
    grasp_list,
    json_numbers,
    json_text,
    kind,
    mapping,
    numbers,
    optional_numbers,
    text_or_none,
)
from grasp3d.grasps.pose_files.frames import (
    for_robots,
    from_quaternions,
    hand_poses,
    joint_values,
    needed_gripper,
    openings_of_joints,
    quaternions,
    tcp_poses,
)
from grasp3d.grasps.poses import GraspPoses
from grasp3d.hand.hand import Hand
from grasp3d.hand.parallel_gripper import ParallelGripper
from grasp3d.settings.lengths import Unit
from grasp3d.system.files import atomic_write

WHAT = "moveit_msgs/Grasp"

DESIRED, LEAST = 0.10, 0.02
"""Desired and smallest length of approach and retreat [m]."""

NO_FORCE_LIMIT = 0.0
"""`max_contact_force` where the gripper states no greatest force: MoveIt then applies none."""


def is_moveit(content: object) -> bool:
    """Whether the content of a JSON file is in this format."""
    first = content[0] if isinstance(content, list) and content else content
    return isinstance(first, dict) and "grasp_pose" in first


def write_moveit(path: Path, poses: GraspPoses) -> None:
    """Write one message for each grasp."""
    hand, in_metres = for_robots(poses, WHAT)
    frame = str(in_metres.settings.get("frame_id", "object"))
    bases = hand_poses(in_metres.poses, hand)
    turned = quaternions(bases)
    before = json_numbers(joint_values(hand, in_metres.pregrasp_opening, WHAT))
    closed = json_numbers(joint_values(hand, in_metres.opening, WHAT))
    messages = []
    for k in range(in_metres.count):
        approach = in_metres.poses[k, :3, 2]
        messages.append(
            {
                "id": in_metres.names[k],
                "pre_grasp_posture": _posture(hand, before[k], frame),
                "grasp_posture": _posture(hand, closed[k], frame),
                "grasp_pose": {
                    "header": _header(frame),
                    "pose": {
                        "position": _letters(bases[k, :3, 3], "xyz"),
                        "orientation": _letters(turned[k], "xyzw"),
                    },
                },
                "grasp_quality": float(np.nan_to_num(in_metres.scores[k])),
                "pre_grasp_approach": _translation(approach, frame),
                "post_grasp_retreat": _translation(-approach, frame),
                "post_place_retreat": _translation(-approach, frame),
                "max_contact_force": NO_FORCE_LIMIT if hand.max_force is None else hand.max_force,
                "allowed_touch_objects": [],
            }
        )
    _check_finite(in_metres.scores)
    with atomic_write(path) as part, part.open("w", encoding="utf-8") as stream:
        stream.write("[\n" + ",\n".join(map(json_text, messages)) + "\n]\n")


def _check_finite(scores: Floats) -> None:
    if np.isinf(scores).any():
        raise OutputError(f"the scores of {WHAT} messages must be finite")


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


def parse_moveit(content: object, hand: Hand | None, unit: Unit | None) -> GraspPoses:
    """Poses of the content of a JSON file, a list of messages or one. Raises ContactError."""
    entries = grasp_list(content if isinstance(content, list) else [content], "the file")
    messages = [mapping(message, f"grasp {number}") for number, message in enumerate(entries, 1)]
    hand = needed_gripper(hand, unit, WHAT)
    return GraspPoses(
        poses=tcp_poses(_bases(messages), hand),
        opening=_openings(hand, messages, "grasp_posture"),
        pregrasp_opening=_openings(hand, messages, "pre_grasp_posture"),
        scores=optional_numbers(messages, "grasp_quality"),
        names=tuple(str(m.get("id", f"grasp_{number}")) for number, m in enumerate(messages, 1)),
        unit="m",
        hand=hand,
        settings=_frame(messages),
    )


def _bases(messages: list[dict[str, Any]]) -> Floats:
    """Poses of the hand's base, shape (k, 4, 4)."""
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


def _openings(hand: ParallelGripper, messages: list[dict[str, Any]], key: str) -> Floats:
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
                f"{kind(positions)}"
            )
        joints.append(dict(zip(map(str, names), positions, strict=False)))
    return openings_of_joints(hand, joints)


def _frame(messages: list[dict[str, Any]]) -> dict[str, str]:
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
