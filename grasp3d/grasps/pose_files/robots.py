"""Poses of robots' programs and of simulators, with values of the joints.

`isaac_grasp` is YAML, format version 1.0; MoveIt's is JSON that is a list of ROS messages
`moveit_msgs/Grasp`, field by field. GraspDataGen writes isaac_grasp with further keys. Replicator's
files are the configurations of the extension isaacsim.replicator.grasping, and what it writes of
each grasp that it has tried. MultiGripperGrasp and RoboTwin are JSON.
"""

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from grasp3d.arrays import Floats
from grasp3d.errors import ContactError, OutputError
from grasp3d.grasps.pose_files.documents import (
    Entries,
    as_many,
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
    write_json,
    write_yaml,
)
from grasp3d.grasps.pose_files.frames import (
    FIELD,
    Given,
    from_quaternions,
    joint_values,
    known_outcomes,
    of_tcp,
    quaternions,
)
from grasp3d.grasps.pose_files.outcomes import outcomes_of, outcomes_of_entries
from grasp3d.grasps.poses import GraspPoses
from grasp3d.hand.articulated.articulated_hand import ArticulatedHand
from grasp3d.hand.frames import FRAMES, GripperFrame
from grasp3d.hand.jaws import AXES
from grasp3d.hand.parallel_gripper import ParallelGripper
from grasp3d.settings.outcome import Outcome
from grasp3d.system.documents import described
from grasp3d.system.files import atomic_write

ISAAC, ISAAC_VERSION = "isaac_grasp", 1.0
MOVEIT = "moveit_msgs/Grasp"

DESIRED, LEAST = 0.10, 0.02
"""Desired and smallest length of approach and retreat [m]."""

NO_FORCE_LIMIT = 0.0
"""`max_contact_force` where the gripper states no greatest force: MoveIt then applies none."""


def write_isaac(path: Path, poses: GraspPoses, **further: object) -> None:
    """Write grasps by name, the gripper's frame relative to the object, and further keys."""
    hand: Any = poses.hand
    twice = [name for name, count in Counter(poses.names).items() if count > 1]
    if twice:
        raise OutputError(f"two grasps are called {twice[0]!r}: give each a name of its own")
    document = {
        "format": ISAAC,
        "format_version": ISAAC_VERSION,
        **further,
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


DATAGEN, MULTIGRIPPER = "GraspDataGen", "MultiGripperGrasp"

SIMULATED, GUESSED = "grasp_sim", "grasp_guess"
"""Programs of GraspDataGen: of grasps that were tried, and of those that were not."""


def is_datagen(content: object) -> bool:
    """Whether the content of a YAML file is in this format."""
    return isinstance(content, dict) and content.get("created_with") in (SIMULATED, GUESSED)


def write_datagen(path: Path, poses: GraspPoses) -> None:
    """Write isaac_grasp whose confidences are the outcomes, which all grasps must have."""
    tried = replace(poses, scores=known_outcomes(poses, DATAGEN))
    write_isaac(path, tried, created_with=SIMULATED)


def parse_datagen(content: object, given: Given) -> GraspPoses:
    """Grasps in the order of the file. Raises ContactError."""
    document = mapping(content, "the file")
    if document.get("created_with") == GUESSED:  # the confidence is that nothing is in the way
        return parse_isaac(document, given)
    outcome = given.outcome or Outcome("confidence")
    found = parse_isaac(document, replace(given, outcome=outcome))
    return replace(found, scores=np.full(found.count, math.nan))


CONFIG, RESULT = "grasp_poses", "grasp_result"
"""Keys of Replicator's files: of a configuration, and of a grasp that was tried."""

WORLD = "world"
"""Name of the frame of a grasp that was tried."""

DIRECTIONS = ("gripper_approach_direction", "grasp_align_axis")
"""Keys of a configuration that state the axes of the gripper's frame."""

STANDOFF = "gripper_standoff_fingertips"
"""Key of a configuration that says how far new grasps are from the object, for any gripper."""

ALMOST = 1e-3
"""Largest error of directions that stand for axes."""


def is_replicator(content: object) -> bool:
    """Whether the content of a YAML file is in this format."""
    return isinstance(content, dict) and not content.keys().isdisjoint({CONFIG, RESULT})


def write_replicator(path: Path, poses: GraspPoses) -> None:
    """Write a configuration of the poses, with their frame if its origin is not the hand's."""
    hand: Any = poses.hand
    turned = quaternions(poses.poses).tolist()
    tcp = poses.gripper_frame.to_tcp(hand)
    axes = (np.round(tcp[:3, k], 12) + 0.0 for k in (2, 0))
    standoff = poses.gripper_frame.distance(hand)
    of_base = math.isclose(standoff, hand.base_to_tcp, abs_tol=1e-9)
    document = {
        **({} if of_base else {FIELD: str(poses.gripper_frame)}),
        CONFIG: [
            {"position": position, "orientation": {"w": w, "xyz": xyz}}
            for position, (*xyz, w) in zip(poses.poses[:, :3, 3].tolist(), turned, strict=True)
        ],
        "sampler_config": {
            "gripper_maximum_aperture": hand.max_opening,
            **{name: axis.tolist() for name, axis in zip(DIRECTIONS, axes, strict=True)},
            STANDOFF: standoff,
        },
    }
    write_yaml(path, document)


def parse_replicator(content: object, given: Given) -> GraspPoses:
    """Poses of a configuration, or of one grasp that was tried. Raises ContactError.

    Their origin is the hand's base, unless this project's writer states another one.
    """
    document = mapping(content, "the file")
    if is_result := RESULT in document:
        result = mapping(document[RESULT], RESULT)
        names = ("position", "gripper_location"), ("orientation", "gripper_orientation")
        entries = [{name: required(result, key, f"{RESULT}: ") for name, key in names}]
    else:
        entries = entries_of(grasp_list(required(document, CONFIG), CONFIG))
    sampler = mapping(document.get("sampler_config") or {}, "sampler_config")
    frame = text_or_none(document.get(FIELD), FIELD)
    return GraspPoses(
        poses=poses_of_entries(entries),
        outcome=outcomes_of_entries(given.outcome, entries),
        gripper_frame=_with_axes(sampler) if sampler.keys() >= {*DIRECTIONS} else FRAMES["hand"],
        settings=({"frame_id": WORLD} if is_result else {}) | ({FIELD: frame} if frame else {}),
    )


def _with_axes(sampler: dict[str, Any]) -> GripperFrame:
    """The frame of the hand's base with the axes that a configuration states. Raises ContactError.

    The standoff does not say where the TCP is: it is 0.17 m for any gripper until it is changed.
    """
    directions = numbers([sampler[key] for key in DIRECTIONS], (3,), "sampler_config: a direction")
    approach, closing = directions
    along = next((n for n, axis in AXES.items() if np.abs(approach - axis).max() < ALMOST), None)
    if along is None:
        raise ContactError(
            f"{DIRECTIONS[0]} must be an axis, such as [0, 0, 1]; got {approach.tolist()}"
        )
    if not (abs(np.linalg.norm(closing) - 1.0) < ALMOST and abs(closing @ approach) < ALMOST):
        raise ContactError(
            f"{DIRECTIONS[1]} must be a unit vector at a right angle to {DIRECTIONS[0]}; got "
            f"{closing.tolist()}"
        )
    # The axis that it is next to, and how far it is turned from that.
    nearest = max(AXES, key=lambda name: float(np.array(AXES[name]) @ closing))
    side = np.cross(approach, AXES[nearest])
    turn = math.atan2(side @ closing, np.array(AXES[nearest]) @ closing)
    turn = turn if abs(turn) > ALMOST else 0.0
    return GripperFrame(approach=along, closing=nearest, origin="base", turn=turn)


def write_multigripper(path: Path, poses: GraspPoses) -> None:
    """Write lists of poses, values of the joints, and outcomes if any is known."""
    hand: Any = poses.hand
    opened, closed = poses.pregrasp_opening, poses.opening
    opened = np.where(np.isnan(opened), hand.max_opening, opened)
    wxyz = np.roll(quaternions(poses.poses), 1, axis=1)
    document: dict[str, Any] = {
        "gripper": hand.name,
        "object_id": str(poses.settings.get("object_id", "object")),
        "pose": np.hstack([poses.poses[:, :3, 3], wxyz]).tolist(),
        "dofs": joint_values(hand, opened, MULTIGRIPPER).tolist(),
    }
    if np.isfinite(closed).all():
        document["final_dofs"] = joint_values(hand, closed, MULTIGRIPPER).tolist()
    if np.isfinite(poses.outcome).any():
        document["result"] = json_numbers(poses.outcome)
    write_json(path, document)


def parse_multigripper(content: object, given: Given) -> GraspPoses:
    """Poses of the content of a JSON file, in its order. Raises ContactError."""
    document = mapping(content, "the file")
    rows = numbers(grasp_list(required(document, "pose"), "pose"), (7,), "pose")
    hand = given.hand
    count = len(rows)
    of_object = text_or_none(document.get("object_id"), "object_id")
    stated = [key for key, value in document.items() if isinstance(value, list) and key != "pose"]
    lasted = document.get("test_duration")
    outcome = given.outcome
    if outcome is None and "result" not in stated and "fall_time" in stated and lasted is not None:
        seconds = one_number(lasted, "test_duration")
        outcome = Outcome("fall_time", ">=", str(seconds))
    return GraspPoses(
        poses=from_quaternions(rows[:, :3], np.roll(rows[:, 3:], -1, axis=1)),
        opening=_openings(hand, document, "final_dofs", count),
        pregrasp_opening=_openings(hand, document, "dofs", count),
        outcome=outcomes_of(
            outcome,
            count,
            stated,
            lambda key: as_many(document[key], key, count),
            default=("result",),
        ),
        columns={
            key: numbers(as_many(document[key], key, count), (), key)
            for key in ("fall_time", "slip_time")
            if key in stated
        },
        settings={} if of_object is None else {"object_id": of_object},
    )


def _openings(hand: ParallelGripper, document: dict[str, Any], key: str, count: int) -> Floats:
    """Openings [m] of joint values without names; nan unless they are as many as the gripper's."""
    rows, joints = document.get(key) or [None], hand.joint_names
    first = rows[0] if isinstance(rows, list) else None
    if not isinstance(first, list) or not joints or len(first) != len(joints):
        return np.full(count, math.nan)
    if len(rows) != count:
        raise ContactError(f"{key} must have {count} values, one of each grasp")
    values = numbers(rows, (len(joints),), key).tolist()
    return openings_of_joints(hand, [dict(zip(joints, row, strict=True)) for row in values])


def write_robotwin(path: Path, poses: GraspPoses) -> None:
    """Write poses in the numbers of the mesh, and its scale."""
    scale = poses.object_scale
    assert scale is not None
    document = {
        "scale": [scale] * 3,
        "contact_points_pose": poses.scaled(1.0 / scale, None).poses.tolist(),
    }
    write_json(path, document)


def parse_robotwin(content: object, given: Given) -> GraspPoses:
    """Poses of the content of a JSON file, in its order. Raises ContactError."""
    document = mapping(content, "the file")
    listed = grasp_list(required(document, "contact_points_pose"), "contact_points_pose")
    poses = numbers(listed, (4, 4), "contact_points_pose")
    scale = document.get("scale", 1.0)
    scales = numbers([scale if isinstance(scale, list) else [scale] * 3], (3,), "scale")[0]
    if not (np.isfinite(scales) & (scales > 0.0)).all():
        raise ContactError(f"scale must be numbers above 0; got {scales.tolist()}")
    poses[:, :3, 3] *= scales
    return GraspPoses(
        poses=poses,
        outcome=outcomes_of(given.outcome, len(poses), (), lambda _: ()),
        object_scale=float(scales[0]) if np.ptp(scales) == 0.0 else None,
    )
