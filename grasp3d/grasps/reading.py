"""Contacts of grasps that a user brings, from files."""

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
from grasp3d.settings import MAX_FINGERS

SUFFIXES = (".csv", ".parquet", ".json")

COLUMNS = "x1 y1 z1 x2 y2 z2 ..."
"""What columns of contacts are called, as errors say it."""

GRASPS = "a list of grasps, each a list of two or more contacts [x, y, z]"
"""What stands in a JSON file, as errors say it."""

MOST_TOLD = 12
"""Columns found in a file that an error lists."""

_COORDINATE = re.compile(r"[xyz][1-9]\d*")


def read_contacts(path: str | Path) -> Floats:
    """Read the contacts of grasps; what `write_grasps` wrote can be read back.

    CSV and Parquet have columns x1 y1 z1 x2 y2 z2 ..., a row for each grasp; other columns do not
    matter. JSON is a list of grasps, each a list of contacts [x, y, z].

    Args:
        path: File to read; .csv, .parquet or .json.

    Returns:
        Contacts in the order of the file, shape (b, n, 3) with n from 2 to 32; b at least 1.

    Raises:
        ContactError: The file is missing, or is no such list of contacts.
    """
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise ContactError(
            f"{path}: contacts are read from {', '.join(SUFFIXES)}; got {path.suffix!r}"
        )
    if not path.is_file():
        said = "is a folder; name a file" if path.is_dir() else "there is no such file"
        raise ContactError(f"{path}: {said}")
    try:
        return _from_json(path) if suffix == ".json" else _from_table(path)
    except OSError as error:
        raise ContactError(f"{path}: cannot be read ({error.strerror or error})") from error
    except (ContactError, ValueError, RecursionError) as error:
        raise ContactError(f"{path}: {error}") from error


def _from_table(path: Path) -> Floats:
    """Contacts of a CSV or Parquet file. Raises ContactError, ValueError, OSError."""
    from grasp3d.tables import read_columns

    found = read_columns(path)
    wanted = _wanted(list(found))
    columns = [_column(name, found[name]) for name in wanted]
    if not len(columns[0]):
        raise ContactError("there are no grasps in it, only the names of columns")
    return np.stack(columns, axis=1).reshape(len(columns[0]), -1, 3)


def _wanted(names: Sequence[str]) -> list[str]:
    """Columns of the contacts, in order. Raises ContactError where one is missing."""
    told = " ".join(names[:MOST_TOLD]) + (" ..." if len(names) > MOST_TOLD else "")
    numbers = [int(name[1:]) for name in names if _COORDINATE.fullmatch(name)]
    if not numbers:
        raise ContactError(f"expected columns {COLUMNS}; found {told}")
    count = min(max(numbers), MAX_FINGERS + 1)
    wanted = [f"{axis}{number}" for number in range(1, count + 1) for axis in "xyz"]
    missing = [name for name in wanted if name not in names]
    if missing:
        raise ContactError(f"column {missing[0]} is missing of {COLUMNS}; found {told}")
    _check_count(count)
    return wanted


def _check_count(count: int) -> None:
    if not 2 <= count <= MAX_FINGERS:
        told = f"more than {MAX_FINGERS}" if count > MAX_FINGERS else str(count)
        raise ContactError(f"a grasp has 2 to {MAX_FINGERS} contacts; got {told}")


def _column(name: str, values: npt.NDArray[Any]) -> Floats:
    """Finite numbers of a column. Raises ContactError."""
    numbers = np.array([_number(value) for value in values.tolist()])
    bad = np.flatnonzero(~np.isfinite(numbers))
    if len(bad):
        value = values[bad[0]]
        empty = value is None or value == "" or (isinstance(value, float) and math.isnan(value))
        said = "is empty or no number" if empty else f"is no finite number: {str(value)[:40]!r}"
        raise ContactError(f"grasp {bad[0] + 1}: {name} {said}")
    return numbers


def _number(value: object) -> float:
    """A number, or nan for whatever is none."""
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
        found = _written(found)
    if not isinstance(found, list):
        raise ContactError(f"expected {GRASPS}; found {_kind(found)}")
    if not found:
        raise ContactError("there are no grasps in it")
    rows = [_grasp(number, grasp) for number, grasp in enumerate(found, 1)]
    counts = [len(row) for row in rows]
    other = next((k for k, count in enumerate(counts) if count != counts[0]), None)
    if other is not None:
        raise ContactError(
            f"all grasps need as many contacts: grasp 1 has {counts[0]}, grasp {other + 1} has "
            f"{counts[other]}; put them into files of their own"
        )
    return np.array(rows, dtype=np.float64)


def _written(found: dict[str, Any]) -> object:
    """Contacts in what `write_grasps` wrote."""
    grasps = found.get("grasps")
    if not isinstance(grasps, list):
        raise ContactError(f"expected {GRASPS}, or under 'grasps' what was written as grasps")
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
    """What something read from JSON is, in a few characters."""
    if isinstance(value, list):
        return f"a list of {len(value)}"
    return "an object" if isinstance(value, dict) else json.dumps(value)[:40]
