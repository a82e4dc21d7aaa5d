"""JSON descriptions of hands with joints: what URDF and MuJoCo models do not state.

    {"format": "grasp3d articulated hand", "version": 1, "description": "allegro.urdf", ...}

`description` is the path of the URDF or MuJoCo model, relative to the folder of the JSON file. All
other keys (`KEYS`) are optional. Angles are in radians, torques in N m, lengths in metres; joints
and links have the names of the model.
"""

import json
import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from grasp3d.errors import SettingError
from grasp3d.hand.articulated_hand import ArticulatedHand, Coupling
from grasp3d.hand.link_tree import LinkMass, LinkTree
from grasp3d.hand.proposal import articulated_hand_of
from grasp3d.hand.robot_files import NAMES, VERSION, check_keys, made_of, read_json
from grasp3d.system.documents import typed

FOLDER = Path(__file__).with_name("presets")


def known_numbers(tree: LinkTree) -> dict[str, Any] | None:
    """The description of a known hand, with the names that a file uses for links and joints.

    Args:
        tree: Links and joints of the file; a prefix of all names, as in rh_FFJ1, is detected.

    Returns:
        The description without its file; None if no known hand has these joints and links.
    """
    there = {*tree.by_name, *tree.links}
    for name in NAMES:
        content = read_json(FOLDER / f"{name}.json")
        needed = names_in(content)
        first = min(needed)
        for prefix in sorted({one.removesuffix(first) for one in there if one.endswith(first)}):
            if all(prefix + one in there for one in needed):
                return {key: _renamed(value, needed, prefix) for key, value in content.items()}
    return None


def names_in(content: Mapping[str, Any]) -> set[str]:
    """Joints and links that a description names."""
    joints = {*content["closing"], *content.get("torques", ())}
    joints.update(*(one["joints"] for one in content.get("couplings", ())))
    joints.update(*content["preshapes"].values())
    return joints | {content.get("base", content["palm"]), content["palm"], *content["fingertips"]}


def _renamed(value: Any, names: set[str], prefix: str) -> Any:
    """JSON with a prefix before all names of joints and links."""
    if isinstance(value, dict):
        return {
            _renamed(key, names, prefix): _renamed(one, names, prefix) for key, one in value.items()
        }
    if isinstance(value, list):
        return [_renamed(one, names, prefix) for one in value]
    return prefix + value if value in names else value


Numbers = dict[str, float]


_NUMBERS = "an object of numbers by joints"
KEYS: dict[str, tuple[Any, str]] = {
    "name": (str, "a text"),
    "description": (str, "a text, the name of a URDF or MuJoCo file"),
    "base": (str, "the name of a link"),
    "palm": (str, "the name of a link"),
    "approach": (tuple[float, float, float], "a list of three numbers, not all 0"),
    "fingertips": (tuple[str, ...], "a list of names of links"),
    "sensors": (Numbers, "an object of sensor resolutions [rad] from 0 to below pi by links"),
    "torques": (Numbers, f"{_NUMBERS} [N m, or N where they slide], at least 0 (0: no motor)"),
    "couplings": (
        tuple[Coupling, ...], 'a list of objects of "joints" and the "ratios" of their values'
    ),
    "masses": (
        dict[str, LinkMass],
        'an object by links of "mass" [kg] above 0 and its "center" [m], three numbers',
    ),
    "preshapes": (dict[str, Numbers], "an object of postures by name"),
    "closing": (Numbers, _NUMBERS),
    "source": (str, "a text"),
    "assumed": (tuple[str, ...], "a list of texts"),
}  # fmt: skip
"""Keys of a description besides format and version: types, and in words what values must be."""

HOLDS: dict[str, Callable[[Any], bool]] = {
    "approach": any,
    "sensors": lambda values: all(0.0 <= one < math.pi for one in values.values()),
    "torques": lambda values: all(one >= 0.0 for one in values.values()),
    "couplings": lambda values: all(
        len({*one.joints}) == len(one.joints) == len(one.ratios) >= 2 and all(one.ratios)
        for one in values
    ),
    "masses": lambda values: all(one.mass > 0.0 for one in values.values()),
}
"""Conditions that the values of some keys must meet."""


def stated_of(content: Mapping[str, Any]) -> dict[str, Any]:
    """The values of a JSON description, by key, each checked on its own.

    Raises:
        SettingError: A key is unknown, or its value is not allowed.
    """
    check_keys(content, KEYS, version=VERSION)
    stated: dict[str, Any] = {}
    for key in (one for one in content if one in KEYS):
        hint, expected = KEYS[key]
        try:
            json.dumps(content[key], allow_nan=False)  # raises for numbers that are not finite
            stated[key] = typed(content[key], hint)
            wrong = key in HOLDS and not HOLDS[key](stated[key])
        except (TypeError, ValueError, OverflowError):
            wrong = True
        if wrong:
            raise SettingError(f"{key} must be {expected}; got {json.dumps(content[key])[:60]}")
    return stated


def articulated_hand(content: Mapping[str, Any]) -> ArticulatedHand:
    """Make the hand with joints that a JSON description states.

    Args:
        content: The description; its key `description` is relative to the working folder.

    Raises:
        SettingError: The file is missing, or lacks a link or joint that the description names.
    """
    stated = stated_of(content)
    if "description" not in stated:
        raise SettingError("description is missing: the name of a URDF or MuJoCo file")
    return made_of(Path(stated["description"]), articulated_hand_of, stated)


def proposed_hand(tree: LinkTree, palm: str | None) -> ArticulatedHand:
    """Propose a hand from links and joints, with the values of a known hand that has them.

    Args:
        tree: Links and joints.
        palm: Name of the palm's link; None: it is proposed.

    Raises:
        SettingError: They do not make a hand with joints.
    """
    stated: dict[str, Any] = {}
    if (content := known_numbers(tree)) is not None:
        named = f"it is the hand {content['name']}, whose joints have the same names"
        stated = {**stated_of(content), "assumed": [named]}
    if palm is not None:
        stated["palm"] = palm
    return articulated_hand_of(tree, stated)
