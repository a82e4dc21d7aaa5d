"""Contacts of grasps in files: JSON, CSV and Parquet."""

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from grasp3d.arrays import Floats
from grasp3d.errors import ContactError
from grasp3d.formats import checks
from grasp3d.formats.own import OBJECT, stacked, stated_in, stated_unit
from grasp3d.mesh.object_mesh import scale_of
from grasp3d.settings import MAX_FINGERS
from grasp3d.settings.units import Unit
from grasp3d.surface.grasp_table import GraspTable
from grasp3d.system.documents import load_json
from grasp3d.system.files import check_suffix
from grasp3d.system.limited_reading import read_file
from grasp3d.system.names import unsupported

SUFFIXES = (".csv", ".parquet", ".json")

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
    with checks.reading(Path(path)):
        return np.asarray(contacts * scale_of(stated_unit(stated, unit)))


def contacts_in(path: Path) -> tuple[Floats, Unit | None]:
    """The contacts in a file as it has them, and the unit that it states; see `read_contacts`."""
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise ContactError(unsupported(path, SUFFIXES, "contacts"))
    with checks.reading(path):
        points, stated = read_file(_from_json if suffix == ".json" else _from_table, path)
        if (frame := stated.get("frame")) not in OBJECT:
            raise ContactError(f"its contacts are in the frame {str(frame)!r}; known: 'object'")
        if not len(points):
            raise ContactError("there are no grasps in it, only column names")
        if not 2 <= points.shape[1] <= MAX_FINGERS:
            raise ContactError(f"a grasp has 2 to {MAX_FINGERS} contacts; got {points.shape[1]}")
        if len(bad := np.argwhere(~np.isfinite(points))):
            raise ContactError(f"grasp {bad[0, 0] + 1}: contact {bad[0, 1] + 1} is not finite")
        return points, stated_unit(stated.get("unit"), None)


def _from_table(path: Path) -> tuple[Floats, Mapping[str, Any]]:
    """Contacts of a table, and what it states. Raises ContactError, ValueError, OSError."""
    from grasp3d.system.tables import read_columns

    table = read_columns(path)
    numbers = [int(name[1:]) for name in table if _COORDINATE.fullmatch(name)]
    count = min(max(numbers, default=2), MAX_FINGERS + 1)
    required = [f"{axis}{number}" for number in range(1, count + 1) for axis in "xyz"]
    points = stacked(table, required, " of x1 y1 z1 x2 y2 z2 ...").reshape(-1, count, 3)
    stated: dict[str, Any] = {name: table[name] for name in ("unit", "frame") if name in table}
    return points, stated_in(stated) if len(points) else {}


def _from_json(path: Path) -> tuple[Floats, Mapping[str, Any]]:
    """Contacts of a JSON file, and what it states. Raises ContactError, ValueError, OSError."""
    content = load_json(path)
    stated = content if isinstance(content, dict) else {}
    listed = stated.get("grasps") if stated else content
    rows = checks.grasp_list(listed, "its grasps, each a list of contacts [x, y, z],")

    def plain(value: Any, key: str) -> Any:  # of a file that write_grasps wrote
        return value.get(key, value) if isinstance(value, dict) else value

    rows = [plain(row, "contacts") for row in rows]
    grasps = [[plain(c, "point") for c in row] if isinstance(row, list) else row for row in rows]
    count = len(grasps[0]) if isinstance(grasps[0], list) else 0
    points = checks.numbers(grasps, (count, 3), "its contacts, as many as of grasp 1,")
    header = stated.get("grasp3d")
    return points, header if isinstance(header, dict) else stated


def write_contacts(path: Path, grasps: GraspTable, metrics: Mapping[str, Floats] | None) -> None:
    """Write grasps with contacts; see `write_grasps`. Raises OutputError."""
    check_suffix(path, SUFFIXES, "table")
    settings = grasps.settings()
    if path.suffix.lower() != ".json":
        from grasp3d.system.tables import write_columns

        write_columns(path, grasps.table_columns(metrics), settings=settings)
        return
    columns = {name: checks.json_values(one) for name, one in grasps.columns(metrics).items()}
    contacts = {field.name: values for field, values in grasps.contact_values()}
    columns["contacts"] = checks.nested(contacts)
    header = {name: checks.json_values(np.array(one)) for name, one in settings.items()}
    checks.write_rows(path, header, columns)
