"""Contacts of grasps in files: JSON, CSV and Parquet."""

import json
import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from grasp3d.arrays import Floats
from grasp3d.errors import ContactError
from grasp3d.formats.own import OBJECT, stated_unit
from grasp3d.formats.values import (
    check_file,
    json_numbers,
    json_text,
    one_line,
    rows_of,
    write_rows,
)
from grasp3d.mesh.object_mesh import scale_of
from grasp3d.settings import MAX_FINGERS
from grasp3d.settings.units import Unit
from grasp3d.surface.grasp_table import GraspTable
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


def _check_frame(frames: Iterable[object]) -> None:
    """Refuse contacts that are in another frame than that of the object. Raises ContactError."""
    if others := [frame for frame in frames if frame not in OBJECT]:
        raise ContactError(f"its contacts are in the frame {str(others[0])!r}; known: 'object'")


def _from_table(path: Path) -> tuple[Floats, Any]:
    """Contacts of a table, and their unit. Raises ContactError, ValueError, OSError."""
    from grasp3d.system.tables import read_columns

    table = read_columns(path)
    required = _coordinate_columns(list(table))
    _check_frame(set(table.get("frame", ())))
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
        _check_frame([content.get("frame")])
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


def write_contacts(path: Path, grasps: GraspTable, metrics: Mapping[str, Floats] | None) -> None:
    """Write grasps with contacts; see `write_grasps`. Raises OutputError."""
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
