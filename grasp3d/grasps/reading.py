"""Reading of grasps' contacts from files."""

import json
import math
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from grasp3d.arrays import Floats
from grasp3d.errors import ContactError
from grasp3d.grasps.pose_files import holds_poses, read_poses
from grasp3d.grasps.poses import GraspPoses
from grasp3d.hand.hand import Hand
from grasp3d.settings import MAX_FINGERS, PoseFormat
from grasp3d.settings.lengths import Unit
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
    format: PoseFormat | None = None,  # noqa: A002, what it is called everywhere
    hand: Hand | None = None,
    unit: Unit | None = None,
) -> GraspPoses | Floats:
    """Read grasps from files of grasp3d, robots, simulators and data sets: poses or contacts.

    Which of the two a file contains is found from its name and content. Contacts: CSV and Parquet
    have columns x1 y1 z1 x2 y2 z2 ..., a row for each grasp; other columns are ignored. JSON is a
    list of grasps, each a list of contacts [x, y, z]. Poses are those of the TCP, whatever frame
    the file has; see `GraspPoses`.

    Args:
        path: File to read.
        format: Of poses: one of those of `write_grasps`; None: found from the suffix and the
            content.
        hand: The gripper that the poses are of; formats with the pose of the hand's base
            (isaac_grasp, graspgen, graspnet, moveit) need it.
        unit: Unit of the lengths of poses, for files that state none; formats of robots are in
            metres.

    Returns:
        The poses; or contacts in the order of the file, shape (b, n, 3) with n from 2 to 32; b at
        least 1. `evaluate_grasps` takes both.

    Raises:
        ContactError: The file is missing, or contains no grasps.
        OutputError: A library that reads the format is not installed.
        SettingError: No format is called so.

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
    if format is not None or holds_poses(path):
        return read_poses(path, format=format, hand=hand, unit=unit)
    return read_contacts(path)


def read_contacts(path: str | Path) -> Floats:
    """Read the contacts of grasps, see `read_grasps`; also from files that `write_grasps` wrote.

    CSV and Parquet have columns x1 y1 z1 x2 y2 z2 ..., a row for each grasp; other columns are
    ignored. JSON is a list of grasps, each a list of contacts [x, y, z].

    Args:
        path: File to read; .csv, .parquet or .json.

    Returns:
        Contacts in the order of the file, shape (b, n, 3) with n from 2 to 32; b at least 1.

    Raises:
        ContactError: The file is missing, or contains no such contacts.
    """
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise ContactError(unsupported(path, SUFFIXES, "contacts"))
    if not path.is_file():
        problem = "is a folder; name a file" if path.is_dir() else "there is no such file"
        raise ContactError(f"{path}: {problem}")
    try:
        return _from_json(path) if suffix == ".json" else _from_table(path)
    except OSError as error:
        raise ContactError(f"{path}: cannot be read ({error.strerror or error})") from error
    except (ContactError, ValueError, RecursionError) as error:
        raise ContactError(f"{path}: {error}") from error


def _from_table(path: Path) -> Floats:
    """Contacts of a CSV or Parquet file. Raises ContactError, ValueError, OSError."""
    from grasp3d.system.tables import read_columns

    found = read_columns(path)
    columns = [_column(name, found[name]) for name in _coordinate_columns(list(found))]
    if not len(columns[0]):
        raise ContactError("there are no grasps in it, only column names")
    return np.stack(columns, axis=1).reshape(len(columns[0]), -1, 3)


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
    numbers = np.array([_number(value) for value in values.tolist()])
    bad = np.flatnonzero(~np.isfinite(numbers))
    if len(bad):
        value = values[bad[0]]
        empty = value is None or value == "" or (isinstance(value, float) and math.isnan(value))
        problem = "is empty or no number" if empty else f"is no finite number: {str(value)[:40]!r}"
        raise ContactError(f"grasp {bad[0] + 1}: {name} {problem}")
    return numbers


def _number(value: object) -> float:
    """The number that a value is or spells, nan if none."""
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        return math.nan
    try:
        return float(value)
    except (ValueError, OverflowError):
        return math.nan


def _from_json(path: Path) -> Floats:
    """Contacts of a JSON file. Raises ContactError, ValueError, OSError, RecursionError."""
    try:
        found = json.loads(path.read_text(encoding="utf-8-sig"))
    except json.JSONDecodeError as error:
        raise ContactError(f"is no JSON: {error}") from error
    if isinstance(found, dict):
        found = _from_written(found)
    if not isinstance(found, list):
        raise ContactError(f"expected {GRASPS}; found {_kind(found)}")
    if not found:
        raise ContactError("there are no grasps in it")
    rows = [_grasp(number, grasp) for number, grasp in enumerate(found, 1)]
    counts = [len(row) for row in rows]
    other = next((k for k, count in enumerate(counts) if count != counts[0]), None)
    if other is not None:
        raise ContactError(
            f"all grasps need the same number of contacts: grasp 1 has {counts[0]}, grasp "
            f"{other + 1} has {counts[other]}; put them into separate files"
        )
    return np.array(rows, dtype=np.float64)


def _from_written(found: dict[str, Any]) -> object:
    """Contacts in a file that `write_grasps` wrote."""
    grasps = found.get("grasps")
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
        raise ContactError(f"grasp {number}: expected a list of contacts; found {_kind(grasp)}")
    for which, contact in enumerate(grasp, 1):
        if not isinstance(contact, list) or len(contact) != 3:
            raise ContactError(
                f"grasp {number}, contact {which}: expected [x, y, z]; found {_kind(contact)}"
            )
        for value in contact:
            if isinstance(value, str) or not math.isfinite(_number(value)):
                raise ContactError(
                    f"grasp {number}, contact {which}: {json.dumps(value)[:40]} is no finite number"
                )
    try:
        _check_count(len(grasp))
    except ContactError as error:
        raise ContactError(f"grasp {number}: {error}") from error
    return grasp


def _kind(value: object) -> str:
    """Short description of a value read from JSON."""
    if isinstance(value, list):
        return f"a list of {len(value)}"
    return "an object" if isinstance(value, dict) else json.dumps(value)[:40]
