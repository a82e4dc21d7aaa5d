"""Parallel grippers as JSON."""

import json
from collections.abc import Mapping
from dataclasses import MISSING, fields
from pathlib import Path
from typing import Any, get_type_hints

from grasp3d.errors import SettingError
from grasp3d.hand.jaws import Corners
from grasp3d.system.documents import load_json, typed
from grasp3d.system.limited_reading import read_file
from grasp3d.system.names import printable, unknown

FORMAT, VERSION = "grasp3d gripper", 1
"""What the keys `format` and `version` of a file contain."""

KEYS = ("format", "version", "unit")
"""Keys that files have besides the fields of a gripper; people may leave them out."""

NOTES = "notes"
"""Key of what only people read, such as where lengths come from; any JSON."""

_KINDS: dict[Any, str] = {
    str: "a text",
    float: "a number",
    float | None: "a number or null",
    tuple[str, ...]: "a list of texts",
    tuple[str, str]: "a list of two texts",
    tuple[float, ...]: "a list of numbers",
    tuple[Corners, ...]: "a list of faces, each a list of corners [x, y, z]",
}
"""Descriptions of the types of fields."""


def fields_in_json(content: Mapping[str, Any], kind: type) -> dict[str, Any]:
    """The fields of a gripper from the content of a JSON file.

    Args:
        content: The content, an object of the format of grippers.
        kind: Dataclass of the gripper.

    Raises:
        SettingError: It is not the description of a gripper.
    """
    for key, value in (("version", VERSION), ("unit", "m")):
        stated = content.get(key, value)
        if stated != value or isinstance(stated, bool):
            got = json.dumps(stated)[:40]
            raise SettingError(f"{key} must be {json.dumps(value)}; got {got}")
    known = {field.name: field for field in fields(kind)}
    for key in (one for one in content if one not in {*KEYS, NOTES, *known}):
        raise SettingError(unknown("field", key, known))
    missing = [
        name for name, field in known.items() if field.default is MISSING and name not in content
    ]
    if missing:
        raise SettingError(f"{', '.join(missing)} missing; every gripper needs it")
    kinds = get_type_hints(kind)
    return {name: _typed(name, content[name], kinds[name]) for name in known if name in content}


def read_json(path: Path) -> object:
    """The content of a JSON file of a hand. Raises SettingError."""
    try:
        return read_file(_content, path)
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise SettingError(printable(f"{path}: {reason}")) from error


def _content(path: Path) -> object:
    return load_json(path, finite=True)


def _typed(name: str, value: object, kind: Any) -> Any:
    """A value in the type of its field. Raises SettingError."""
    try:
        return typed(value, kind)
    except TypeError as error:
        got = json.dumps(value)[:40]
        raise SettingError(f"{name} must be {_KINDS[kind]}; got {got}") from error
