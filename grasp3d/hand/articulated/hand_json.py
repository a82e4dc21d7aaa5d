"""Descriptions of hands with joints as JSON: what URDF and MuJoCo models do not say.

    {"format": "grasp3d articulated hand", "version": 1, "description": "allegro.urdf", ...}

`description` names the URDF or MuJoCo model, from the folder of the JSON file. All other keys may
be left out: `KEYS`. Angles are in radians, torques in N m, lengths in metres; joints and links are
named as the model names them.
"""

import json
import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from grasp3d.errors import SettingError
from grasp3d.hand.articulated.articulated_hand import ArticulatedHand, Coupling
from grasp3d.hand.articulated.presets import VERSION, known_numbers
from grasp3d.hand.articulated.proposal import articulated_hand_of
from grasp3d.hand.link_tree import LinkMass, LinkTree
from grasp3d.hand.robot_files import made_of
from grasp3d.system.names import unknown

Read = Callable[[Any], Any]
"""Makes what is stated of a value of JSON. Raises TypeError, ValueError: it is another one."""


def _text(value: Any) -> str:
    if not isinstance(value, str):
        raise TypeError(value)
    return value


def _number(value: Any, least: float = -math.inf, below: float = math.inf) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise TypeError(value)
    if not (math.isfinite(value) and least <= value < below):
        raise ValueError(value)
    return value


def _each(read: Read) -> Read:
    def read_list(value: Any) -> tuple[Any, ...]:
        if not isinstance(value, list):
            raise TypeError(value)
        return tuple(map(read, value))

    return read_list


def _by_name(read: Read) -> Read:
    def read_object(value: Any) -> dict[str, Any]:
        if not isinstance(value, dict):
            raise TypeError(value)
        return {name: read(one) for name, one in value.items()}

    return read_object


def _direction(value: Any) -> tuple[float, ...]:
    numbers: tuple[float, ...] = _each(_number)(value)
    if len(numbers) != 3 or not any(numbers):
        raise ValueError(value)
    return numbers


# Arguments of these are the keys of an object: others, and missing ones, raise TypeError.


def _coupling(joints: Any, ratios: Any) -> Coupling:
    names, numbers = _each(_text)(joints), _each(_number)(ratios)
    several = len(set(names)) == len(names) == len(numbers) >= 2
    if not several or not all(numbers):
        raise ValueError(joints)
    return Coupling(names, tuple(map(float, numbers)))


def _mass(mass: Any, center: Any = (0.0, 0.0, 0.0)) -> LinkMass:
    x, y, z = _each(_number)([*center])
    return LinkMass(_number(mass, math.ulp(0.0)), (x, y, z))  # the smallest number above 0


_NUMBERS = "an object of numbers by joints"
KEYS: dict[str, tuple[Read, str]] = {
    "name": (_text, "a text"),
    "description": (_text, "a text, the name of a URDF or MuJoCo file"),
    "base": (_text, "the name of a link"),
    "palm": (_text, "the name of a link"),
    "approach": (_direction, "a list of three numbers, not all 0"),
    "fingertips": (_each(_text), "a list of names of links"),
    "sensors": (
        _by_name(lambda one: _number(one, 0.0, math.pi)),
        "an object of sensor resolutions [rad] from 0 to below pi by links",
    ),
    "torques": (
        _by_name(lambda one: _number(one, 0.0)),
        f"{_NUMBERS} [N m, or N where they slide], at least 0 (0: no motor)",
    ),
    "couplings": (
        _each(lambda one: _coupling(**one)),
        'a list of objects of "joints" and the "ratios" of their values',
    ),
    "masses": (
        _by_name(lambda one: _mass(**one)),
        'an object by links of "mass" [kg] above 0 and its "center" [m], three numbers',
    ),
    "preshapes": (_by_name(_by_name(_number)), "an object of postures by name"),
    "closing": (_by_name(_number), _NUMBERS),
    "source": (_text, "a text"),
    "assumed": (_each(_text), "a list of texts"),
    "notes": (lambda value: value, "anything"),
}
"""Keys of a description besides format and version: what reads a value, and what it must be."""


def stated_of(content: Mapping[str, Any]) -> dict[str, Any]:
    """What a description in JSON states, by its keys, checked by itself.

    Raises:
        SettingError: A value is not what its key means.
    """
    if content.get("version") != VERSION or isinstance(content.get("version"), bool):
        got = json.dumps(content.get("version"))[:40]
        raise SettingError(f"version must be {VERSION}; got {got}")
    stated: dict[str, Any] = {}
    for key in (one for one in content if one not in {"format", "version"}):
        if key not in KEYS:
            raise SettingError(unknown("key", key, KEYS))
        read, expected = KEYS[key]
        try:
            stated[key] = read(content[key])
        except (TypeError, ValueError) as error:
            got = json.dumps(content[key])[:60]
            raise SettingError(f"{key} must be {expected}; got {got}") from error
    return stated


def articulated_hand(content: Mapping[str, Any]) -> ArticulatedHand:
    """The hand that a description in JSON states.

    Args:
        content: The description; `description` names the file from the working folder.

    Raises:
        SettingError: It names no such file, or none of its links and joints.
    """
    stated = stated_of(content)
    if "description" not in stated:
        raise SettingError("description is missing: the name of a URDF or MuJoCo file")
    return made_of(Path(stated["description"]), articulated_hand_of, stated)


def proposed_hand(tree: LinkTree, palm: str | None) -> ArticulatedHand:
    """A hand from its links and joints alone; with the numbers of one whose joints it has.

    Args:
        tree: Links and joints.
        palm: Name of the palm's link; None: it is found.

    Raises:
        SettingError: They are of no hand with joints.
    """
    content = known_numbers(tree)
    stated = {} if content is None else stated_of(content)
    if content is not None:
        name = content["name"]
        stated["assumed"] = [f"it is the hand {name}, whose joints have the same names"]
    if palm is not None:
        stated["palm"] = palm
    return articulated_hand_of(tree, stated)
