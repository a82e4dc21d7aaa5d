"""Frames of robots' files: the gripper's frame in metres, quaternions, joints."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeVar, get_args

import numpy as np
from scipy.spatial.transform import Rotation

from grasp3d.arrays import ArrayLike, Floats
from grasp3d.errors import ContactError, FileUnreadError, GraspError, OutputError, SettingError
from grasp3d.grasps.pose_files.documents import (
    check_file,
    load_array,
    load_yaml,
    mapping,
    number_or_none,
    one_number,
    required,
    text_or_none,
)
from grasp3d.grasps.poses import GraspPoses
from grasp3d.grasps.postures import matched
from grasp3d.hand.articulated.articulated_hand import ArticulatedHand
from grasp3d.hand.articulated.presets import FORMAT as ARTICULATED
from grasp3d.hand.frames import FRAMES, GripperFrame
from grasp3d.hand.hand import Hand
from grasp3d.hand.hand_files import hand_of
from grasp3d.hand.object_pose import ObjectPose
from grasp3d.hand.parallel_gripper import ParallelGripper
from grasp3d.hand.pose_checks import checked_quaternions
from grasp3d.settings.units import METRES, Unit
from grasp3d.system.documents import described, file_bytes, load_json
from grasp3d.system.limited_reading import read_file
from grasp3d.system.names import printable
from grasp3d.system.versions import package_version

ResultT = TypeVar("ResultT")


def in_file_metres(poses: GraspPoses, what: str) -> GraspPoses:
    """Poses of the frame of a file in metres, with the scale of the object's file.

    Raises:
        OutputError: There is no hand that the format has, values of its joints are missing, or the
            unit of the poses is not known.
    """
    if missing := missing_of_hand(poses.hand, what):
        raise OutputError(missing)
    if isinstance(poses.hand, ArticulatedHand):
        try:
            poses = matched(poses, poses.hand)
        except ContactError as error:
            raise OutputError(str(error)) from error
    if poses.unit is None:
        raise OutputError(
            f"{what} files are in metres, but the unit of the poses is not known: give the mesh's "
            "unit (--unit, in Python unit=...)"
        )
    scale = poses.object_scale or METRES[poses.unit]
    return replace(as_in_file(poses.in_unit("m")), object_scale=scale)


def known_outcomes(poses: GraspPoses, what: str) -> Floats:
    """The outcomes of poses to write. Raises OutputError unless all are known."""
    unknown = np.flatnonzero(np.isnan(poses.outcome))
    if len(unknown):
        raise OutputError(
            f"{what} files state whether each grasp held; the outcome of grasp {unknown[0] + 1} is "
            "not known"
        )
    return poses.outcome


class UnknownUnitError(ContactError):
    """Poses need a unit, and their file states none."""


def as_in_file(poses: GraspPoses) -> GraspPoses:
    """Poses of the TCP as those of `gripper_frame`, in which files have them."""
    return _moved(poses, to_file=True)


def of_tcp(poses: GraspPoses) -> GraspPoses:
    """Poses of `gripper_frame`, as a file has them, as those of the TCP.

    Raises:
        ContactError: The distance between the two is known, but not the unit of the poses.
        SettingError: The frame depends on a gripper, and there is none.
    """
    return _moved(poses, to_file=False)


def _moved(poses: GraspPoses, *, to_file: bool) -> GraspPoses:
    if poses.gripper_frame == FRAMES["tcp"]:
        return poses
    hand = poses.hand if isinstance(poses.hand, Hand) else None
    motion = poses.gripper_frame.to_tcp(hand)
    if motion[:3, 3].any():
        if poses.unit is None:
            raise UnknownUnitError(
                f"its poses are in the gripper frame '{poses.gripper_frame}', whose distance from "
                "the TCP is in metres, but their unit is not known: give it (a column unit, in "
                "Python unit=...)"
            )
        motion[:3, 3] /= METRES[poses.unit]
    change = np.asarray(np.linalg.inv(motion)) if to_file else motion
    return poses.changed(lambda moved: moved @ change)


@dataclass(frozen=True)
class Given:
    """What is given beside a file to read."""

    hand: Any = None
    """The hand that the grasps are of, of a kind that the format has; None: not given."""
    unit: Unit | None = None
    """Unit of the lengths, if the file states none."""
    outcome: str | None = None
    """Name of the values that say whether a grasp held; None: those of the format."""
    object_scale: float | None = None
    """Scale of the object whose grasps are read, of files of several."""

    def check(self, what: str, *, states_hand: bool) -> None:
        """Refuse another unit or hand than the files of a format have, in metres.

        Args:
            what: The format.
            states_hand: Whether its files say what a hand is needed for.

        Raises:
            ContactError: They do not fit.
        """
        if self.unit not in {None, "m"}:
            raise ContactError(
                f"{what} files are in metres, not in {self.unit}: read them without a unit, and "
                "convert the poses with in_unit"
            )
        missing = missing_of_hand(self.hand, what)
        if missing and not (states_hand and self.hand is None):
            raise ContactError(missing)


JOINTED = ("dexgraspbench", "dexgraspnet")
"""Formats of hands with joints only."""


def missing_of_hand(hand: Hand | str | None, what: str, *, joints: bool = False) -> str:
    """What a hand lacks for files with the pose of its base, a sentence; empty: nothing.

    Args:
        hand: The hand of the poses.
        what: The format.
        joints: Whether its files state values of joints.
    """
    if what.lower() in JOINTED:
        wrong = (
            "" if hand is None else f" {hand if isinstance(hand, str) else hand.name!r} is none:"
        )
        return (
            ""
            if isinstance(hand, ArticulatedHand)
            else f"{what} files have postures of a hand with joints;{wrong} give its description "
            "(--hand, in Python hand=...)"
        )
    if isinstance(hand, ArticulatedHand) and what == "isaac_grasp":
        return ""
    if not isinstance(hand, ParallelGripper):
        return (
            f"{what} files have the pose of the hand's base, not of the fingertips, and so need "
            "the lengths of the gripper: give it (--hand, in Python hand=...)"
        )
    if joints and not hand.joint_names:
        return (
            f"{what} files have joint values, but gripper {hand.name!r} has no joint_names: "
            "give it joint_names, joint_scale and joint_closed, or choose another format"
        )
    return ""


def quaternions(poses: Floats) -> Floats:
    """Quaternions x y z w of poses (k, 4, 4), w at least 0, shape (k, 4)."""
    values = Rotation.from_matrix(poses[:, :3, :3]).as_quat(canonical=True)
    return np.asarray(values, dtype=np.float64).reshape(-1, 4)


def from_quaternions(positions: Floats, xyzw: Floats, where: str = "") -> Floats:
    """Poses (k, 4, 4) of positions (k, 3) and quaternions (k, 4). Raises ContactError."""
    for what, values in (("position", positions), ("quaternion", xyzw)):
        bad = np.flatnonzero(~np.isfinite(values).all(axis=1))
        if len(bad):
            raise ContactError(f"{where}grasp {bad[0] + 1}: its {what} is not finite")
    poses = np.tile(np.eye(4), (len(positions), 1, 1))
    poses[:, :3, :3] = Rotation.from_quat(checked_quaternions(xyzw, where)).as_matrix()
    poses[:, :3, 3] = positions
    return poses


STEPS, NUDGE = 10, 1e-13
"""Steps after which a pose that is still not read as it is written is turned by a little [rad]."""


def as_read_again(poses: Floats) -> Floats:
    """Poses (k, 4, 4) that files of quaternions give back bit for bit; nearly the given ones."""
    nudged = Rotation.from_rotvec([NUDGE, 0.0, 0.0]).as_matrix()
    for step in range(1, 10 * STEPS):
        again = from_quaternions(poses[:, :3, 3], quaternions(poses))
        changed = (again != poses).any(axis=(1, 2))
        if not changed.any():
            break
        poses = again
        if step % STEPS == 0:
            poses[changed, :3, :3] = poses[changed, :3, :3] @ nudged
    return poses


def joint_values(hand: ParallelGripper, openings: Floats, what: str) -> Floats:
    """Values of the finger joints at openings [m] of (k,), shape (k, joints); nan: not known.

    Raises:
        OutputError: Openings are known, but the gripper has no joints.
    """
    if not hand.joint_names and np.isfinite(openings).any():
        raise OutputError(missing_of_hand(hand, what, joints=True))
    closed, scale = np.array(hand.joint_closed), np.array(hand.joint_scale)
    return np.asarray(closed + scale * openings[:, None])


GivenPose = ObjectPose | Path | ArrayLike
"""What `read_object_pose` takes."""

GivenFrame = GripperFrame | Path | ArrayLike
"""What `read_frame` takes."""


def read_object_pose(source: GivenPose) -> ObjectPose:
    r"""The pose of an object in the frame of a robot, of a text, a matrix or a file.

    Args:
        source: A text or a 4x4 matrix, see `ObjectPose`; or a file, all numbers in metres: a 4x4
            matrix (.npy, .txt, .json, .yaml), such a text (.txt), or position and orientation as
            ROS has them (.json, .yaml: geometry_msgs Pose, Transform and their stamped forms).

    Raises:
        ContactError: There is no such file, or it states no such pose.

    Example:
        >>> from pathlib import Path
        >>> from grasp3d.grasps import read_object_pose
        >>> _ = Path("mug.yaml").write_text(
        ...     "position: {x: 0.4, y: 0, z: 0.1}\norientation: {x: 0, y: 0, z: 0, w: 1}"
        ... )
        >>> read_object_pose("mug.yaml").position
        (0.4, 0.0, 0.1)
    """
    return _of_file(source, _pose_of) or ObjectPose.of(_text(source))


def read_frame(source: GivenFrame) -> GripperFrame:
    """The frame of a gripper's poses, of a name, a matrix or a file.

    Args:
        source: A name or a matrix, see `GripperFrame`; or a file with the matrix (.npy, .txt,
            .json, .yaml), the pose of the TCP in the frame, translation in metres.

    Raises:
        ContactError: There is no such file, or the matrix is none.
        SettingError: It is 'auto'.
    """
    return _of_file(source, GripperFrame.of) or GripperFrame.of(_text(source))


def _text(source: object) -> Any:
    return str(source) if isinstance(source, Path) else source


def _of_file(source: object, of: Callable[[Any], ResultT]) -> ResultT | None:
    """What the content of a file states; None: the source is no file. Raises ContactError."""
    path = Path(source) if isinstance(source, str | Path) else None
    if path is None or path.suffix.lower() not in _READERS:
        return None
    check_file(path)
    try:
        return of(read_file(_READERS[path.suffix.lower()], path))
    except FileUnreadError:  # which names the file
        raise
    except OSError as error:
        raise ContactError(f"{path}: cannot be read ({error.strerror or error})") from error
    except (GraspError, ValueError) as error:
        raise ContactError(printable(f"{path}: {error}")) from error


def _text_or_rows(path: Path) -> Any:
    """The only line of a text; of several lines their numbers, separated by commas or spaces."""
    text = file_bytes(path).decode("utf-8-sig").strip()
    rows = [line.replace(",", " ").split() for line in text.splitlines() if line.strip()]
    return np.array(rows, dtype=np.float64) if len(rows) > 1 else text


_READERS: dict[str, Callable[[Path], Any]] = {
    ".npy": load_array, ".txt": _text_or_rows,
    ".json": load_json, ".yaml": load_yaml, ".yml": load_yaml,
}  # fmt: skip


def _pose_of(content: Any) -> ObjectPose:
    """The pose of the content of a file. Raises ContactError."""
    if not isinstance(content, dict):
        return ObjectPose.of(content)
    frame = mapping(content.get("header") or {}, "header").get("frame_id") or "robot"
    pose = mapping(content.get("pose", content.get("transform", content)), "pose")
    names = ("translation", "rotation") if "rotation" in pose else ("position", "orientation")
    position, turned = (mapping(required(pose, name), name) for name in names)
    numbers = [one_number(required(position, axis), axis) for axis in "xyz"]
    numbers += [one_number(required(turned, axis), axis) for axis in "xyzw"]
    return ObjectPose.of(",".join(map(str, [*numbers, frame])))


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
"""Key of the gripper's frame."""

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
    return {
        "unit": stated_unit(header.get("unit"), given.unit),
        "hand": given.hand or _gripper(header.get("gripper")),
        "object_file": text_or_none(header.get("object_file"), "object_file"),
        "object_scale": number_or_none(header.get("object_scale"), "object_scale"),
        "object_pose": ObjectPose.of(stated) if stated else None,
        FIELD: GripperFrame.of(text_or_none(header.get(FIELD), FIELD) or "tcp"),
        "assumes_frame": not header.get(FIELD),
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
        if isinstance(value, dict) and value.get("format") == ARTICULATED:
            return str(value.get("name", "a hand with joints"))  # its model is another file
        raise ContactError(f"its gripper {error}") from error
