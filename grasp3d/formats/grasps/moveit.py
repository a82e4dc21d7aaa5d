"""JSON of `moveit_msgs/Grasp`, a list of messages.

It has every field of the definition (headers and durations of ROS 2; ROS 1 is read too).

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

from pathlib import Path
from typing import Any

import numpy as np

from grasp3d.arrays import Floats
from grasp3d.errors import ContactError, OutputError
from grasp3d.formats import checks
from grasp3d.formats.format import Format, Given, register
from grasp3d.formats.frames import (
    from_quaternions,
    joint_values,
    of_tcp,
    openings_of_joints,
    quaternions,
)
from grasp3d.formats.outcomes import outcomes_of_entries
from grasp3d.formats.poses import GraspPoses
from grasp3d.system.documents import described

DESIRED, LEAST = 0.10, 0.02
"""Desired and smallest length of approach and retreat [m]."""

NO_FORCE_LIMIT = 0.0
"""`max_contact_force` where the gripper states no greatest force: MoveIt then applies none."""


def write(path: Path, poses: GraspPoses) -> None:
    """Write one message for each grasp."""
    if np.isinf(poses.scores).any():
        raise OutputError("the scores of moveit_msgs/Grasp messages must be finite")
    hand: Any = poses.hand
    frame = "object" if poses.object_pose is None else poses.object_pose.frame
    header = {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": frame}  # std_msgs/Header of ROS 2
    turned, approaches = quaternions(poses.poses), of_tcp(poses).poses[:, :3, 2]

    def letters(values: Floats, names: str = "xyz") -> dict[str, float]:
        return dict(zip(names, values.tolist(), strict=True))

    def postures(openings: Floats) -> list[dict[str, Any]]:
        """trajectory_msgs/JointTrajectory of one point; of none where openings are not known."""
        rows = checks.json_numbers(joint_values(hand, openings, FORMAT))
        known = [bool(row) and None not in row for row in rows]
        time = {"sec": 0, "nanosec": 0}
        empty: dict[str, Any] = {"velocities": [], "accelerations": [], "effort": []}
        return [
            {
                "header": header,
                "joint_names": list(hand.joint_names) if is_known else [],
                "points": [{"positions": row, **empty, "time_from_start": time}]
                if is_known
                else [],
            }
            for row, is_known in zip(rows, known, strict=True)
        ]

    def translation(direction: Floats) -> dict[str, Any]:
        """moveit_msgs/GripperTranslation."""
        return {
            "direction": {"header": header, "vector": letters(direction)},
            "desired_distance": DESIRED,
            "min_distance": LEAST,
        }

    before, closed = postures(poses.pregrasp_opening), postures(poses.opening)
    messages: list[dict[str, Any]] = [
        {
            "id": poses.names[k],
            "pre_grasp_posture": before[k],
            "grasp_posture": closed[k],
            "grasp_pose": {
                "header": header,
                "pose": {
                    "position": letters(poses.poses[k, :3, 3]),
                    "orientation": letters(turned[k], "xyzw"),
                },
            },
            "grasp_quality": float(np.nan_to_num(poses.scores[k])),
            "pre_grasp_approach": translation(approaches[k]),
            "post_grasp_retreat": translation(-approaches[k]),
            "post_place_retreat": translation(-approaches[k]),
            "max_contact_force": NO_FORCE_LIMIT if hand.max_force is None else hand.max_force,
            "allowed_touch_objects": [],
        }
        for k in range(poses.count)
    ]
    checks.write_text(path, "[\n" + ",\n".join(map(checks.json_text, messages)) + "\n]\n")


def read(content: Any, given: Given) -> GraspPoses:
    """Poses of the content of a JSON file, a list of messages or one. Raises ContactError."""
    messages = checks.entries_of(
        checks.grasp_list(content if isinstance(content, list) else [content], "the file")
    )
    position, turned = (
        np.column_stack(
            [
                checks.numbers(
                    checks.each(messages, "grasp_pose", "pose", part, letter),
                    (),
                    f"{part}.{letter}",
                )
                for letter in letters
            ]
        )
        for part, letters in (("position", "xyz"), ("orientation", "xyzw"))
    )
    frames = {
        checks.text_or_none(
            checks.mapping(message["grasp_pose"].get("header", {}), "grasp_pose.header").get(
                "frame_id"
            ),
            "frame_id",
        )
        for message in messages
    }
    if len(frames) > 1:
        raise ContactError(
            f"all grasps must be in the frame of the object; got {len(frames)} values of frame_id"
        )
    (frame,) = frames
    return GraspPoses(
        poses=from_quaternions(position, turned),
        opening=openings_of_joints(given.hand, _joints(messages, "grasp_posture")),
        pregrasp_opening=openings_of_joints(given.hand, _joints(messages, "pre_grasp_posture")),
        scores=checks.optional_numbers(messages, "grasp_quality"),
        outcome=outcomes_of_entries(given.outcome, messages),
        names=tuple(str(m.get("id", f"grasp_{number}")) for number, m in enumerate(messages, 1)),
        settings={"frame_id": frame} if frame else {},
    )


def _joints(messages: checks.Entries, key: str) -> list[dict[str, float]]:
    """Values of joints at the last point of the postures, by name; empty: not stated."""
    joints = []
    for number, message in enumerate(messages, 1):
        where = f"grasp {number}: {key}"
        posture = checks.mapping(message.get(key, {}), where)
        names, points = posture.get("joint_names", []), posture.get("points", [])
        if not isinstance(names, list) or not isinstance(points, list):
            raise ContactError(f"{where} must have lists joint_names and points")
        values = checks.mapping(points[-1], f"{where}: a point").get("positions") if points else []
        if not isinstance(values, list) or (points and len(values) != len(names)):
            raise ContactError(
                f"{where} must have a position of each of {len(names)} joints; got "
                f"{described(values)}"
            )
        joints.append(dict(zip(map(str, names), checks.numbers(values, (), where), strict=False)))
    return joints


FORMAT = Format(
    name="moveit",
    title="moveit_msgs/Grasp",
    suffixes=(".json",),
    sniff=checks.has("0.grasp_pose"),
    read=read,
    write=write,
    holds="a list of messages with grasp_pose",
    frame="hand",
    joints=True,
    moves=True,
    about=__doc__ or "",
)
register(FORMAT)
