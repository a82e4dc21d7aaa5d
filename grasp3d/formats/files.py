"""Reading and writing of grasps in files of every format: poses or contacts."""

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from grasp3d.arrays import Floats
from grasp3d.errors import ContactError, OutputError, SettingError
from grasp3d.formats import checks, frames
from grasp3d.formats.dictionaries import load_npy
from grasp3d.formats.format import Format, Given, format_of, formats, suffixes
from grasp3d.formats.own import OBJECT, SUFFIXES, read_contacts, write_contacts
from grasp3d.formats.poses import GraspPoses
from grasp3d.formats.postures import matched, refuse_joints
from grasp3d.hand.articulated_hand import ArticulatedHand
from grasp3d.hand.frames import FRAMES, GripperFrame, ObjectPose
from grasp3d.hand.hand import Hand
from grasp3d.settings.units import METRES, Unit
from grasp3d.surface.grasp_table import NO_POSES, GraspTable
from grasp3d.system.documents import is_folder, load_json
from grasp3d.system.files import check_suffix
from grasp3d.system.limited_reading import read_file
from grasp3d.system.names import unsupported

_LOADERS: dict[str, Callable[[Path], Any]] = {
    ".json": load_json, ".yaml": checks.load_yaml, ".yml": checks.load_yaml, ".npy": load_npy,
}  # fmt: skip
"""Loaders of content before the format is known; for other files the content is the path."""


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

    Its name and content decide whether a file contains poses or contacts. For contacts, CSV and
    Parquet have columns x1 y1 z1 x2 y2 z2 ..., a row for each grasp; other columns are ignored.
    JSON is a list of grasps, each a list of contacts [x, y, z]. Poses are returned as those of the
    TCP in the object's frame, whatever frames the file uses; see `GraspPoses`. Contacts without a
    unit are returned as they are in the file, but `evaluate_grasps` expects metres if the unit of
    the mesh is known: give `unit`, or pass the file itself, for which the mesh file's unit holds.

    Args:
        path: File to read; for hands with joints also a folder of .npy files.
        hand: The hand of the poses; formats with the pose of the hand's base need it.
        unit: Unit of the lengths, for files that state none; formats of robots are in metres.
        object_pose: Pose of the object in the frame of the poses, for files in the frame of a robot
            that do not state it; see `write_grasps`.
        frame: Frame of the gripper whose poses the file contains; see `GripperFrame`. A name, such
            as 'graspgen' or that of a link of a hand with joints; the pose of the TCP in it, a 4x4
            matrix, translation in metres; or a file with this matrix. None: the frame that the file
            states, or that of its format.
        outcome: Column or key that says whether a grasp held: 1 or 0, true or false. None: that of
            the format.
        object_scale: Factor from the numbers of the object's file to metres: for files that do not
            state it, or that have poses at several scales, of which it chooses one.

    Returns:
        The poses; or contacts in the order of the file, shape (b, n, 3) with b at least 1, n from 2
        to 32, in metres, or as in the file if no unit is known. `evaluate_grasps` takes both.

    Raises:
        ContactError: The file is missing, or contains no grasps or not the stated outcomes; or the
            pose of the object is not valid.
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
    if given := [name for name, value in of_poses.items() if value is not None]:
        raise SettingError(f"{path}: contains no poses; {given[0]} applies to poses")
    return read_contacts(path, unit=unit)


def read_poses(path: str | Path, **stated: Any) -> GraspPoses:
    """Read a file of grasp poses; takes the arguments of `read_grasps`.

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
    given = Given(**stated)
    pose = None if given.object_pose is None else frames.read_object_pose(given.object_pose)
    frame = None if given.frame is None else frames.read_frame(given.frame)
    with checks.reading(path):
        poses = _relative(frames.of_tcp(read_file(_read, path, given, frame)), pose)
        own, scale = poses.object_scale, given.object_scale
        if scale is not None and own and not math.isclose(own, scale, rel_tol=1e-6):
            raise ContactError(f"it states the object's scale {own:g}, not {scale:g}: give none")
        poses = replace(poses, object_scale=own if scale is None else scale)
        refuse_joints(poses, given.hand)
        if isinstance(poses.hand, ArticulatedHand) and poses.posture.size:
            poses = matched(poses, poses.hand)
        return poses


def _relative(poses: GraspPoses, object_pose: ObjectPose | None) -> GraspPoses:
    """Convert poses from the frame of a file to the object's frame. Raises ContactError."""
    stated, frame = poses.object_pose, poses.settings.get("frame")
    if (name := poses.settings.get("frame_id")) not in OBJECT:
        frame = frame or name
    if object_pose is not None and stated is not None:
        raise ContactError(f"it states the object's pose itself, {stated}: give none")
    pose = object_pose or stated
    if pose is not None:
        return replace(poses.moved(np.asarray(np.linalg.inv(pose.matrix))), object_pose=pose)
    if frame:
        where = f"its poses are in the frame {frame!r}, not in that of the object ('object')"
        needed = "give the pose of the object in it (--object-pose, in Python object_pose=...)"
        raise ContactError(f"{where}: {needed}")
    return poses


def holds_poses(path: str | Path) -> bool:
    """Whether a file contains grasp poses rather than contacts, judged by its content.

    Args:
        path: A file; if it is missing or damaged, its suffix alone decides.

    Example:
        >>> from pathlib import Path
        >>> from grasp3d.formats import holds_poses
        >>> _ = Path("grasps.json").write_text("[[[0, 0, 0.015], [0, 0, -0.015]]]")
        >>> holds_poses("grasps.json"), holds_poses("grasps.yaml")
        (False, True)
    """
    return read_file(_holds_poses, Path(path))


def _holds_poses(path: Path) -> bool:
    suffix = path.suffix.lower()
    if is_folder(path) and not suffix:
        return any(file.suffix.lower() == ".npy" for file in path.rglob("*"))
    if suffix not in SUFFIXES:
        return suffix in suffixes()
    try:
        known, content = _fitting(path)
        return any(one.sniff(content) for one in known)
    except (OSError, ValueError, ContactError):
        return False


def _fitting(path: Path) -> tuple[list[Format], Any]:
    """The formats with the suffix of a file, and the content of the file."""
    suffix = ".npy" if is_folder(path) else path.suffix.lower()
    content = _LOADERS.get(suffix, Path)(path)
    return [one for one in formats().values() if suffix in one.suffixes], content


def _read(path: Path, given: Given, frame: GripperFrame | None) -> GraspPoses:
    """Read poses as they are in a file. Raises ContactError, ValueError, OSError, OutputError."""
    known, content = _fitting(path)
    form = next((one for one in known if one.sniff(content)), None)
    if form is None:
        raise ContactError(_unknown(known, content))
    in_metres = form.unit == "m"
    if in_metres and given.unit not in {None, "m"}:
        raise ContactError(f"{form.title} files are in metres, not in {given.unit}: give no unit")
    missing = frames.missing_of_hand(given.hand, form, joints=False)
    if missing and not (form.alone and given.hand is None):
        raise ContactError(missing)
    with np.errstate(over="ignore", invalid="ignore"):  # such numbers are refused later
        poses = form.read(content, given)
    if in_metres:
        poses = replace(poses, unit="m", hand=given.hand or poses.hand)
    if frame is not None:
        return replace(poses, gripper_frame=frame, assumes_frame=False)
    if form.states_frame:
        return poses
    return replace(poses, gripper_frame=FRAMES[form.frame], assumes_frame=True)


def _unknown(known: list[Format], content: Any) -> str:
    grasps = content.get("grasps", content) if isinstance(content, dict) else content
    if getattr(grasps, "shape", None) != () and hasattr(grasps, "__len__") and not len(grasps):
        return "there are no grasps in it"
    listed = "; or ".join(f"{one.holds} ({one.title})" for one in known)
    found = f"; got {content.dtype} of shape {content.shape}" if hasattr(content, "dtype") else ""
    return f"contains no poses: expected {listed}{found}"


class Posed(Protocol):
    """Evaluated grasps that have poses."""

    def to_poses(self, metrics: Mapping[str, Floats] | None = None) -> GraspPoses:
        """The poses with the results as columns."""


def write_grasps(
    path: str | Path,
    grasps: GraspTable | Posed | GraspPoses,
    *,
    format: str | None = None,  # noqa: A002, what it is called everywhere
    metrics: Mapping[str, Floats] | None = None,
    object_pose: frames.GivenPose | None = None,
    frame: frames.GivenFrame | None = None,
) -> None:
    """Write grasps with labels, critical angles and epsilon, in the format given by the suffix.

    Grasps without poses have one row, in JSON one entry, each: `grasp` (its number from 1),
    `label`, `critical_angle`, `critical_angle_best`, `max_resolution`, `margin` [rad], `epsilon`,
    `epsilon_min`, `epsilon_max`, `rank`, `opening`, `separation`; and for each contact its position
    on the surface `x1` `y1` `z1`, the outward normal there `nx1` `ny1` `nz1`, `distance1`, its
    distance from the surface before it was moved there, and `on_crease1`. Tables have a column
    `unit`. nan is written as an empty cell; in JSON, nan and infinite numbers are null. JSON and
    Parquet contain the settings.

    A load adds `grip_force`, `grip_force_least`, `grip_force_largest` [N], and `payload` [kg] if a
    force is at hand; see `LoadResult`. `label` takes everything stated into account, and `score` is
    the one number by which grasps are sorted.

    Poses are written with all that is known about them. Formats of robots, simulators and data sets
    need the gripper and the unit; see the page on formats of grasp poses.

    Args:
        path: File to make or replace; .csv, .parquet or .json, with poses also .yaml, .h5 or .npy.
        grasps: Grasps with contacts, evaluated poses, or poses alone.
        format: For poses: name of the format; None: the default one for the suffix.
        metrics: Quality measures of the grasps, which become columns.
        object_pose: For poses: the object's pose in the frame of a robot, in which poses, contacts
            and normals are then written, if the format allows it; grasp3d's own formats state the
            pose, and are read back relative to the object. A 4x4 matrix, translation in metres; a
            text 'x,y,z,yaw' in metres and degrees; or a file, see `read_object_pose`. None: the
            frame of the object, or that of the file that the poses were read from.
        frame: For poses: the frame of the gripper in the file, as `read_grasps` takes it; files in
            json, csv and parquet state it. None: that of the format.

    Raises:
        ContactError: The pose of the object is not valid.
        OutputError: No format has that suffix, the format needs something that is not known, or the
            file cannot be written.
        SettingError: No format has that name; an argument for poses is given for grasps that have
            none; or the format has the object's frame by definition.

    Example:
        >>> import trimesh
        >>> import grasp3d
        >>> box = trimesh.creation.box([0.08, 0.05, 0.03])
        >>> labels = grasp3d.label_surface(grasp3d.load_mesh(box, unit="m", max_edge=0.02))
        >>> grasp3d.write_grasps("box.csv", grasp3d.best_grasps(labels, 3))
        >>> grasp3d.read_grasps("box.csv").shape
        (3, 2, 3)
    """
    path = Path(path)
    if isinstance(grasps, GraspTable):
        if any(given is not None for given in (format, object_pose, frame)):
            raise SettingError(NO_POSES)
        write_contacts(path, grasps, metrics)
        return
    poses = grasps if isinstance(grasps, GraspPoses) else grasps.to_poses(metrics)
    form = format_of(path, format)
    check_suffix(path, form.suffixes, form.name)
    if not poses.count:
        raise OutputError(f"{path}: there are no poses to write")
    if object_pose is not None:
        check_frame(form)
        poses = replace(poses, object_pose=frames.read_object_pose(object_pose))
    if poses.object_pose is not None and form.moves:
        poses = poses.moved(poses.object_pose.matrix)
    poses = replace(poses, gripper_frame=frames.read_frame(form.frame if frame is None else frame))
    try:
        form.write(path, frames.of_tcp(_of_format(poses, form), inverse=True))
    except (ContactError, OutputError) as error:
        text = str(error)
        raise OutputError(text if text.startswith(str(path)) else f"{path}: {text}") from error


def _of_format(poses: GraspPoses, form: Format) -> GraspPoses:
    """Convert poses to what a format contains: in metres, with the scale of the object's file.

    Raises:
        ContactError: The postures are those of another hand, or the unit is not known.
        OutputError: The hand is none that the format supports, or joint values or outcomes are
            missing.
    """
    is_open = bool(np.isfinite([poses.opening, poses.pregrasp_opening]).any())
    if missing := frames.missing_of_hand(poses.hand, form, joints=is_open):
        raise OutputError(missing)
    if form.outcomes and len(unknown := (poses.outcome != poses.outcome).nonzero()[0]):
        row = unknown[0] + 1
        raise OutputError(f"{form.title} files need each outcome; that of grasp {row} is missing")
    if form.unit == "stated":
        return poses
    if isinstance(poses.hand, ArticulatedHand):
        poses = matched(poses, poses.hand)
    scale = poses.object_scale or METRES[poses.unit or "m"]
    return replace(poses.in_unit("m"), object_scale=scale)


def check_hand(form: Format, hand: Hand) -> None:
    """Check that poses of a hand can be written in a format.

    Args:
        form: The format.
        hand: The hand of the poses.

    Raises:
        OutputError: A library that the format needs is not installed.
        SettingError: The hand lacks something that such files state.
    """
    if form.needs:
        checks.library(*form.needs)
    if missing := frames.missing_of_hand(hand, form, joints=True):
        raise SettingError(missing)


def check_frame(form: Format) -> None:
    """Check that poses in a format may be in the frame of a robot. Raises SettingError."""
    if not form.moves:
        able = (name for name, one in formats().items() if one.moves)
        why = f"{form.name} files have poses in the object's frame by definition"
        raise SettingError(f"{why}; with object_pose choose one of {', '.join(sorted(able))}")
