"""The journal: JSON files with rows that are not in the summary yet and survive a crash."""

import json
import re
from collections.abc import Mapping
from dataclasses import dataclass, field, is_dataclass, replace
from enum import StrEnum
from functools import cache
from types import NoneType
from typing import Any, get_args, get_origin, get_type_hints

from grasp3d.batch.row import Row
from grasp3d.system.names import as_unicode

FOLDER = "journal"

NAME = re.compile(r"journal/[0-9a-f]{8}-\d{8,}\.json")
"""Names of the journal's files."""


@dataclass(frozen=True)
class JournalEntry:
    """One file of the journal."""

    rows: tuple[Row, ...] = ()
    """Rows to be put into the summary."""
    to_replace: Mapping[str, Mapping[str, str]] = field(default_factory=dict)
    """Rows of the summary that a run is about to replace, by the name of their mesh: the state of
    their result files before the run, according to the file system."""


def pack_entry(entry: JournalEntry) -> bytes:
    """Write an entry as JSON."""
    # The fields of nested dataclasses, without the copies that `asdict` makes of all values.
    return json.dumps(vars(entry), default=vars).encode()


def unpack_entry(data: bytes) -> JournalEntry:
    """Read an entry.

    Raises:
        ValueError: The data are damaged.
    """
    try:
        values = json.loads(data)
        rows = tuple(_converted(Row, row) for row in values["rows"])
        to_replace = {
            str(name): {str(file): str(stamp) for file, stamp in stamps.items()}
            for name, stamps in values["to_replace"].items()
        }
    except (AttributeError, KeyError, TypeError, RecursionError) as error:
        raise ValueError(str(error)) from error
    return JournalEntry(rows, to_replace)


def in_unicode(row: Row) -> Row:
    """A row as tables can hold it: bytes of file names that are not Unicode are escaped."""
    text: dict[str, Any] = {
        name: as_unicode(value)
        for name, value in vars(row).items()
        if type(value) is str and not value.isascii()
    }
    return replace(row, **text) if text else row


def _converted(hint: Any, value: Any) -> Any:
    """Convert a JSON value to a type hint.

    Raises:
        TypeError: The value is of another type.
    """
    kinds = [each for each in get_args(hint) if each is not NoneType]
    if get_origin(hint) is tuple:
        return tuple(_converted(kinds[0], item) for item in value)
    if kinds:  # a field that may be none
        return None if value is None else _converted(kinds[0], value)
    if is_dataclass(hint):
        hints = _hints(hint)  # type: ignore[arg-type]
        fields = {
            name: _converted(hints[name], item) for name, item in value.items() if name in hints
        }
        return hint(**fields)  # type: ignore[operator]
    if issubclass(hint, StrEnum):
        return hint(value)
    if hint is float and type(value) is int:
        return float(value)
    if type(value) is not hint:
        raise TypeError(f"{value!r:.50} is not of type {hint.__name__}")
    return value


@cache
def _hints(kind: Any) -> dict[str, Any]:
    return get_type_hints(kind)
