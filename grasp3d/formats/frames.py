"""Frames in files of poses (the gripper's and the object's), quaternions and joint values."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from scipy.spatial.transform import Rotation

from grasp3d.arrays import ArrayLike, Floats
from grasp3d.errors import ContactError
from grasp3d.formats import checks
from grasp3d.formats.format import Format
from grasp3d.formats.poses import GraspPoses
from grasp3d.hand.articulated_hand import ArticulatedHand
from grasp3d.hand.frames import FRAMES, GripperFrame, ObjectPose
from grasp3d.hand.hand import Hand
from grasp3d.hand.parallel_gripper import ParallelGripper
from grasp3d.hand.pose_checks import checked_quaternions
from grasp3d.settings.units import METRES
from grasp3d.system.documents import described, file_bytes, load_json
from grasp3d.system.limited_reading import read_file

ResultT = TypeVar("ResultT")

KINDS = {"gripper": ParallelGripper, "articulated": ArticulatedHand}
"""Classes of hands, by the names that formats use."""


class UnknownUnitError(ContactError):
    """Poses need a unit, and their file states none."""


def missing_of_hand(hand: Hand | str | None, form: Format, *, joints: bool) -> str:
    """Describe in a sentence what a hand lacks for files of a format; empty: nothing.

    Args:
        hand: The hand of the poses.
        form: The format.
        joints: Whether values of joints are to be written.
    """
    name = getattr(hand, "name", hand)
    if joints and form.joints and isinstance(hand, ParallelGripper) and not hand.joint_names:
        said = f"{form.title} files have joint values, but gripper {name!r} has no joint_names"
        return f"{said}: give it joint_names, joint_scale and joint_closed, or use another format"
    if not form.hands or any(isinstance(hand, KINDS[kind]) for kind in form.hands):
        return ""
    needed = "the pose of the hand's base, so they need the lengths of the gripper: give it"
    if "gripper" not in form.hands:
        wrong = "" if name is None else f" {name!r} is none:"
        needed = f"postures of a hand with joints;{wrong} give its description"
    return f"{form.title} files have {needed} (--hand, in Python hand=...)"


def of_tcp(poses: GraspPoses, *, inverse: bool = False) -> GraspPoses:
    """Convert poses of their `gripper_frame`, as files state them, to poses of the TCP.

    Args:
        poses: The poses.
        inverse: Whether to convert poses of the TCP to those of `gripper_frame` instead.

    Raises:
        ContactError: The frames have different origins, and the unit of the poses is not known.
        SettingError: The frame depends on a gripper, and there is none.
    """
    if poses.gripper_frame == FRAMES["tcp"]:
        return poses
    motion = poses.gripper_frame.to_tcp(poses.hand if isinstance(poses.hand, Hand) else None)
    if motion[:3, 3].any():
        if poses.unit is None:
            raise UnknownUnitError(
                f"its poses are in the gripper frame '{poses.gripper_frame}', whose distance from "
                "the TCP is in metres, but their unit is not known: give it (a column unit, in "
                "Python unit=...)"
            )
        motion[:3, 3] /= METRES[poses.unit]
    change = np.asarray(np.linalg.inv(motion)) if inverse else motion
    return poses.changed(lambda moved: moved @ change)


def quaternions(poses: Floats) -> Floats:
    """Quaternions x y z w of poses (k, 4, 4), w at least 0, shape (k, 4)."""
    values = Rotation.from_matrix(poses[:, :3, :3]).as_quat(canonical=True)
    return np.asarray(values, dtype=np.float64).reshape(-1, 4)


def from_quaternions(values: Floats, where: str = "") -> Floats:
    """Poses (k, 4, 4) from positions x y z and quaternions x y z w (k, 7). Raises ContactError."""
    for row, column in np.argwhere(~np.isfinite(values)):
        what = "position" if column < 3 else "quaternion"
        raise ContactError(f"{where}grasp {row + 1}: its {what} is not finite")
    poses = np.tile(np.eye(4), (len(values), 1, 1))
    poses[:, :3, :3] = Rotation.from_quat(checked_quaternions(values[:, 3:], where)).as_matrix()
    poses[:, :3, 3] = values[:, :3]
    return poses


STEPS, NUDGE = 10, 1e-13
"""Number of steps after which a pose that writing still changes is turned, and the angle [rad]."""


def as_read_again(poses: Floats) -> Floats:
    """Change poses (k, 4, 4) slightly, so that files of quaternions give them back bit for bit."""
    nudged = Rotation.from_rotvec([NUDGE, 0.0, 0.0]).as_matrix()
    for step in range(1, 10 * STEPS):
        again = from_quaternions(np.hstack([poses[:, :3, 3], quaternions(poses)]))
        changed = (again != poses).any(axis=(1, 2))
        if not changed.any():
            break
        poses = again
        if step % STEPS == 0:
            poses[changed, :3, :3] = poses[changed, :3, :3] @ nudged
    return poses


def joint_values(hand: ParallelGripper, openings: Floats) -> Floats:
    """Values of the finger joints at openings (k,) [m], shape (k, joints); nan: not known."""
    closed, scale = np.array(hand.joint_closed), np.array(hand.joint_scale)
    return np.asarray(closed + scale * openings[:, None])


def openings_of_joints(hand: ParallelGripper, stated: Sequence[Any], what: str) -> Floats:
    """Openings [m] from named joint values of each grasp, as the mean over the joints, (k,).

    Args:
        hand: The gripper.
        stated: For each grasp an object of names and values; if it is empty, the opening is nan.
        what: Name of the values in messages.

    Raises:
        ContactError: The values are no numbers, or those of another gripper.
    """
    rows = [checks.mapping(one, f"grasp {k}: {what}") for k, one in enumerate(stated, 1)]
    values = {
        str(name): checks.numbers([row.get(name) for row in rows], (), f"{what} {name}")
        for name in dict.fromkeys(name for row in rows for name in row)
    }
    known = zip(hand.joint_names, hand.joint_closed, hand.joint_scale, strict=True)
    each = [(values[name] - closed) / scale
            for name, closed, scale in known if scale and name in values]  # fmt: skip
    if values and hand.joint_names and not each:
        said = f"its joints ({', '.join(name[:40] for name in [*values][:4])}) are not those of"
        own = f"gripper {hand.name!r} ({', '.join(hand.joint_names)})"
        raise ContactError(f"{said} {own}: give the gripper that the file was written for")
    if not each:
        return np.full(len(rows), np.nan)
    counts, openings = (~np.isnan(each)).sum(axis=0), np.full(len(rows), np.nan)
    np.divide(np.nansum(each, axis=0), counts, out=openings, where=counts > 0)
    if len(bad := np.flatnonzero(openings < -0.1 * hand.max_opening)):
        said = f"its joint values mean an opening of {openings[bad[0]]:.4g} m"
        raise ContactError(f"grasp {bad[0] + 1}: {said}: are they those of gripper {hand.name!r}?")
    return np.asarray(np.maximum(openings, 0.0))  # below 0 where fingers are pressed together


GivenPose = ObjectPose | Path | ArrayLike
"""Sources that `read_object_pose` takes."""

GivenFrame = GripperFrame | Path | ArrayLike
"""Sources that `read_frame` takes."""


def read_object_pose(source: GivenPose) -> ObjectPose:
    """Read the pose of an object in the frame of a robot from a text, a matrix or a file.

    Args:
        source: A text or a 4x4 matrix, see `ObjectPose`; or a file with such a matrix (.npy, .txt,
            .json, .yaml) or such a text, lengths in metres.

    Raises:
        ContactError: There is no such file, or the source states no valid pose.

    Example:
        >>> from pathlib import Path
        >>> from grasp3d.formats import read_object_pose
        >>> _ = Path("mug.txt").write_text("0.4,0,0.1,90")
        >>> read_object_pose("mug.txt").position
        (0.4, 0.0, 0.1)
    """
    return _read(source, ObjectPose.of)


def read_frame(source: GivenFrame) -> GripperFrame:
    """Read the frame of a gripper's poses from a name, a matrix or a file.

    Args:
        source: A name or a matrix, see `GripperFrame`; or a file with the matrix (.npy, .txt,
            .json, .yaml), the pose of the TCP in the frame, translation in metres.

    Raises:
        ContactError: There is no such file, or the matrix is not valid.
        SettingError: It is 'auto'.
    """
    return _read(source, GripperFrame.of)


def _read(source: object, of: Callable[[Any], ResultT]) -> ResultT:
    """Interpret a text, an array, or the content of a file with `of`. Raises ContactError."""
    path = Path(source) if isinstance(source, str | Path) else None
    if path is None or path.suffix.lower() not in _READERS:
        return of(str(source) if isinstance(source, Path) else source)
    with checks.reading(path):
        content = read_file(_READERS[path.suffix.lower()], path)
        if isinstance(content, dict):
            raise ContactError(f"must be a matrix of 4 rows; got {described(content)}")
        return of(content)


def _text_or_rows(path: Path) -> Any:
    """The only line of a text; if there are several, their numbers between commas or spaces."""
    text = file_bytes(path).decode("utf-8-sig").strip()
    rows = [line.replace(",", " ").split() for line in text.splitlines() if line.strip()]
    return np.array(rows, dtype=np.float64) if len(rows) > 1 else text


_READERS: dict[str, Callable[[Path], Any]] = {
    ".npy": checks.load_array, ".txt": _text_or_rows,
    ".json": load_json, ".yaml": checks.load_yaml, ".yml": checks.load_yaml,
}  # fmt: skip
