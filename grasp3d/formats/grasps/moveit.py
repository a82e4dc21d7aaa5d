"""JSON of `moveit_msgs/Grasp`, a list of messages.

Messages have every field of the definition (headers and durations of ROS 2; ROS 1 is read too).

| field | written | read |
|---|---|---|
| `id` | name | name |
| `pre_grasp_posture` `grasp_posture` | one point: joint values at `pregrasp_opening` and `opening`; no point: not known | last point |
| `grasp_pose` | of the hand [m], quaternion x y z w; `frame_id` is the robot's frame where the object's pose is given, else `object` | one `frame_id` in all messages; another one than `object` needs the pose of the object in it, `object_pose=`, which is `0,0,0,0` where it is the object's own |
| `grasp_quality` | `scores`; 0: not known | `scores` |
| `pre_grasp_approach` | along the approach direction, 0.10 m, at least 0.02 m | |
| `post_grasp_retreat` `post_place_retreat` | against it, the same lengths | |
| `max_contact_force` | `max_force` of the gripper; 0: no limit | |
| `allowed_touch_objects` | empty | |

`grasp_pose` is the pose of the hand's own frame. Where the end effector's parent link is another one (`panda_link8`
of the Franka arm is turned by 45° about z), state it with `--frame panda_link8`.
"""

import json
from pathlib import Path
from typing import Any

import numpy as np

from grasp3d.arrays import Floats
from grasp3d.errors import ContactError, OutputError
from grasp3d.formats import checks, frames
from grasp3d.formats.format import Format, Given, register
from grasp3d.formats.poses import GraspPoses

DESIRED, LEAST = 0.10, 0.02
"""Desired and smallest length of approach and retreat [m]."""

TIME = {"sec": 0, "nanosec": 0}


def write(path: Path, poses: GraspPoses) -> None:
    """Write one message for each grasp."""
    if np.isinf(poses.scores).any():
        raise OutputError("the scores of moveit_msgs/Grasp messages must be finite")
    hand: Any = poses.hand
    frame = "object" if poses.object_pose is None else poses.object_pose.frame
    header = {"stamp": TIME, "frame_id": frame}  # std_msgs/Header of ROS 2
    turned, approaches = frames.quaternions(poses.poses), frames.of_tcp(poses).poses[:, :3, 2]

    def letters(values: Floats, names: str = "xyz") -> dict[str, float]:
        return dict(zip(names, values.tolist(), strict=True))

    def postures(openings: Floats) -> list[dict[str, Any]]:
        """trajectory_msgs/JointTrajectory of one point, or of none if an opening is not known."""
        rows = checks.json_values(frames.joint_values(hand, openings))
        empty: dict[str, Any] = {"velocities": [], "accelerations": [], "effort": []}
        points = [
            [{"positions": row, **empty, "time_from_start": TIME}]
            if row and None not in row
            else []
            for row in rows
        ]
        names = list(hand.joint_names)
        return [{"header": header, "joint_names": names if p else [], "points": p} for p in points]

    def along(direction: Floats) -> dict[str, Any]:
        """moveit_msgs/GripperTranslation."""
        stated = {"header": header, "vector": letters(direction)}
        return {"direction": stated, "desired_distance": DESIRED, "min_distance": LEAST}

    before, closed = postures(poses.pregrasp_opening), postures(poses.opening)
    messages: list[dict[str, Any]] = []
    for k, pose in enumerate(poses.poses):
        at = {"position": letters(pose[:3, 3]), "orientation": letters(turned[k], "xyzw")}
        messages.append({
            "id": poses.names[k],
            "pre_grasp_posture": before[k],
            "grasp_posture": closed[k],
            "grasp_pose": {"header": header, "pose": at},
            "grasp_quality": float(np.nan_to_num(poses.scores[k])),
            "pre_grasp_approach": along(approaches[k]),
            "post_grasp_retreat": along(-approaches[k]),
            "post_place_retreat": along(-approaches[k]),
            "max_contact_force": hand.max_force or 0.0,  # 0: MoveIt applies no limit
            "allowed_touch_objects": [],
        })  # fmt: skip
    checks.write_text(path, ["[\n", ",\n".join(map(json.dumps, messages)), "\n]\n"])


def read(content: Any, given: Given) -> GraspPoses:
    """Poses of the content of a JSON file, a list of messages or one. Raises ContactError."""
    messages = checks.entries_of(content if isinstance(content, list) else [content], "the file")
    parts = [("position", letter) for letter in "xyz"] + [("orientation", one) for one in "xyzw"]
    placed = np.column_stack([
        checks.numbers(checks.each(messages, "grasp_pose", "pose", *part), (), ".".join(part))
        for part in parts
    ])  # fmt: skip
    headers = [
        checks.mapping(message["grasp_pose"].get("header", {}), "grasp_pose.header")
        for message in messages
    ]
    frame, *others = {checks.text_or_none(one.get("frame_id"), "frame_id") for one in headers}
    if others:
        raise ContactError("all grasps must be in the same frame; their frame_id differ")
    return GraspPoses(
        poses=frames.from_quaternions(placed),
        opening=_openings(messages, "grasp_posture", given),
        pregrasp_opening=_openings(messages, "pre_grasp_posture", given),
        scores=checks.optional_numbers(messages, "grasp_quality"),
        outcome=checks.outcomes_of_entries(given.outcome, messages),
        names=tuple(str(m.get("id", f"grasp_{number}")) for number, m in enumerate(messages, 1)),
        settings={"frame_id": frame} if frame else {},
    )


def _openings(messages: checks.Entries, key: str, given: Given) -> Floats:
    """Openings of the last point of the postures, (k,); nan: not stated."""
    rows = []
    for number, message in enumerate(messages, 1):
        where = f"grasp {number}: {key}"
        posture = checks.mapping(message.get(key, {}), where)
        names, points = posture.get("joint_names", []), posture.get("points", [])
        if not isinstance(names, list) or not isinstance(points, list):
            raise ContactError(f"{where} must have lists joint_names and points")
        values = checks.mapping(points[-1], f"{where}: a point").get("positions") if points else []
        if not isinstance(values, list) or (points and len(values) != len(names)):
            raise ContactError(f"{where} must have a position of each of its joints")
        rows.append(dict(zip(map(str, names), values, strict=False)))
    return frames.openings_of_joints(given.hand, rows, key)


register(Format(
    name="moveit", title="moveit_msgs/Grasp", suffixes=(".json",), frame="hand", joints=True,
    moves=True, sniff=checks.has("0.grasp_pose"), read=read, write=write,
    holds="a list of messages with grasp_pose", about=__doc__ or "",
))  # fmt: skip
