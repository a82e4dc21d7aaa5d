"""Writing of grasps to files of every format."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Protocol, runtime_checkable

from grasp3d.arrays import Floats
from grasp3d.errors import ContactError, OutputError, SettingError
from grasp3d.formats import frames
from grasp3d.formats.checks import library
from grasp3d.formats.contacts import write_contacts
from grasp3d.formats.format import Format, format_called, format_of, formats, suffixes
from grasp3d.formats.poses import GraspPoses
from grasp3d.formats.postures import matched
from grasp3d.hand.articulated.articulated_hand import ArticulatedHand
from grasp3d.hand.frames import FRAMES
from grasp3d.hand.hand import Hand
from grasp3d.settings.units import METRES
from grasp3d.surface.grasp_table import NO_POSES, GraspTable
from grasp3d.system.files import check_suffix
from grasp3d.system.names import unsupported


@runtime_checkable
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

    Of grasps without poses: one row, in JSON one entry, for each grasp: `grasp` (its number from
    1), `label`, `critical_angle`, `critical_angle_best`, `max_resolution`, `margin` [rad],
    `epsilon`, `epsilon_min`, `epsilon_max`, `rank`, `opening`, `separation`; and for each contact
    its position on the surface `x1` `y1` `z1`, the outward normal there `nx1` `ny1` `nz1`,
    `distance1`, its distance from the surface before it was moved there, and `on_crease1`. Tables
    have a column `unit`. nan is written as an empty cell, in JSON as null, where infinite numbers
    are null as well. JSON and Parquet contain the settings.

    With a load also `grip_force`, `grip_force_least`, `grip_force_largest` [N], `payload` [kg] if a
    force is at hand; see `LoadResult`. `label` is that of everything stated, and `score` the one
    number by which grasps are sorted.

    Poses are written with all that is known of them, also in formats of robots, simulators and data
    sets, which need the gripper and the unit; see the page on formats of grasp poses.

    Args:
        path: File to make or replace; .csv, .parquet or .json, with poses also .yaml, .h5 or .npy.
        grasps: The grasps: with contacts, with poses that were evaluated, or poses alone.
        format: Of poses: name of a format; None: that of the suffix, of several the main one.
        metrics: Quality measures of the grasps, which become columns.
        object_pose: Of poses: the object's pose in the frame of a robot, in which files of formats
            that may have it then have poses, contacts and normals; grasp3d's own state it, and are
            read relative to the object again. A 4x4 matrix, translation in metres; a text
            'x,y,z,yaw' in metres and degrees, or a file, see `read_object_pose`. None: poses are in
            the frame of the object, or that of the file that they were read from.
        frame: Of poses: the frame of the gripper that the file is to have, as `read_grasps` takes
            it; files in json, csv and parquet state it. None: that of the format.

    Raises:
        ContactError: There is no such pose of the object.
        OutputError: No format has that suffix, it needs something that is not known, or the file
            cannot be written.
        SettingError: No format is called so, or a format of poses, but no gripper; or this format
            has the object's frame by definition.

    Example:
        >>> import trimesh
        >>> import grasp3d
        >>> box = trimesh.creation.box([0.08, 0.05, 0.03])
        >>> labels = grasp3d.label_surface(grasp3d.load_mesh(box, unit="m", max_edge=0.02))
        >>> grasp3d.write_grasps("box.csv", grasp3d.best_grasps(labels, 3))
        >>> grasp3d.read_grasps("box.csv").shape
        (3, 2, 3)
    """
    if isinstance(grasps, GraspTable):
        if any(given is not None for given in (format, object_pose, frame)):
            raise SettingError(NO_POSES)
        write_contacts(Path(path), grasps, metrics)
        return
    poses = grasps if isinstance(grasps, GraspPoses) else grasps.to_poses(metrics)
    write_poses(path, poses, format=format, object_pose=object_pose, frame=frame)


def write_poses(
    path: str | Path,
    poses: GraspPoses,
    *,
    format: str | None = None,  # noqa: A002, what it is called everywhere
    object_pose: frames.GivenPose | None = None,
    frame: frames.GivenFrame | None = None,
) -> None:
    """Write grasp poses, as `write_grasps`.

    Example:
        >>> import numpy as np
        >>> from grasp3d.formats import GraspPoses, read_poses, write_poses
        >>> from_above = GraspPoses(poses=np.diag([1.0, -1.0, -1.0, 1.0]), opening=0.05, unit="m")
        >>> write_poses("poses.csv", from_above)
        >>> read_poses("poses.csv").opening.tolist()
        [0.05]
    """
    path = Path(path)
    form = format_of(path) if format is None else format_called(format)
    if form is None:
        raise OutputError(unsupported(path, suffixes(), "pose"))
    check_suffix(path, form.suffixes, form.name)
    if not poses.count:
        raise OutputError(f"{path}: there are no poses to write")
    if object_pose is not None:
        check_frame(form)
        poses = replace(poses, object_pose=frames.read_object_pose(object_pose))
    if poses.object_pose is not None and form.moves:
        poses = poses.moved(poses.object_pose.matrix)
    given = FRAMES[form.frame] if frame is None else frames.read_frame(frame)
    poses = replace(poses, gripper_frame=given)
    try:
        form.write(path, frames.as_in_file(_of_format(poses, form)))
    except OutputError as error:
        text = str(error)
        raise OutputError(text if text.startswith(str(path)) else f"{path}: {text}") from error


def _of_format(poses: GraspPoses, form: Format) -> GraspPoses:
    """Poses as a format has them, in metres with the scale of the object's file.

    Raises:
        OutputError: There is no hand that the format has, values of its joints or outcomes are
            missing, or the unit of the poses is not known.
    """
    if missing := frames.missing_of_hand(poses.hand, form):
        raise OutputError(missing)
    if form.outcomes and len(unknown := (poses.outcome != poses.outcome).nonzero()[0]):
        raise OutputError(
            f"{form.called} files state whether each grasp held; the outcome of grasp "
            f"{unknown[0] + 1} is not known"
        )
    if form.unit == "stated":
        return poses
    if isinstance(poses.hand, ArticulatedHand):
        try:
            poses = matched(poses, poses.hand)
        except ContactError as error:
            raise OutputError(str(error)) from error
    if poses.unit is None:
        raise OutputError(
            f"{form.called} files are in metres, but the unit of the poses is not known: give the "
            "mesh's unit (--unit, in Python unit=...)"
        )
    return replace(poses.in_unit("m"), object_scale=poses.object_scale or METRES[poses.unit])


def check_hand(form: Format | None, hand: Hand) -> None:
    """Check that poses of a hand can be written in a format.

    Args:
        form: The format; None: another file.
        hand: The hand of the poses.

    Raises:
        OutputError: A library that the format needs is not installed.
        SettingError: The hand lacks what the files state.
    """
    if form is not None and form.needs:
        library(*form.needs)
    if form is not None and (missing := frames.missing_of_hand(hand, form, joints=True)):
        raise SettingError(missing)


def check_frame(form: Format | None) -> None:
    """Check that poses in a format may be in the frame of a robot. Raises SettingError.

    Args:
        form: The format; None: another file.
    """
    if form is not None and not form.moves:
        able = (name for name, one in formats().items() if one.moves)
        raise SettingError(
            f"{form.name} files have poses in the object's frame by definition; with object_pose "
            f"choose one of {', '.join(sorted(able))}"
        )
