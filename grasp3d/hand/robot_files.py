"""Read files of hands: JSON, and URDF and MuJoCo models."""

import json
from collections.abc import Callable, Collection, Mapping
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from grasp3d.errors import SettingError
from grasp3d.system.documents import load_json, problem_of_file
from grasp3d.system.limited_reading import read_file
from grasp3d.system.names import printable, unknown

FORMAT, VERSION = "grasp3d articulated hand", 1
"""Values of the keys `format` and `version` in the JSON of a hand with joints."""

NAMES = ("allegro", "leap", "shadow", "barrett")
"""Names of known hands; their JSON files have notes on where the numbers come from."""

SUFFIXES = (".urdf", ".xml", ".mjcf")

T = TypeVar("T")


def made_of(path: Path, make: Callable[..., T], *arguments: Any) -> T:
    """Read a robot's description and return what a function makes of it.

    Args:
        path: The file.
        make: A function of a `LinkTree` and the other arguments.
        arguments: The other arguments.

    Raises:
        SettingError: The file cannot be read, or the function refuses it.
        FileUnreadError: Reading is limited, and it exceeded a limit.
    """
    if problem := problem_of_file(path):
        raise SettingError(printable(f"{path}: {problem}"))
    if path.suffix.lower() not in SUFFIXES:
        known = " ".join(SUFFIXES)
        raise SettingError(printable(f"{path} is not a URDF or MuJoCo model; known are {known}"))
    made: T = read_file(_make, path, make, *arguments)
    return made


def _make(path: Path, make: Callable[..., T], *arguments: Any) -> T:
    from grasp3d.hand.mujoco_model import read_links  # slow to import

    with np.errstate(over="ignore", invalid="ignore"):  # lengths that are refused
        return make(read_links(path), *arguments)


def check_keys(content: Mapping[str, Any], known: Collection[str], **fixed: str | int) -> None:
    """Raise SettingError for unknown keys of JSON, or fixed keys with another value.

    The key notes may hold any JSON, for people only, such as where lengths come from.

    Raises:
        SettingError: There is such a key.
    """
    for key, value in content.items():
        if key in fixed and (value != fixed[key] or isinstance(value, bool)):
            expected, got = json.dumps(fixed[key]), json.dumps(value)[:40]
            raise SettingError(f"{key} must be {expected}; got {got}")
        if key not in {"format", "notes", *fixed, *known}:
            raise SettingError(unknown("key", key, known))


def read_json(path: Path) -> Any:
    """The content of a JSON file of a hand. Raises SettingError."""
    try:
        return read_file(partial(load_json, finite=True), path)
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise SettingError(printable(f"{path}: {reason}")) from error
