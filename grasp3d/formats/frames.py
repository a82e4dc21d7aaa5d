"""Frames of files of poses: the gripper's and the object's, quaternions, what a hand must have."""

from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from scipy.spatial.transform import Rotation

from grasp3d.arrays import ArrayLike, Floats
from grasp3d.errors import ContactError, FileUnreadError, GraspError, OutputError
from grasp3d.formats import checks
from grasp3d.formats.format import Format
from grasp3d.formats.poses import GraspPoses
from grasp3d.hand.articulated.articulated_hand import ArticulatedHand
from grasp3d.hand.frames import FRAMES, GripperFrame
from grasp3d.hand.hand import Hand
from grasp3d.hand.object_pose import ObjectPose
from grasp3d.hand.parallel_gripper import ParallelGripper
from grasp3d.hand.pose_checks import checked_quaternions
from grasp3d.settings.units import METRES
from grasp3d.system.documents import described, file_bytes, load_json
from grasp3d.system.limited_reading import read_file
from grasp3d.system.names import printable

ResultT = TypeVar("ResultT")

KINDS = {"gripper": ParallelGripper, "articulated": ArticulatedHand}
"""Classes of hands by what formats call them."""


class UnknownUnitError(ContactError):
    """Poses need a unit, and their file states none."""


def missing_of_hand(hand: Hand | str | None, form: Format, *, joints: bool = False) -> str:
    """What a hand lacks for files of a format, a sentence; empty: nothing.

    Args:
        hand: The hand of the poses.
        form: The format.
        joints: Whether values of joints are to be written.
    """
    if joints and form.joints and isinstance(hand, ParallelGripper) and not hand.joint_names:
        return (
            f"{form.called} files have joint values, but gripper {hand.name!r} has no joint_names: "
            "give it joint_names, joint_scale and joint_closed, or choose another format"
        )
    if not form.hands or any(isinstance(hand, KINDS[kind]) for kind in form.hands):
        return ""
    if "gripper" in form.hands:
        return (
            f"{form.called} files have the pose of the hand's base, not of the fingertips, and so "
            "need the lengths of the gripper: give it (--hand, in Python hand=...)"
        )
    name = hand if isinstance(hand, str) or hand is None else hand.name
    wrong = "" if name is None else f" {name!r} is none:"
    return (
        f"{form.called} files have postures of a hand with joints;{wrong} give its description "
        "(--hand, in Python hand=...)"
    )


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


def joint_values(hand: ParallelGripper, openings: Floats, form: Format) -> Floats:
    """Values of the finger joints at openings [m] of (k,), shape (k, joints); nan: not known.

    Raises:
        OutputError: Openings are known, but the gripper has no joints.
    """
    if np.isfinite(openings).any() and (missing := missing_of_hand(hand, form, joints=True)):
        raise OutputError(missing)
    closed, scale = np.array(hand.joint_closed), np.array(hand.joint_scale)
    return np.asarray(closed + scale * openings[:, None])


def openings_of_joints(hand: ParallelGripper, joints: list[dict[str, float]]) -> Floats:
    """Openings [m] from joint values by name, the mean over the joints, (k,); nan: not stated.

    Raises:
        ContactError: The joints are those of another gripper.
    """
    scales = dict(zip(hand.joint_names, hand.joint_scale, strict=True))
    closed = dict(zip(hand.joint_names, hand.joint_closed, strict=True))
    openings = np.full(len(joints), np.nan)
    for number, values in enumerate(joints):
        own = [name for name in values if scales.get(name)]
        if values and scales and not own:
            stated = ", ".join(name[:40] for name in list(values)[:4])
            raise ContactError(
                f"its joints ({stated}) are not those of gripper {hand.name!r} "
                f"({', '.join(scales)}): give the gripper that the file was written for"
            )
        if own:
            opening = np.mean([(values[name] - closed[name]) / scales[name] for name in own])
            if opening < -0.1 * hand.max_opening:
                raise ContactError(
                    f"grasp {number + 1}: its joint values mean an opening of {opening:.4g} m: are "
                    f"they those of gripper {hand.name!r}?"
                )
            openings[number] = max(opening, 0.0)  # below 0 where fingers are pressed together
    return openings


GivenPose = ObjectPose | Path | ArrayLike
"""What `read_object_pose` takes."""

GivenFrame = GripperFrame | Path | ArrayLike
"""What `read_frame` takes."""


def read_object_pose(source: GivenPose) -> ObjectPose:
    """The pose of an object in the frame of a robot, of a text, a matrix or a file.

    Args:
        source: A text or a 4x4 matrix, see `ObjectPose`; or a file, all numbers in metres: a 4x4
            matrix (.npy, .txt, .json, .yaml), or such a text.

    Raises:
        ContactError: There is no such file, or it states no such pose.

    Example:
        >>> from pathlib import Path
        >>> from grasp3d.formats import read_object_pose
        >>> _ = Path("mug.txt").write_text("0.4,0,0.1,90")
        >>> read_object_pose("mug.txt").position
        (0.4, 0.0, 0.1)
    """
    return _of_file(source, ObjectPose.of) or ObjectPose.of(_text(source))


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
    checks.check_file(path)
    try:
        content = read_file(_READERS[path.suffix.lower()], path)
        if isinstance(content, dict):
            raise ContactError(f"must be a matrix of 4 rows; got {described(content)}")
        return of(content)
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
    ".npy": checks.load_array, ".txt": _text_or_rows,
    ".json": load_json, ".yaml": checks.load_yaml, ".yml": checks.load_yaml,
}  # fmt: skip
