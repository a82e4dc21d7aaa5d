"""Files of grasps: their contacts read, labels and epsilon written."""

import json
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from grasp3d.arrays import Floats
from grasp3d.errors import ContactError, SettingError
from grasp3d.grasps.evaluated_poses import EvaluatedPoses
from grasp3d.grasps.pose_files import holds_poses, read_poses, write_poses
from grasp3d.grasps.pose_files.documents import (
    check_file,
    json_numbers,
    json_text,
    one_line,
    rows_of,
    write_rows,
)
from grasp3d.grasps.pose_files.frames import (
    GivenFrame,
    GivenPose,
    check_object_frame,
    stated_unit,
)
from grasp3d.grasps.poses import GraspPoses
from grasp3d.hand.hand import Hand
from grasp3d.mesh.object_mesh import scale_of
from grasp3d.settings import MAX_FINGERS, PoseFormat
from grasp3d.settings.units import Unit
from grasp3d.surface.grasp_table import NO_POSES, GraspTable
from grasp3d.system.documents import described, load_json, number_of
from grasp3d.system.files import check_suffix
from grasp3d.system.limited_reading import read_file
from grasp3d.system.names import unsupported

SUFFIXES = (".csv", ".parquet", ".json")

COLUMNS = "x1 y1 z1 x2 y2 z2 ..."
"""Names of the columns, for error messages."""

GRASPS = "a list of grasps, each a list of two or more contacts [x, y, z]"
"""Content of a JSON file, for error messages."""

MAX_LISTED = 12
"""Most columns of a file that an error message lists."""

_COORDINATE = re.compile(r"[xyz][1-9]\d*")


def read_grasps(
    path: str | Path,
    *,
    hand: Hand | None = None,
    unit: Unit | None = None,
    object_pose: GivenPose | None = None,
    frame: GivenFrame | None = None,
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
        hand: The gripper that the poses are of; formats with the pose of the hand's base (all but
            json, csv, parquet and acronym) need it.
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


def read_contacts(path: str | Path, *, unit: Unit | None = None) -> Floats:
    """Read the contacts of grasps, see `read_grasps`; also from files that `write_grasps` wrote.

    CSV and Parquet have columns x1 y1 z1 x2 y2 z2 ..., a row for each grasp; other columns are
    ignored. JSON is a list of grasps, each a list of contacts [x, y, z].

    Args:
        path: File to read; .csv, .parquet or .json.
        unit: Unit of the coordinates, if the file states none.

    Returns:
        Contacts in the order of the file, shape (b, n, 3) with n from 2 to 32; b at least 1. In
        metres, or as in the file where no unit is known.

    Raises:
        ContactError: The file is missing, or contains no such contacts.
    """
    contacts, stated = contacts_in(Path(path))
    try:
        return np.asarray(contacts * scale_of(stated_unit(stated, unit)))
    except ContactError as error:
        raise one_line(Path(path), str(error)) from error


def contacts_in(path: Path) -> tuple[Floats, Unit | None]:
    """The contacts in a file as it has them, and the unit that it states; see `read_contacts`."""
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise ContactError(unsupported(path, SUFFIXES, "contacts"))
    check_file(path)
    try:
        contacts, unit = read_file(_from_json if suffix == ".json" else _from_table, path)
        return contacts, stated_unit(unit, None)
    except OSError as error:
        raise one_line(path, f"cannot be read ({error.strerror or error})") from error
    except (ContactError, ValueError) as error:
        raise one_line(path, str(error)) from error


def _from_table(path: Path) -> tuple[Floats, Any]:
    """Contacts of a table, and their unit. Raises ContactError, ValueError, OSError."""
    from grasp3d.system.tables import read_columns

    table = read_columns(path)
    required = _coordinate_columns(list(table))
    check_object_frame(set(table.get("frame", ())))
    columns = [_column(name, table[name]) for name in required]
    if not len(columns[0]):
        raise ContactError("there are no grasps in it, only column names")
    units = {one or "" for one in table.get("unit", ())}  # None: an empty cell
    if len(units) > 1:
        raise ContactError("its contacts are in several units; put them into separate files")
    points = np.stack(columns, axis=1).reshape(-1, len(required) // 3, 3)
    return points, next(map(str, units), None)


def _coordinate_columns(names: Sequence[str]) -> list[str]:
    """Names of the contacts' columns, in order. Raises ContactError if one is missing."""
    listed = " ".join(names[:MAX_LISTED]) + (" ..." if len(names) > MAX_LISTED else "")
    numbers = [int(name[1:]) for name in names if _COORDINATE.fullmatch(name)]
    if not numbers:
        raise ContactError(f"expected columns {COLUMNS}; found {listed}")
    count = min(max(numbers), MAX_FINGERS + 1)
    required = [f"{axis}{number}" for number in range(1, count + 1) for axis in "xyz"]
    missing = [name for name in required if name not in names]
    if missing:
        raise ContactError(f"column {missing[0]} is missing of {COLUMNS}; found {listed}")
    _check_count(count)
    return required


def _check_count(count: int) -> None:
    if not 2 <= count <= MAX_FINGERS:
        number = f"more than {MAX_FINGERS}" if count > MAX_FINGERS else str(count)
        raise ContactError(f"a grasp has 2 to {MAX_FINGERS} contacts; got {number}")


def _column(name: str, values: npt.NDArray[Any]) -> Floats:
    """Finite numbers of a column. Raises ContactError."""
    is_plain = values.dtype.kind in "fiu"
    numbers = (
        values.astype(np.float64)
        if is_plain
        else np.array([number_of(value) for value in values.tolist()])
    )
    bad = np.flatnonzero(~np.isfinite(numbers))
    if len(bad):
        value = values[bad[0]]
        empty = value is None or value == "" or (isinstance(value, float) and math.isnan(value))
        problem = "is empty or no number" if empty else f"is no finite number: {str(value)[:40]!r}"
        raise ContactError(f"grasp {bad[0] + 1}: {name} {problem}")
    return numbers


def _from_json(path: Path) -> tuple[Floats, Any]:
    """Contacts of a JSON file, and their unit. Raises ContactError, ValueError, OSError."""
    content, unit = load_json(path), None
    if isinstance(content, dict):
        check_object_frame([content.get("frame")])
        header = content.get("grasp3d")
        unit = header.get("unit") if isinstance(header, dict) else content.get("unit")
        content = _from_written(content)
    if not isinstance(content, list):
        raise ContactError(f"expected {GRASPS}; found {described(content)}")
    if not content:
        raise ContactError("there are no grasps in it")
    rows = [_grasp(number, grasp) for number, grasp in enumerate(content, 1)]
    counts = [len(row) for row in rows]
    other = next((k for k, count in enumerate(counts) if count != counts[0]), None)
    if other is not None:
        raise ContactError(
            f"all grasps need the same number of contacts: grasp 1 has {counts[0]}, grasp "
            f"{other + 1} has {counts[other]}; put them into separate files"
        )
    return np.array(rows, dtype=np.float64), unit


def _from_written(content: dict[str, Any]) -> object:
    """Contacts in a file that `write_grasps` wrote."""
    grasps = content.get("grasps")
    if not isinstance(grasps, list):
        raise ContactError(f"expected {GRASPS}, or a file that write_grasps wrote")
    return [
        [
            contact.get("point") if isinstance(contact, dict) else contact
            for contact in grasp["contacts"]
        ]
        if isinstance(grasp, dict) and isinstance(grasp.get("contacts"), list)
        else grasp
        for grasp in grasps
    ]


def _grasp(number: int, grasp: object) -> list[list[float]]:
    """Contacts of one grasp, counted from 1. Raises ContactError."""
    if not isinstance(grasp, list):
        raise ContactError(f"grasp {number}: expected a list of contacts; found {described(grasp)}")
    for which, contact in enumerate(grasp, 1):
        if not isinstance(contact, list) or len(contact) != 3:
            raise ContactError(
                f"grasp {number}, contact {which}: expected [x, y, z]; found {described(contact)}"
            )
        for value in contact:
            if isinstance(value, str) or not math.isfinite(number_of(value)):
                raise ContactError(
                    f"grasp {number}, contact {which}: {json.dumps(value)[:40]} is no finite number"
                )
    try:
        _check_count(len(grasp))
    except ContactError as error:
        raise ContactError(f"grasp {number}: {error}") from error
    return grasp


def write_grasps(
    path: str | Path,
    grasps: GraspTable | EvaluatedPoses | GraspPoses,
    *,
    format: PoseFormat | None = None,  # noqa: A002, what it is called everywhere
    metrics: Mapping[str, Floats] | None = None,
    object_pose: GivenPose | None = None,
    frame: GivenFrame | None = None,
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

    Poses are written with all that is known of them, also in formats of robots and
    simulators: isaac_grasp (.yaml), acronym (.h5), graspnet (.npy), graspgen or moveit (.json); of
    hands with joints isaac_grasp, dexgraspbench or dexgraspnet (.npy). These need the gripper and
    the unit.

    Args:
        path: File to make or replace; .csv, .parquet or .json, with poses also .yaml, .h5 or .npy.
        grasps: The grasps: with contacts, with poses that were evaluated, or poses alone.
        format: Of poses: json, csv, parquet or one of those; None: that of the suffix, json for
            .json, isaac_grasp for .yaml, graspnet for .npy.
        metrics: Quality measures of the grasps, which become columns.
        object_pose: Of poses: the object's pose in the frame of a robot, in which json, csv,
            parquet and moveit then have poses, contacts and normals; the first three state it,
            and are read relative to the object again. A 4x4 matrix, translation in metres; a text
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
    path = Path(path)
    if isinstance(grasps, EvaluatedPoses):
        grasps = grasps.to_poses(metrics)
    posed = any(given is not None for given in (format, object_pose, frame))
    if isinstance(grasps, GraspTable) and posed:
        raise SettingError(NO_POSES)
    if isinstance(grasps, GraspPoses):
        write_poses(path, grasps, format=format, object_pose=object_pose, frame=frame)
        return
    check_suffix(path, SUFFIXES, "table")
    settings = grasps.settings()
    if path.suffix.lower() == ".json":
        header = json_text({key: _or_null(value) for key, value in settings.items()})
        write_rows(path, header, _json_rows(grasps, metrics))
        return
    from grasp3d.system.tables import write_columns

    write_columns(path, grasps.table_columns(metrics), settings=settings)


def _json_rows(
    grasps: GraspTable, metrics: Mapping[str, Floats] | None
) -> Iterator[dict[str, Any]]:
    """An entry for each grasp; what is not finite is null."""
    columns = {name: json_numbers(values) for name, values in grasps.columns(metrics).items()}
    contacts = {field.name: json_numbers(values) for field, values in grasps.contact_values()}
    columns["contacts"] = [
        [
            {name: values[row][number] for name, values in contacts.items()}
            for number in range(grasps.contacts.count)
        ]
        for row in range(grasps.size)
    ]
    return rows_of(columns, grasps.size)


def _or_null(value: Any) -> Any:
    return None if isinstance(value, float) and not math.isfinite(value) else value
