"""Reading of grasps from files of every format: poses or contacts."""

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from grasp3d.arrays import Floats
from grasp3d.errors import ContactError, SettingError
from grasp3d.formats import checks, frames
from grasp3d.formats.contacts import read_contacts
from grasp3d.formats.dictionaries import load_npy
from grasp3d.formats.format import Format, Given, formats, suffixes
from grasp3d.formats.own import OBJECT
from grasp3d.formats.poses import GraspPoses
from grasp3d.formats.postures import matched, refuse_joints
from grasp3d.hand.articulated.articulated_hand import ArticulatedHand
from grasp3d.hand.frames import FRAMES, GripperFrame
from grasp3d.hand.hand import Hand
from grasp3d.hand.object_pose import ObjectPose
from grasp3d.settings.units import Unit
from grasp3d.system.documents import is_folder, load_json
from grasp3d.system.limited_reading import read_file
from grasp3d.system.names import unsupported

_LOADERS: dict[str, Callable[[Path], Any]] = {
    ".json": load_json, ".yaml": checks.load_yaml, ".yml": checks.load_yaml, ".npy": load_npy,
}  # fmt: skip
"""What is loaded before the format is known; of other files it is their path."""


def read_grasps(
    path: str | Path,
    *,
    hand: Hand | None = None,
    unit: Unit | None = None,
    object_pose: frames.GivenPose | None = None,
    frame: frames.GivenFrame | None = None,
    outcome: str | None = None,
    object_scale: float | None = None,
) -> GraspPoses | Floats:
    """Read grasps from files of grasp3d, robots, simulators and data sets: poses or contacts.

    Which of the two a file contains is found from its name and content. Contacts: CSV and Parquet
    have columns x1 y1 z1 x2 y2 z2 ..., a row for each grasp; other columns are ignored. JSON is a
    list of grasps, each a list of contacts [x, y, z]. Poses are those of the TCP in the object's
    frame, whatever frame the file has; see `GraspPoses`. Contacts without a unit are returned as
    the file has them, though `evaluate_grasps` takes metres on a mesh whose unit is known: give
    `unit`, or the file itself to `evaluate_grasps`, which has them in the unit of the mesh's file.

    Args:
        path: File to read; of poses of hands with joints also a folder of .npy files.
        hand: The gripper that the poses are of; formats with the pose of the hand's base need it.
        unit: Unit of the lengths, for files that state none; formats of robots are in metres.
        object_pose: Pose of the object in the frame of the poses, for files in the frame of a robot
            that do not state it; see `write_grasps`.
        frame: Frame of the gripper in which the file has the poses: a name, such as 'graspgen', or
            of a link of a hand with joints; the pose of the TCP in it, a 4x4 matrix, translation in
            metres; or a file with this; see `GripperFrame`. None: the one that the file states, or
            that of its format.
        outcome: Column or key that says whether a grasp held: 1 or 0, true or false. None: those of
            the format.
        object_scale: Factor from the numbers of the object's file to metres, of which the poses
            are: for files of poses on an object at several scales, or that do not state it.

    Returns:
        The poses; or contacts in the order of the file, shape (b, n, 3) with n from 2 to 32; b at
        least 1: in metres, or as in the file where no unit is known. `evaluate_grasps` takes both.

    Raises:
        ContactError: The file is missing, or contains no grasps, or no such outcomes; or there is
            no such pose of the object.
        OutputError: A library that reads the format is not installed.
        SettingError: A pose of the object, a frame or an outcome is given for contacts.

    Example:
        >>> from pathlib import Path
        >>> import grasp3d
        >>> _ = Path("grasps.json").write_text("[[[0, 0, 0.015], [0, 0, -0.015]]]")
        >>> grasp3d.read_grasps("grasps.json").tolist()
        [[[0.0, 0.0, 0.015], [0.0, 0.0, -0.015]]]
        >>> rows = ["px,py,pz,qx,qy,qz,qw", "0,0,60,1,0,0,0"]
        >>> _ = Path("poses.csv").write_text(chr(10).join(rows))
        >>> grasp3d.read_grasps("poses.csv", unit="mm").in_unit("m").poses[0, :3, 3].tolist()
        [0.0, 0.0, 0.06]
    """
    of_poses: dict[str, Any] = {
        "object_pose": object_pose, "frame": frame, "outcome": outcome, "object_scale": object_scale
    }  # fmt: skip
    if holds_poses(path):
        return read_poses(path, hand=hand, unit=unit, **of_poses)
    for name, given in of_poses.items():
        if given is not None:
            raise SettingError(
                f"{path}: contains no poses; {name} applies to poses, not to contacts"
            )
    return read_contacts(path, unit=unit)


def read_poses(
    path: str | Path,
    *,
    hand: Hand | None = None,
    unit: Unit | None = None,
    object_pose: frames.GivenPose | None = None,
    frame: frames.GivenFrame | None = None,
    outcome: str | None = None,
    object_scale: float | None = None,
) -> GraspPoses:
    """Read grasp poses, as `read_grasps`, of a file that contains poses.

    Example:
        >>> from pathlib import Path
        >>> from grasp3d.formats import read_poses
        >>> rows = ["px,py,pz,qx,qy,qz,qw", "0,0,60,1,0,0,0"]
        >>> _ = Path("poses.csv").write_text(chr(10).join(rows))
        >>> read_poses("poses.csv", unit="mm").in_unit("m").poses[0, :3, 3].tolist()
        [0.0, 0.0, 0.06]
    """
    path = Path(path)
    if path.suffix.lower() not in suffixes() and not is_folder(path):
        raise ContactError(unsupported(path, suffixes(), "pose"))
    checks.check_file(path)
    pose = None if object_pose is None else frames.read_object_pose(object_pose)
    chosen = None if frame is None else frames.read_frame(frame)
    given = Given(hand=hand, unit=unit, outcome=outcome, object_scale=object_scale)
    try:
        poses = _relative(frames.of_tcp(read_file(_read, path, given, chosen)), pose)
        poses = _with_scale(poses, object_scale)
        refuse_joints(poses, hand)
        if isinstance(poses.hand, ArticulatedHand) and poses.posture.size:
            poses = matched(poses, poses.hand)
    except OSError as error:
        raise checks.one_line(path, f"cannot be read ({error.strerror or error})") from error
    except frames.UnknownUnitError as error:
        raise frames.UnknownUnitError(str(checks.one_line(path, str(error)))) from error
    except (ContactError, SettingError, ValueError) as error:
        raise checks.one_line(path, str(error)) from error
    return poses


def _relative(poses: GraspPoses, object_pose: ObjectPose | None) -> GraspPoses:
    """Poses as a file has them, in the object's frame. Raises ContactError."""
    stated, frame = poses.object_pose, poses.settings.get("frame")
    if (name := poses.settings.get("frame_id")) not in OBJECT:
        frame = frame or name
    if object_pose is not None and stated is not None:
        raise ContactError(f"it states the object's pose itself, {stated}: give none")
    pose = object_pose or stated
    if pose is not None:
        return replace(poses.moved(np.asarray(np.linalg.inv(pose.matrix))), object_pose=pose)
    if frame:
        raise ContactError(
            f"its poses are in the frame {frame!r}, not in that of the object ('object'): give the "
            "pose of the object in it (--object-pose, in Python object_pose=...)"
        )
    return poses


def _with_scale(poses: GraspPoses, scale: float | None) -> GraspPoses:
    """Poses with the scale that is given. Raises ContactError if they state another one."""
    stated = poses.object_scale
    if scale is not None and stated is not None and not math.isclose(stated, scale, rel_tol=1e-6):
        raise ContactError(f"it states the object's scale {stated:g}, not {scale:g}: give none")
    return poses if scale is None else replace(poses, object_scale=scale)


def holds_poses(path: str | Path) -> bool:
    """Whether a file contains grasp poses rather than contacts, judged by its content.

    Args:
        path: A file; one that is missing or damaged holds none, unless its suffix stands for poses.

    Example:
        >>> from pathlib import Path
        >>> from grasp3d.formats import holds_poses
        >>> _ = Path("grasps.json").write_text("[[[0, 0, 0.015], [0, 0, -0.015]]]")
        >>> holds_poses("grasps.json"), holds_poses("grasps.yaml")
        (False, True)
    """
    return read_file(_holds_poses, Path(path))


def _holds_poses(path: Path) -> bool:
    from grasp3d.formats.contacts import SUFFIXES

    suffix = path.suffix.lower()
    if is_folder(path) and not suffix:
        return any(file.suffix.lower() == ".npy" for file in path.rglob("*"))
    if suffix not in SUFFIXES:
        return suffix in suffixes()
    try:
        return _format_in(path, _content(path)) is not None
    except (OSError, ValueError, ContactError):
        return False


def _suffix(path: Path) -> str:
    return ".npy" if is_folder(path) else path.suffix.lower()


def _content(path: Path) -> Any:
    return _LOADERS.get(_suffix(path), Path)(path)


def _format_in(path: Path, content: object) -> Format | None:
    """The format of content; None: there are no poses in it."""
    fitting = (one for one in formats().values() if _suffix(path) in one.suffixes)
    return next((one for one in fitting if one.sniff(content)), None)


def _read(path: Path, given: Given, frame: GripperFrame | None) -> GraspPoses:
    """Poses as a file has them. Raises ContactError, ValueError, OSError, OutputError."""
    content = _content(path)
    form = _format_in(path, content)
    if form is None:
        raise ContactError(_unknown(path, content))
    in_metres = form.unit == "m"
    if in_metres and given.unit not in {None, "m"}:
        raise ContactError(
            f"{form.called} files are in metres, not in {given.unit}: read them without a unit, "
            "and convert the poses with in_unit"
        )
    missing = frames.missing_of_hand(given.hand, form)
    if missing and not (form.alone and given.hand is None):
        raise ContactError(missing)
    with np.errstate(over="ignore", invalid="ignore"):  # of numbers that are refused
        poses = form.read(content, given)
    if in_metres:
        poses = replace(poses, unit="m", hand=given.hand or poses.hand)
    if frame is not None:
        return replace(poses, gripper_frame=frame, assumes_frame=False)
    if form.states_frame:
        return poses
    return replace(poses, gripper_frame=FRAMES[form.frame], assumes_frame=True)


def _unknown(path: Path, content: Any) -> str:
    grasps = content.get("grasps", content) if isinstance(content, dict) else content
    if hasattr(grasps, "__len__") and not len(grasps):
        return "there are no grasps in it"
    known = [one for one in formats().values() if _suffix(path) in one.suffixes]
    listed = "; or ".join(f"{one.holds} ({one.called})" for one in known)
    found = f"; got {content.dtype} of shape {content.shape}" if hasattr(content, "dtype") else ""
    return f"contains no poses: expected {listed}{found}"
