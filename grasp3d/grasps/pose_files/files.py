"""Reading and writing of grasp poses in files of every format."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from grasp3d.errors import ContactError, OutputError, SettingError
from grasp3d.grasps.pose_files import acronym, data_sets, hand_files, own_files, robots
from grasp3d.grasps.pose_files.documents import (
    check_file,
    load_yaml,
    one_line,
    yaml_module,
)
from grasp3d.grasps.pose_files.frames import (
    OBJECT_FRAMES,
    Given,
    GivenFrame,
    GivenPose,
    UnknownUnitError,
    as_in_file,
    in_file_metres,
    missing_of_hand,
    of_tcp,
    read_frame,
    read_object_pose,
)
from grasp3d.grasps.poses import GraspPoses
from grasp3d.grasps.postures import matched, refuse_joints
from grasp3d.hand.articulated.articulated_hand import ArticulatedHand
from grasp3d.hand.frames import FRAMES, GripperFrame
from grasp3d.hand.hand import Hand
from grasp3d.hand.object_pose import ObjectPose
from grasp3d.settings import PoseFormat, check_choice
from grasp3d.settings.units import Unit
from grasp3d.system.documents import is_folder, load_json
from grasp3d.system.files import check_suffix
from grasp3d.system.limited_reading import read_file
from grasp3d.system.names import unsupported


@dataclass(frozen=True)
class _Format:
    """How a format is written and read."""

    suffixes: tuple[str, ...]
    write: Callable[[Path, GraspPoses], None]
    """Write poses of the frame below, of formats with a title in metres."""
    read: Callable[[Any, Given], GraspPoses]
    """Poses of the frame below, of a file of this path; of files of `_LOADERS`, of this content."""
    title: str = ""
    """Its name in messages, of formats that are in metres, of certain hands; empty: of any."""
    frame: str = "tcp"
    """Frame of the gripper in which the format has poses, in `FRAMES`."""
    is_in: Callable[[object], bool] | None = None
    """Whether content is in this format; None: all files of its suffix that are in no other."""
    library: Callable[[], Any] = list
    """Raises OutputError if a library that it needs is not installed."""
    states_frame: bool = False
    """Whether what is read states its frame: files do themselves, or their reader does."""
    states_hand: bool = False
    """Whether it is read without a hand."""


_LOADERS: dict[str, Callable[[Path], Any]] = {
    ".json": load_json, ".yaml": load_yaml, ".yml": load_yaml,
    ".npy": hand_files.load_npy, ".pt": hand_files.load_npy,
}  # fmt: skip
"""What is loaded before the format is known."""

_YAML, _HAND = (".yaml", ".yml"), "hand"
_DICTIONARIES = (".npy", ".pt")


def _has(*paths: str) -> Callable[[object], bool]:
    """Whether content has keys, within each other a.b; 0 is the first of a list, or all of one."""
    return lambda content: all(_holds(content, *path.split(".")) for path in paths)


def _holds(content: Any, key: str, *further: str) -> bool:
    if key == "0":
        return _holds(content[0] if isinstance(content, list) and content else content, *further)
    found = isinstance(content, dict) and key in content
    return found and (not further or _holds(content[key], *further))


_FORMATS: dict[PoseFormat, _Format] = {
    "json": _Format(
        (".json",), own_files.write_json, own_files.parse_json, is_in=_has("grasps.0.pose"),
        states_frame=True,
    ),
    "csv": _Format((".csv",), own_files.write_table, own_files.read_table, states_frame=True),
    "parquet": _Format(
        (".parquet",), own_files.write_table, own_files.read_table, states_frame=True
    ),
    "isaac_grasp": _Format(
        _YAML, robots.write_isaac, robots.parse_isaac, robots.ISAAC, _HAND, library=yaml_module
    ),
    "acronym": _Format(
        (".h5", ".hdf5"), acronym.write_acronym, acronym.read_acronym, acronym.WHAT, "acronym",
        library=acronym.h5py_module, states_frame=True, states_hand=True,
    ),
    "graspgen": _Format(
        (".json",), data_sets.write_graspgen, data_sets.parse_graspgen, data_sets.GRASPGEN,
        "graspgen", _has("grasps.transforms"),
    ),
    "graspnet": _Format(
        (".npy",), data_sets.write_graspnet, data_sets.parse_graspnet, "graspnetAPI",
        "graspnetapi", lambda content: not isinstance(content, list),
    ),
    "moveit": _Format(
        (".json",), robots.write_moveit, robots.parse_moveit, robots.MOVEIT, _HAND,
        _has("0.grasp_pose"),
    ),
    "dexgraspbench": _Format(
        _DICTIONARIES, hand_files.write_bench, hand_files.parse_bench, "DexGraspBench", _HAND,
        lambda content: any(_has(f"0.{key}")(content) for key in ("grasp_qpos", "robot_pose")),
        states_frame=True,
    ),
    "dexgraspnet": _Format(
        _DICTIONARIES, hand_files.write_net, hand_files.parse_net, "DexGraspNet", _HAND,
        _has("0.qpos"), states_frame=True,
    ),
}  # fmt: skip
"""Of several that content may be in the first one counts."""

OWN_FORMATS = frozenset[PoseFormat]({"json", "csv", "parquet"})
"""Formats with the poses of any hand; the others have those of a gripper's base."""

FRAME_FORMATS = OWN_FORMATS | {"moveit", "dexgraspbench"}
"""Formats whose poses may be in the frame of a robot; others have the object's by definition."""

JOINT_FORMATS = frozenset[PoseFormat]({"isaac_grasp", "moveit"})
"""Formats that state values of the gripper's joints."""

SUFFIXES = tuple(dict.fromkeys(suffix for known in _FORMATS.values() for suffix in known.suffixes))
"""Endings of files of poses."""


def write_poses(
    path: str | Path,
    poses: GraspPoses,
    *,
    format: PoseFormat | None = None,  # noqa: A002, what it is called everywhere
    object_pose: GivenPose | None = None,
    frame: GivenFrame | None = None,
) -> None:
    """Write grasp poses for robots and robots.

    Args:
        path: File to make or replace.
        poses: At least one pose. Formats of robots need the gripper and the unit.
        format: json, csv, parquet, isaac_grasp (.yaml), acronym (.h5), graspnet (.npy), graspgen or
            moveit (.json); of hands with joints dexgraspbench or dexgraspnet (.npy); None: that of
            the suffix, json for .json, isaac_grasp for .yaml, graspnet for .npy.
        object_pose: Pose of the object in the frame that the file is to have, for json, csv,
            parquet and moveit; see `write_grasps`. None: that of `poses`.
        frame: Frame of the gripper that the file is to have; see `GripperFrame`. None: that of the
            format.

    Raises:
        ContactError: There is no such pose of the object.
        OutputError: No format has that suffix, it needs something that is not known, or the file
            cannot be written.
        SettingError: No format is called so, or it has the object's frame by definition.

    Example:
        >>> import numpy as np
        >>> from grasp3d.grasps.pose_files import read_poses, write_poses
        >>> from grasp3d.grasps.poses import GraspPoses
        >>> from_above = GraspPoses(poses=np.diag([1.0, -1.0, -1.0, 1.0]), opening=0.05, unit="m")
        >>> write_poses("poses.csv", from_above)
        >>> read_poses("poses.csv").opening.tolist()
        [0.05]
    """
    path = Path(path)
    if format is not None:
        check_choice("format", format, PoseFormat)
    name = format or format_of(path)
    if name is None:
        raise OutputError(unsupported(path, SUFFIXES, "pose"))
    check_suffix(path, _FORMATS[name].suffixes, name)
    if not poses.count:
        raise OutputError(f"{path}: there are no poses to write")
    if object_pose is not None:
        check_frame(name)
        poses = replace(poses, object_pose=read_object_pose(object_pose))
    if poses.object_pose is not None and name in FRAME_FORMATS:
        poses = poses.moved(poses.object_pose.matrix)
    given = FRAMES[_FORMATS[name].frame] if frame is None else read_frame(frame)
    poses = replace(poses, gripper_frame=given)
    try:
        title = _FORMATS[name].title
        _FORMATS[name].write(path, in_file_metres(poses, title) if title else as_in_file(poses))
    except OutputError as error:
        text = str(error)
        raise OutputError(text if text.startswith(str(path)) else f"{path}: {text}") from error


def read_poses(
    path: str | Path,
    *,
    hand: Hand | None = None,
    unit: Unit | None = None,
    object_pose: GivenPose | None = None,
    frame: GivenFrame | None = None,
    outcome: str | None = None,
    object_scale: float | None = None,
) -> GraspPoses:
    """Read grasp poses from files of robots, simulators and data sets.

    Poses are those of the TCP in the object's frame, whatever frame the file has; see `GraspPoses`.

    Args:
        path: File to read; of hands with joints also a folder of .npy files.
        hand: The gripper that the grasps are of; formats with the pose of the hand's base (all but
            json, csv, parquet and acronym) need it.
        unit: Unit of the lengths, for files that state none; formats of robots are in metres.
        object_pose: Pose of the object in the frame of the file, for those in the frame of a robot
            that do not state it; see `write_grasps`.
        frame: Frame of the gripper that the file has; see `GripperFrame`. None: the one that it
            states, or that of its format.
        outcome: Name of the values of the file that say whether a grasp held, 1 or 0, true or
            false. None: those of the format.
        object_scale: Factor from the numbers of the object's file to metres, of which the poses
            are: for files of poses on an object at several scales, such as those of DexGraspNet, or
            that do not state it.

    Raises:
        ContactError: The file is missing, or contains no such poses or outcomes; or there is no
            such pose of the object.
        OutputError: A library that reads the format is not installed.
        SettingError: The frame is 'auto'.

    Example:
        >>> from pathlib import Path
        >>> from grasp3d.grasps.pose_files import read_poses
        >>> rows = ["px,py,pz,qx,qy,qz,qw", "0,0,60,1,0,0,0"]
        >>> _ = Path("poses.csv").write_text(chr(10).join(rows))
        >>> read_poses("poses.csv", unit="mm").in_unit("m").poses[0, :3, 3].tolist()
        [0.0, 0.0, 0.06]
    """
    path = Path(path)
    if path.suffix.lower() not in SUFFIXES and not is_folder(path):
        raise ContactError(unsupported(path, SUFFIXES, "pose"))
    check_file(path)
    pose = None if object_pose is None else read_object_pose(object_pose)
    chosen = None if frame is None else read_frame(frame)
    given = Given(hand, unit, outcome, object_scale)
    try:
        poses = _relative(of_tcp(read_file(_read, path, given, chosen)), pose)
        poses = _with_scale(poses, object_scale)
        refuse_joints(poses, hand)
        is_matched = isinstance(poses.hand, ArticulatedHand) and poses.posture.size
        return matched(poses, poses.hand) if is_matched else poses  # type: ignore[arg-type]
    except OSError as error:
        raise one_line(path, f"cannot be read ({error.strerror or error})") from error
    except UnknownUnitError as error:
        raise UnknownUnitError(str(one_line(path, str(error)))) from error
    except (ContactError, SettingError, ValueError) as error:
        raise one_line(path, str(error)) from error


def _relative(poses: GraspPoses, object_pose: ObjectPose | None) -> GraspPoses:
    """Poses as a file has them, in the object's frame. Raises ContactError."""
    stated, frame = poses.object_pose, poses.settings.get("frame")
    if (name := poses.settings.get("frame_id", "")) not in OBJECT_FRAMES:
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
        path: A file; one that is missing or damaged holds none.

    Example:
        >>> from pathlib import Path
        >>> from grasp3d.grasps.pose_files import holds_poses
        >>> _ = Path("grasps.json").write_text("[[[0, 0, 0.015], [0, 0, -0.015]]]")
        >>> holds_poses("grasps.json"), holds_poses("grasps.yaml")
        (False, True)
    """
    return read_file(_holds_poses, Path(path))


def _holds_poses(path: Path) -> bool:
    suffix = path.suffix.lower()
    if is_folder(path) and not suffix:
        return any(file.suffix.lower() in _DICTIONARIES for file in path.rglob("*"))
    if suffix not in {".json", ".csv", ".parquet"}:
        return suffix in SUFFIXES
    try:
        if suffix == ".json":
            return _format_in(suffix, load_json(path)) is not None
        from grasp3d.system.tables import column_names

        return own_files.are_poses(column_names(path))
    except (OSError, ValueError, ContactError):
        return False


def suffixes_of(format: PoseFormat) -> tuple[str, ...]:  # noqa: A002, what it is called everywhere
    """Endings of files of a format."""
    return _FORMATS[format].suffixes


def format_of(path: Path) -> PoseFormat | None:
    """The format that the ending of a file to write stands for; None: none does."""
    suffix = path.suffix.lower()
    return next((name for name, entry in _FORMATS.items() if suffix in entry.suffixes), None)


def check_hand(format: PoseFormat | None, hand: Hand) -> None:  # noqa: A002
    """Check that poses of a hand can be written in a format.

    Args:
        format: The format; None: another file.
        hand: The hand of the poses.

    Raises:
        OutputError: A library that the format needs is not installed.
        SettingError: It lacks what the files state.
    """
    if format is not None:
        _FORMATS[format].library()
    if format is None or format in OWN_FORMATS:
        return
    missing = missing_of_hand(hand, format, joints=format in JOINT_FORMATS)
    if missing:
        raise SettingError(missing)


def check_frame(format: PoseFormat | None) -> None:  # noqa: A002
    """Check that poses in a format may be in the frame of a robot.

    Args:
        format: The format; None: another file.

    Raises:
        SettingError: They may not.
    """
    if format is not None and format not in FRAME_FORMATS:
        raise SettingError(
            f"{format} files have poses in the object's frame by definition; with object_pose "
            f"choose one of {', '.join(sorted(FRAME_FORMATS))}"
        )


def _read(path: Path, given: Given, frame: GripperFrame | None) -> GraspPoses:
    """Poses as a file has them. Raises ContactError, ValueError, OSError, OutputError."""
    suffix = ".npy" if is_folder(path) else path.suffix.lower()
    content = _LOADERS[suffix](path) if suffix in _LOADERS else path
    name = _format_in(suffix, content)
    if name is None:
        raise ContactError(_unknown(suffix, content))
    entry = _FORMATS[name]
    if entry.title:
        given.check(entry.title, states_hand=entry.states_hand)
    with np.errstate(over="ignore", invalid="ignore"):  # of numbers that are refused
        poses = entry.read(content, given)
    if entry.title:
        poses = replace(poses, unit="m", hand=given.hand or poses.hand)
    if frame is not None:
        return replace(poses, gripper_frame=frame, assumes_frame=False)
    if entry.states_frame:
        return poses
    return replace(poses, gripper_frame=FRAMES[entry.frame], assumes_frame=True)


def _format_in(suffix: str, content: object) -> PoseFormat | None:
    """The format of content: one that recognizes it, else the one of all other files."""
    fitting = [(name, entry.is_in) for name, entry in _FORMATS.items() if suffix in entry.suffixes]
    found = [name for name, is_in in fitting if is_in and is_in(content)]
    others = [name for name, is_in in fitting if is_in is None]
    return next(iter([*found, *others]), None)


def _unknown(suffix: str, content: object) -> str:
    if suffix in _DICTIONARIES:
        keys = "grasp_qpos or robot_pose (DexGraspBench), or qpos (DexGraspNet)"
        return f"contains no poses: its dictionaries must have the key {keys}"
    if content in ([], {}) or (isinstance(content, dict) and content.get("grasps") == []):
        return "there are no grasps in it"
    return (
        "contains no poses: expected the key grasps with poses (as write_poses writes them) or "
        "transforms (GraspGen), or a list of messages with grasp_pose (moveit_msgs/Grasp)"
    )
