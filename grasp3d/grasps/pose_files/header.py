"""What files in the project's own formats state of all their grasps."""

from collections.abc import Iterable, Mapping
from typing import Any, get_args

from grasp3d.errors import ContactError, SettingError
from grasp3d.grasps.pose_files.documents import number_or_none, text_or_none
from grasp3d.grasps.pose_files.frames import Given
from grasp3d.grasps.poses import GraspPoses
from grasp3d.hand.frames import FRAMES, GripperFrame
from grasp3d.hand.hand import Hand
from grasp3d.hand.hand_files import hand_of
from grasp3d.hand.object_pose import ObjectPose
from grasp3d.settings.lengths import Unit
from grasp3d.system.documents import described
from grasp3d.system.versions import package_version

FRAME = (
    "pose: gripper frame to the object's frame; origin at the tool centre point between the "
    "fingertips, z approach direction, x closing axis from finger 1 to finger 2"
)
OTHER_FRAME = "pose: the gripper's frame that gripper_frame states to the object's frame"
"""The same where the gripper's frame is not that of the TCP."""

OBJECT_FRAMES = ("", "object", FRAME, OTHER_FRAME)
"""Frames of files that are those of the object."""

ROBOT_FRAMES = {
    frame: frame.replace(
        "the object's frame", "the frame of a robot, in which the object has the pose object_pose"
    )
    for frame in (FRAME, OTHER_FRAME)
}

NORMALS = "outward"
ANGLES = "radians"

FIELD = "gripper_frame"
"""Key of the gripper's frame, also in the settings of poses where it is not known."""

STATED = frozenset({
    "version", "content", "frame", "normals", "angles", "unit", "gripper", "object_file",
    "object_scale", "object_pose", FIELD,
})  # fmt: skip
"""Keys that are no settings."""


def header_of(poses: GraspPoses) -> dict[str, Any]:
    """Version, unit, frame, direction of the normals, gripper, object, settings."""
    hand = poses.hand
    frame = FRAME if poses.gripper_frame == FRAMES["tcp"] else OTHER_FRAME
    return {
        "version": package_version(),
        "content": "poses",
        "unit": poses.unit or "unknown",
        "frame": frame if poses.object_pose is None else ROBOT_FRAMES[frame],
        FIELD: str(poses.gripper_frame),
        "normals": NORMALS,
        "angles": ANGLES,
        "gripper": hand if hand is None or isinstance(hand, str) else hand.description(),
        "object_file": poses.object_file,
        "object_scale": poses.object_scale,
        "object_pose": poses.object_pose and str(poses.object_pose),
        **{name: value for name, value in poses.settings.items() if name not in STATED},
    }


def fields_of(header: Mapping[str, Any], given: Given) -> dict[str, Any]:
    """Fields of `GraspPoses` that a header states.

    Args:
        header: What `header_of` returned.
        given: A gripper, which replaces that of the file, and the unit if this states none.

    Raises:
        ContactError: Invalid values, or another unit.
    """
    stated = text_or_none(header.get("object_pose"), "object_pose")
    for name, value in (("normals", NORMALS), ("angles", ANGLES)):
        if header.get(name, value) != value:
            raise ContactError(f"{name} must be {value}; got {described(header[name])}")
    frame = text_or_none(header.get("frame"), "frame") or ""
    known = (*OBJECT_FRAMES, *ROBOT_FRAMES.values()) if stated else OBJECT_FRAMES
    other = {} if frame in known else {"frame": frame}
    try:
        gripper_frame = GripperFrame.of(text_or_none(header.get(FIELD), FIELD) or "tcp")
    except SettingError:  # of another program: an error unless one is given, see `read_poses`
        gripper_frame, other[FIELD] = FRAMES["tcp"], header[FIELD]
    return {
        "unit": stated_unit(header.get("unit"), given.unit),
        "hand": given.hand or _gripper(header.get("gripper")),
        "object_file": text_or_none(header.get("object_file"), "object_file"),
        "object_scale": number_or_none(header.get("object_scale"), "object_scale"),
        "object_pose": ObjectPose.of(stated) if stated else None,
        FIELD: gripper_frame,
        "settings": other | {name: value for name, value in header.items() if name not in STATED},
    }


def check_object_frame(frames: Iterable[object]) -> None:
    """Refuse contacts that are in another frame than that of the object. Raises ContactError."""
    others = [str(frame) for frame in frames if frame not in (None, *OBJECT_FRAMES)]
    if others:
        raise ContactError(f"its contacts are in the frame {others[0]!r}; known: 'object'")


def stated_unit(stated: object, default: Unit | None) -> Unit | None:
    """The unit that a file states, or that is given for it.

    Raises:
        ContactError: It is no unit, or both are there and differ.
    """
    if stated in (None, "", "unknown"):
        return default
    units: dict[object, Unit] = {unit: unit for unit in get_args(Unit)}
    unit = units.get(stated) if isinstance(stated, str) else None
    if unit is None:
        raise ContactError(
            f"the unit must be one of {', '.join(units.values())}; got {described(stated)}"
        )
    if default not in {None, unit}:
        raise ContactError(f"it states the unit {unit}, not {default}: read it without a unit")
    return unit


def _gripper(value: object) -> Hand | str | None:
    if value is None or isinstance(value, str):
        return value
    try:
        return hand_of(value)
    except SettingError as error:
        raise ContactError(f"its gripper {error}") from error
