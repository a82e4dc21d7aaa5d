"""What the project's own formats, JSON, CSV and Parquet, state of all grasps and of each."""

from collections.abc import Iterable, Mapping
from typing import Any, get_args

import numpy as np
import numpy.typing as npt

from grasp3d.arrays import Floats
from grasp3d.errors import ContactError, OutputError, SettingError
from grasp3d.formats import checks
from grasp3d.formats.format import Given
from grasp3d.formats.outcomes import Values, outcomes_of
from grasp3d.formats.poses import STAGES, VECTOR_COLUMNS, GraspPoses
from grasp3d.hand.frames import GripperFrame
from grasp3d.hand.hand import Hand
from grasp3d.hand.hand_files import hand_of
from grasp3d.hand.object_pose import ObjectPose
from grasp3d.hand.robot_files import FORMAT as ARTICULATED
from grasp3d.settings.units import Unit
from grasp3d.system.documents import described
from grasp3d.system.versions import package_version

OBJECT = (None, "", "object")
"""Frames of poses that are that of the object."""

CONVENTIONS = {"normals": "outward", "angles": "radians"}

CONTENT = (
    "poses of the gripper: z approach direction, x closing axis from finger 1 to finger 2, origin "
    "at the tool centre point between the fingertips, unless gripper_frame states another frame"
)

OF_ALL = ("unit", "object_pose", "frame", "gripper_frame")
"""Columns that state the same in every row."""

NUMBERS = ("opening", "pregrasp_opening", "score")
"""Columns of one number for each pose, but outcomes."""


def header_of(poses: GraspPoses) -> dict[str, Any]:
    """Version, unit, frames, direction of the normals, gripper, object, settings."""
    hand, at = poses.hand, poses.object_pose
    stated = {
        "version": package_version(),
        "content": CONTENT,
        "unit": poses.unit or "unknown",
        "frame": "object" if at is None else at.frame,
        "gripper_frame": str(poses.gripper_frame),
        **CONVENTIONS,
        "gripper": hand if hand is None or isinstance(hand, str) else hand.description(),
        "object_file": poses.object_file,
        "object_scale": poses.object_scale,
        "object_pose": at and str(at),
    }
    return {**poses.settings, **stated}


STATED = frozenset({
    "version", "content", "gripper", "object_file", "object_scale", *OF_ALL, *CONVENTIONS
})  # fmt: skip
"""Keys that are no settings."""


def fields_of(header: Mapping[str, Any], given: Given) -> dict[str, Any]:
    """Fields of `GraspPoses` that a header states.

    Args:
        header: What `header_of` returned, or a part of it.
        given: A gripper, which replaces that of the file, and the unit if this states none.

    Raises:
        ContactError: Invalid values, or another unit.
    """
    at, frame, of_gripper, file = (
        checks.text_or_none(header.get(name), name)
        for name in ("object_pose", "frame", "gripper_frame", "object_file")
    )
    for name, value in CONVENTIONS.items():
        if header.get(name, value) != value:
            raise ContactError(f"{name} must be {value}; got {described(header[name])}")
    other = {} if at or frame in OBJECT else {"frame": frame}
    return {
        "unit": stated_unit(header.get("unit"), given.unit),
        "hand": given.hand or _gripper(header.get("gripper")),
        "object_file": file,
        "object_scale": checks.number_or_none(header.get("object_scale"), "object_scale"),
        "object_pose": ObjectPose.of(at) if at else None,
        "gripper_frame": GripperFrame.of(of_gripper or "tcp"),
        "assumes_frame": not of_gripper,
        "settings": other | {name: value for name, value in header.items() if name not in STATED},
    }


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
        if isinstance(value, dict) and value.get("format") == ARTICULATED:
            return str(value.get("name", "a hand with joints"))  # its model is another file
        raise ContactError(f"its gripper {error}") from error


def stated_in(columns: Mapping[str, Iterable[Any]]) -> dict[str, str]:
    """What all rows of a file state, as its header may. Raises ContactError."""
    stated: dict[str, str] = {}
    for name in filter(columns.__contains__, OF_ALL):
        stated[name], *others = {"" if value is None else str(value) for value in columns[name]}
        if others:
            raise ContactError(f"all grasps must have the same {name}")
    return stated


def columns_of(poses: GraspPoses, **placed: Any) -> dict[str, Any]:
    """The columns of every file, with poses and postures as this one has them."""
    return {
        "name": np.array(poses.names),
        **placed,
        "opening": poses.opening,
        "pregrasp_opening": poses.pregrasp_opening,
        "score": poses.scores,
        "outcome": poses.outcome,
    }


def joint_names(poses: GraspPoses) -> tuple[str, ...]:
    """Names of the joints of postures, else of those of the hand. Raises OutputError."""
    names = poses.joint_names or getattr(poses.hand, "joint_names", ())
    if poses.posture.shape[1] not in {0, len(names)}:
        raise OutputError("the joints of the postures have no names: give the hand")
    return names


def stages_of(poses: GraspPoses) -> dict[str, Floats]:
    """Postures, and postures and poses before and after the grasp, as far as they are known."""
    found = {"posture": poses.posture}
    for stage in STAGES:
        found[f"{stage}_posture"] = getattr(poses, f"{stage}_posture")
        if (moved := getattr(poses, f"{stage}_poses")) is not None:
            found[f"{stage}_pose"] = moved
    return {name: values for name, values in found.items() if values.size}


def vectors_of(poses: GraspPoses) -> dict[str, Floats]:
    """Contacts and outward normals, as far as they are known, shape (k, n, 3)."""
    signs = {"contacts": 1.0, "normals": -1.0}
    known = {name: poses.columns[name] for name in VECTOR_COLUMNS if name in poses.columns}
    return {name: 0.0 + signs[name] * values for name, values in known.items()}


def poses_of(table: Mapping[str, Values], given: Given, **fields: Any) -> GraspPoses:
    """Poses with the numbers that files of every kind have in columns of the same names."""
    rows = len(fields["poses"])
    opening, pregrasp_opening, scores = (
        numbers_of(table[name], name) if name in table else np.nan for name in NUMBERS
    )
    return GraspPoses(
        opening=np.asarray(opening),
        pregrasp_opening=np.asarray(pregrasp_opening),
        scores=np.asarray(scores),
        outcome=outcomes_of(given.outcome, rows, table, table.__getitem__),
        **fields,
    )


def numbers_of(values: Values, name: str) -> Floats:
    """Numbers of a column, shape (k,). Raises ContactError."""
    if isinstance(values, np.ndarray) and values.dtype.kind in "fiub":
        return values.astype(np.float64)
    return checks.numbers(list(values), (), name)


def column_of(values: Values, name: str) -> npt.NDArray[Any]:
    """Text if there is any text, otherwise numbers. Raises ContactError."""
    if isinstance(values, np.ndarray) and values.dtype.kind in "fiub":
        return values
    if all(isinstance(value, int | float | None) for value in values):
        return checks.numbers(list(values), (), name)
    if wrong := [value for value in values if isinstance(value, list | dict)]:
        raise ContactError(
            f"{name} must be numbers or text in all grasps; got {described(wrong[0])}"
        )
    column = np.array(["" if value is None else str(value) for value in values])
    column.flags.writeable = False  # so that poses need no copy of it
    return column
