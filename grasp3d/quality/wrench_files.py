"""Files of wrenches."""

import csv
import math
from collections.abc import Iterator
from pathlib import Path

from grasp3d.errors import SettingError
from grasp3d.system.names import printable

Row = tuple[float, ...]

COLUMNS = ("fx", "fy", "fz", "tx", "ty", "tz")
"""Columns of a file of wrenches."""

MAX_WRENCHES = 200
"""Most wrenches of a text or file: the header of a PLY states them."""

LARGEST_FILE = 2**20
"""Bytes of the largest file of wrenches."""


def read_wrenches(path: Path) -> tuple[Row, ...]:
    """Read a file of wrenches.

    Args:
        path: CSV of six columns: force [N] and torque about the centre of mass [N m]; a first line
            of names is optional, lines that begin with # are comments.

    Returns:
        Rows of six finite numbers, shape (k, 6).

    Raises:
        SettingError: It is missing, or no such file.
    """
    name = printable(str(path))
    try:
        if path.stat().st_size > LARGEST_FILE:
            raise SettingError(f"{name}: is too large for a file of {MAX_WRENCHES} wrenches")
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    except UnicodeDecodeError as error:
        raise SettingError(f"{name}: is not a text file of wrenches") from error
    except OSError as error:
        raise SettingError(f"{name}: cannot be read ({error.strerror})") from error
    rows = tuple(_rows(name, lines))
    if not 1 <= len(rows) <= MAX_WRENCHES:
        raise SettingError(
            f"{name}: must hold from 1 to {MAX_WRENCHES} wrenches, one a line; got {len(rows)}"
        )
    return rows


def _rows(name: str, lines: list[str]) -> Iterator[Row]:
    """Rows of a file; raises SettingError."""
    first = True
    for number, line in enumerate(lines, 1):
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        words = _words(name, number, line)
        if first and tuple(word.lower() for word in words) == COLUMNS:
            first = False
            continue
        first = False
        if len(words) != len(COLUMNS):
            raise SettingError(
                f"{name}: line {number} has {len(words)} columns; a wrench has six, "
                f"{', '.join(COLUMNS)}: force [N] and torque [N m]"
            )
        yield _row(name, number, words)


def _words(name: str, number: int, line: str) -> list[str]:
    try:
        return [word.strip() for word in next(csv.reader([line]))]
    except csv.Error as error:
        raise SettingError(
            f"{name}: line {number} must be six numbers, {', '.join(COLUMNS)}: {error}"
        ) from error


def _row(name: str, number: int, words: list[str]) -> Row:
    try:
        row = tuple(map(float, words))
    except ValueError as error:
        raise SettingError(
            f"{name}: line {number} must be six numbers, {', '.join(COLUMNS)}: {error}"
        ) from error
    if not all(map(math.isfinite, row)):
        raise SettingError(f"{name}: line {number} has a number that is not finite")
    return row
