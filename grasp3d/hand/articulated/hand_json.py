"""Descriptions of hands with joints as JSON: what URDF and MuJoCo models do not say.

    {"format": "grasp3d articulated hand", "version": 1, "description": "allegro.urdf", ...}

`description` names the URDF or MuJoCo model, from the folder of the JSON file. All other keys may
be left out: `KEYS`. Angles are in radians, torques in N m, lengths in metres; joints and links are
named as the model names them.
"""

import json
import math
from collections.abc import Callable, Mapping
from difflib import get_close_matches
from pathlib import Path
from typing import Any

from grasp3d.errors import SettingError
from grasp3d.hand.articulated.articulated_hand import ArticulatedHand, Coupling
from grasp3d.hand.articulated.presets import VERSION, fitting, numbers_of
from grasp3d.hand.articulated.proposal import articulated_hand_of
from grasp3d.hand.link_tree import LinkMass, LinkTree, Spring, Tendon
from grasp3d.hand.robot_files import watched


def _is_text(value: object) -> bool:
    return isinstance(value, str)


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def _is_list(each: Callable[[object], bool]) -> Callable[[object], bool]:
    return lambda value: isinstance(value, list) and all(map(each, value))


def _is_object(each: Callable[[object], bool]) -> Callable[[object], bool]:
    return lambda value: isinstance(value, dict) and all(map(each, value.values()))


def _is_direction(value: object) -> bool:
    return _is_list(_is_number)(value) and len(value) == 3 and any(value)  # type: ignore[arg-type]


def _is_coupling(value: object) -> bool:
    if not isinstance(value, dict) or set(value) != {"kind", "joints", "ratios"}:
        return False
    joints, ratios = value["joints"], value["ratios"]
    return (
        value["kind"] in {"rigid", "differential"}
        and _is_list(_is_text)(joints)
        and _is_list(_is_number)(ratios)
        and len(set(joints)) == len(joints) == len(ratios) >= 2
        and all(ratios)
    )


def _is_above_0(value: object) -> bool:
    return _is_number(value) and value > 0.0  # type: ignore[operator]


def _is_tendon(value: object) -> bool:
    if not isinstance(value, dict) or not {"arms", "tension"} <= set(value) <= {*TENDON}:
        return False
    arms, most, least = value["arms"], value["tension"], value.get("pretension", 0.0)
    return (
        _is_object(_is_number)(arms) and any(arms.values()) and _is_above_0(most)
        and _is_number(least) and 0.0 <= least <= most and _is_text(value.get("name", ""))
    )  # fmt: skip


def _is_spring(value: object) -> bool:
    if not isinstance(value, dict) or not set(value) <= {*Spring._fields}:
        return False
    known = {"stiffness", "torque"} & set(value)
    return bool(known) and _is_object(_is_number)(value) and value.get("stiffness", 0.0) >= 0.0


def _is_mass(value: object) -> bool:
    return (
        isinstance(value, dict) and {"mass"} <= set(value) <= {*LinkMass._fields}
        and _is_above_0(value["mass"]) and _is_list(_is_number)(value.get("center", []))
        and len(value.get("center", (0, 0, 0))) == 3
    )  # fmt: skip


TENDON = "name", "arms", "tension", "pretension"
"""Keys of a tendon."""

_NUMBERS = "an object of numbers by joints"
KEYS: dict[str, tuple[Callable[[object], bool], str]] = {
    "name": (_is_text, "a text"),
    "description": (_is_text, "a text, the name of a URDF or MuJoCo file"),
    "base": (_is_text, "the name of a link"),
    "palm": (_is_text, "the name of a link"),
    "approach": (_is_direction, "a list of three numbers, not all 0"),
    "fingertips": (_is_list(_is_text), "a list of names of links"),
    "sensors": (
        _is_object(lambda one: one is None or (_is_number(one) and 0.0 <= one < math.pi)),  # type: ignore[operator]
        "an object of sensor resolutions [rad] from 0 to below pi, or null, by links",
    ),
    "torques": (
        _is_object(lambda one: _is_number(one) and one >= 0.0),  # type: ignore[operator]
        f"{_NUMBERS} [N m, or N where they slide], at least 0 (0: no motor)",
    ),
    "couplings": (
        _is_list(_is_coupling),
        'a list of objects of "kind" rigid or differential, with "joints" and their "ratios"',
    ),
    "tendons": (
        _is_list(_is_tendon),
        'a list of "arms" [m] by joints, "tension" [N] above 0, perhaps "pretension" [N], "name"',
    ),
    "springs": (
        _is_object(_is_spring),
        'an object by joints of "stiffness" [N m/rad], at least 0, "rest" [rad] and "torque" [N m]',
    ),
    "brakes": (
        _is_object(lambda one: one is None or _is_above_0(one)),
        "an object by joints of torques [N m] above 0 that brakes hold, or null where they lock",
    ),
    "masses": (
        _is_object(_is_mass),
        'an object by links of "mass" [kg] above 0 and its "center" [m], three numbers',
    ),
    "preshapes": (_is_object(_is_object(_is_number)), "an object of postures by name"),
    "closing": (_is_object(_is_number), _NUMBERS),
    "source": (_is_text, "a text"),
    "assumed": (_is_list(_is_text), "a list of texts"),
    "notes": (lambda _: True, "anything"),
}
"""Keys of a description besides format and version: what a value must be, and its name."""


def stated_of(content: Mapping[str, Any]) -> dict[str, Any]:
    """What a description in JSON states, by its keys, checked by itself.

    Raises:
        SettingError: A value is not what its key means.
    """
    if content.get("version") != VERSION or isinstance(content.get("version"), bool):
        got = json.dumps(content.get("version"))[:40]
        raise SettingError(f"version must be {VERSION}; got {got}")
    stated = {key: value for key, value in content.items() if key not in {"format", "version"}}
    for key, value in stated.items():
        if key not in KEYS:
            near = get_close_matches(key, KEYS, 1)
            guess = f" (did you mean {near[0]}?)" if near else ""
            raise SettingError(f"no key is called {key[:40]!r}{guess}; known: {', '.join(KEYS)}")
        check, expected = KEYS[key]
        if not check(value):
            raise SettingError(f"{key} must be {expected}; got {json.dumps(value)[:60]}")
    stated["couplings"] = tuple(
        Coupling(one["kind"], tuple(one["joints"]), tuple(map(float, one["ratios"])))
        for one in stated.get("couplings", ())
    )
    if "tendons" in stated:
        stated["tendons"] = tuple(_tendon(one) for one in stated["tendons"])
    if "springs" in stated:
        stated["springs"] = {name: Spring(**one) for name, one in stated["springs"].items()}
    if "masses" in stated:
        stated["masses"] = {
            name: LinkMass(one["mass"], tuple(one.get("center", (0.0, 0.0, 0.0))))
            for name, one in stated["masses"].items()
        }
    if "brakes" in stated:
        held = stated["brakes"].items()
        stated["brakes"] = {name: math.inf if one is None else one for name, one in held}
    return stated


def _tendon(content: Mapping[str, Any]) -> Tendon:
    arms = {name: float(arm) for name, arm in content["arms"].items() if arm}
    name = content.get("name") or f"tendon of {' and '.join(arms)}"
    return Tendon(name, arms, (float(content.get("pretension", 0.0)), float(content["tension"])))


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
    return watched(articulated_hand_of, Path(stated["description"]), stated)


def proposed_hand(path: Path, preset: str | None, palm: str | None) -> ArticulatedHand:
    """A hand from a URDF or MuJoCo model alone.

    Args:
        path: The file.
        preset: Whose numbers it has; None: those of the hand whose joints have the same names.
        palm: Name of the palm's link; None: it is found.

    Raises:
        SettingError: The file cannot be read, is of no hand with joints, or of another one.
    """
    return watched(_proposed, path, preset, palm)


def _proposed(tree: LinkTree, preset: str | None, palm: str | None) -> ArticulatedHand:
    stated: dict[str, Any] = {}
    name = preset or fitting(tree)
    if name is not None:
        stated = stated_of(numbers_of(name, tree))
        if preset is None:
            stated["assumed"] = [f"it is the hand {name}, whose joints have the same names"]
    if palm is not None:
        stated["palm"] = palm
    hand = articulated_hand_of(tree, stated)
    if all(_slides(hand, tip) for tip in hand.fingertips):
        raise tree.error(
            f"its fingers slide: name the links of its two fingers: grasp3d hand {tree.source} "
            "--fingers LINK LINK -o NAME.json makes a description of it, for all commands"
        )
    return hand


def _slides(hand: ArticulatedHand, link: str) -> bool:
    """Whether the last joint that moves a link slides."""
    kinds = (hand.tree.joints[one].kind for one in hand.tree.chain(link)[:-1])
    return next(kind for kind in kinds if kind != "fixed") == "slides"
