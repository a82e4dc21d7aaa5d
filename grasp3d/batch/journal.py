"""Rows that are not yet in the summary: files of JSON that survive the death of their writer."""

import json
import re
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, is_dataclass, replace
from enum import StrEnum
from functools import cache
from types import NoneType
from typing import Any, get_args, get_origin, get_type_hints

from grasp3d.batch.row import Row
from grasp3d.system.names import as_unicode

FOLDER = "journal"

NAME = re.compile(r"journal/[0-9a-f]{8}-\d{8,}\.json")
"""What its files are called."""


@dataclass(frozen=True)
class Note:
    """One file of the journal."""

    rows: tuple[Row, ...] = ()
    """Rows to be put into the summary."""
    doubted: Mapping[str, Mapping[str, str]] = field(default_factory=dict)
    """Rows of the summary whose results may be overwritten soon, by the name of their mesh: what
    the file system said of the results when they still held."""


def pack_note(note: Note) -> bytes:
    """Write a note as JSON."""
    return json.dumps(asdict(note)).encode()


def unpack_note(data: bytes) -> Note:
    """Read a note.

    Raises:
        ValueError: It is damaged.
    """
    try:
        told = json.loads(data)
        rows = tuple(_made(Row, row) for row in told["rows"])
        doubted = {
            str(name): {str(file): str(stamp) for file, stamp in stamps.items()}
            for name, stamps in told["doubted"].items()
        }
    except (AttributeError, KeyError, TypeError, RecursionError) as error:
        raise ValueError(str(error)) from error
    return Note(rows, doubted)


def plain(row: Row) -> Row:
    """A row as tables can hold it: bytes of file names that are no Unicode are written out."""
    text: dict[str, Any] = {
        name: as_unicode(value)
        for name, value in vars(row).items()
        if type(value) is str and not value.isascii()
    }
    return replace(row, **text) if text else row


def _made(hint: Any, value: Any) -> Any:  # noqa: ANN401
    """Make of JSON what a type hint says.

    Raises:
        TypeError: It is something else.
    """
    kinds = [each for each in get_args(hint) if each is not NoneType]
    if get_origin(hint) is tuple:
        return tuple(_made(kinds[0], item) for item in value)
    if kinds:  # a field that may be none
        return None if value is None else _made(kinds[0], value)
    if is_dataclass(hint):
        hints = _hints(hint)  # type: ignore[arg-type]
        known = {name: _made(hints[name], item) for name, item in value.items() if name in hints}
        return hint(**known)  # type: ignore[operator]
    if issubclass(hint, StrEnum):
        return hint(value)
    if hint is float and type(value) is int:
        return float(value)
    if type(value) is not hint:
        raise TypeError(f"{value!r:.50} is no {hint.__name__}")
    return value


@cache
def _hints(kind: Any) -> dict[str, Any]:  # noqa: ANN401
    return get_type_hints(kind)
