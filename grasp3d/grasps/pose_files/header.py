"""What files in the project's own formats state of all their grasps."""

from collections.abc import Mapping
from typing import Any, get_args

from grasp3d.errors import ContactError, SettingError
from grasp3d.grasps.pose_files.documents import kind, one_number, text_or_none
from grasp3d.grasps.poses import GraspPoses
from grasp3d.hand.hand import Hand
from grasp3d.hand.hand_files import hand_of
from grasp3d.settings.lengths import Unit
from grasp3d.system.versions import package_version

FRAME = (
    "pose: gripper frame to the object's frame; origin at the tool centre point between the "
    "fingertips, z approach direction, x closing axis from finger 1 to finger 2"
)
NORMALS = "outward"
ANGLES = "radians"

STATED = frozenset({
    "version", "content", "frame", "normals", "angles", "unit", "gripper", "object_file",
    "object_scale",
})  # fmt: skip
"""Keys that are no settings."""


def header_of(poses: GraspPoses) -> dict[str, Any]:
    """Version, unit, frame, direction of the normals, gripper, object, settings."""
    hand = poses.hand
    return {
        "version": package_version(),
        "content": "poses",
        "unit": poses.unit or "unknown",
        "frame": FRAME,
        "normals": NORMALS,
        "angles": ANGLES,
        "gripper": hand if hand is None or isinstance(hand, str) else hand.description(),
        "object_file": poses.object_file,
        "object_scale": poses.object_scale,
        **{name: value for name, value in poses.settings.items() if name not in STATED},
    }


def fields_of(
    header: Mapping[str, Any], hand: Hand | str | None, unit: Unit | None
) -> dict[str, Any]:
    """Fields of `GraspPoses` that a header states.

    Args:
        header: What `header_of` returned.
        hand: Replaces that of the file; None: as in the file.
        unit: Unit of a file that does not state it.

    Raises:
        ContactError: Invalid values, or another unit.
    """
    scale = header.get("object_scale")
    return {
        "unit": stated_unit(header.get("unit"), unit),
        "hand": hand or _gripper(header.get("gripper")),
        "object_file": text_or_none(header.get("object_file"), "object_file"),
        "object_scale": None if scale is None else one_number(scale, "object_scale"),
        "settings": {name: value for name, value in header.items() if name not in STATED},
    }


def stated_unit(stated: object, given: Unit | None) -> Unit | None:
    """The unit that a file states, or that is given for it.

    Raises:
        ContactError: It is no unit, or both are there and differ.
    """
    if stated in (None, "", "unknown"):
        return given
    known: dict[object, Unit] = {unit: unit for unit in get_args(Unit)}
    unit = known.get(stated) if isinstance(stated, str) else None
    if unit is None:
        raise ContactError(
            f"the unit must be one of {', '.join(known.values())}; got {kind(stated)}"
        )
    if given not in {None, unit}:
        raise ContactError(f"it states the unit {unit}, not {given}: read it without a unit")
    return unit


def _gripper(value: object) -> Hand | str | None:
    if value is None or isinstance(value, str):
        return value
    try:
        return hand_of(value)
    except SettingError as error:
        raise ContactError(f"its gripper {error}") from error
