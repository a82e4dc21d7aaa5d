"""Poses of simulators: GraspDataGen and Replicator in YAML, MultiGripperGrasp and RoboTwin in JSON.

GraspDataGen writes isaac_grasp with further keys. Replicator's files are the configurations of the
extension isaacsim.replicator.grasping, and what it writes of each grasp that it has tried.
"""

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from grasp3d.arrays import Floats
from grasp3d.errors import ContactError
from grasp3d.grasps.pose_files.documents import (
    as_many,
    entries_of,
    grasp_list,
    json_numbers,
    json_text,
    mapping,
    numbers,
    one_number,
    required,
    text_or_none,
    write_yaml,
)
from grasp3d.grasps.pose_files.frames import (
    FIELD,
    Given,
    for_robots,
    from_quaternions,
    joint_values,
    known_outcomes,
    quaternions,
)
from grasp3d.grasps.pose_files.outcomes import outcomes_of, outcomes_of_entries
from grasp3d.grasps.pose_files.robots import (
    openings_of_joints,
    parse_isaac,
    poses_of_entries,
    write_isaac,
)
from grasp3d.grasps.poses import GraspPoses
from grasp3d.hand.frames import FRAMES, GripperFrame
from grasp3d.hand.jaws import AXES
from grasp3d.hand.parallel_gripper import ParallelGripper
from grasp3d.settings.outcome import Outcome
from grasp3d.system.files import atomic_write

DATAGEN, REPLICATOR = "GraspDataGen", "Replicator"
MULTIGRIPPER, ROBOTWIN = "MultiGripperGrasp", "RoboTwin"

SIMULATED, GUESSED = "grasp_sim", "grasp_guess"
"""Programs of GraspDataGen: of grasps that were tried, and of those that were not."""


def is_datagen(content: object) -> bool:
    """Whether the content of a YAML file is in this format."""
    return isinstance(content, dict) and content.get("created_with") in (SIMULATED, GUESSED)


def write_datagen(path: Path, poses: GraspPoses) -> None:
    """Write isaac_grasp whose confidences are the outcomes, which all grasps must have."""
    for_robots(poses, DATAGEN)  # what a gripper lacks is said first
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
    hand, in_metres = for_robots(poses, REPLICATOR)
    turned = quaternions(in_metres.poses).tolist()
    tcp = in_metres.gripper_frame.to_tcp(hand)
    axes = (np.round(tcp[:3, k], 12) + 0.0 for k in (2, 0))
    standoff = in_metres.gripper_frame.distance(hand)
    of_base = math.isclose(standoff, hand.base_to_tcp, abs_tol=1e-9)
    document = {
        **({} if of_base else {FIELD: str(in_metres.gripper_frame)}),
        CONFIG: [
            {"position": position, "orientation": {"w": w, "xyz": xyz}}
            for position, (*xyz, w) in zip(in_metres.poses[:, :3, 3].tolist(), turned, strict=True)
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
    hand = given.gripper(REPLICATOR)
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
        unit="m",
        hand=hand,
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


def is_multigripper(content: object) -> bool:
    """Whether the content of a JSON file is in this format."""
    return isinstance(content, dict) and content.keys() >= {"gripper", "pose"}


def write_multigripper(path: Path, poses: GraspPoses) -> None:
    """Write lists of poses, values of the joints, and outcomes if any is known."""
    hand, in_metres = for_robots(poses, MULTIGRIPPER)
    opened, closed = in_metres.pregrasp_opening, in_metres.opening
    opened = np.where(np.isnan(opened), hand.max_opening, opened)
    wxyz = np.roll(quaternions(in_metres.poses), 1, axis=1)
    document: dict[str, Any] = {
        "gripper": hand.name,
        "object_id": str(in_metres.settings.get("object_id", "object")),
        "pose": np.hstack([in_metres.poses[:, :3, 3], wxyz]).tolist(),
        "dofs": joint_values(hand, opened, MULTIGRIPPER).tolist(),
    }
    if np.isfinite(closed).all():
        document["final_dofs"] = joint_values(hand, closed, MULTIGRIPPER).tolist()
    if np.isfinite(in_metres.outcome).any():
        document["result"] = json_numbers(in_metres.outcome)
    with atomic_write(path) as part:
        part.write_text(json_text(document), encoding="utf-8")


def parse_multigripper(content: object, given: Given) -> GraspPoses:
    """Poses of the content of a JSON file, in its order. Raises ContactError."""
    document = mapping(content, "the file")
    rows = numbers(grasp_list(required(document, "pose"), "pose"), (7,), "pose")
    hand = given.gripper(MULTIGRIPPER)
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
        unit="m",
        hand=hand,
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


def is_robotwin(content: object) -> bool:
    """Whether the content of a JSON file is in this format."""
    return isinstance(content, dict) and "contact_points_pose" in content


def write_robotwin(path: Path, poses: GraspPoses) -> None:
    """Write poses in the numbers of the mesh, and its scale."""
    _, in_metres = for_robots(poses, ROBOTWIN)
    scale = in_metres.object_scale
    assert scale is not None
    document = {
        "scale": [scale] * 3,
        "contact_points_pose": in_metres.scaled(1.0 / scale, None).poses.tolist(),
    }
    with atomic_write(path) as part:
        part.write_text(json_text(document), encoding="utf-8")


def parse_robotwin(content: object, given: Given) -> GraspPoses:
    """Poses of the content of a JSON file, in its order. Raises ContactError."""
    document = mapping(content, "the file")
    given.check_metres(ROBOTWIN)
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
        unit="m",
        hand=given.hand,
        object_scale=float(scales[0]) if np.ptp(scales) == 0.0 else None,
    )
