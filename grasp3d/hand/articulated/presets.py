"""Hands with joints that are known by name: numbers of their makers, for URDFs of the user."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from grasp3d.hand.gripper_json import read_json

if TYPE_CHECKING:
    from grasp3d.hand.link_tree import LinkTree

FORMAT, VERSION = "grasp3d articulated hand", 1
"""What the keys `format` and `version` of a description contain."""

FOLDER = Path(__file__).parents[1] / "presets"

NAMES = ("allegro", "leap", "shadow", "barrett")
"""Hands that are known; their JSON files have notes on where the numbers come from."""


def known_numbers(tree: "LinkTree") -> dict[str, Any] | None:
    """What is known of a hand, in the names that a file has for links and joints.

    Args:
        tree: Links and joints of the file; a prefix before all names, as in rh_FFJ1, is found.

    Returns:
        The description of a hand without its file; None: none has these joints and links.
    """
    there = {joint.name for joint in tree.joints.values() if joint.kind != "fixed"} | {*tree.links}
    for name in NAMES:
        content: Any = read_json(FOLDER / f"{name}.json")
        needed = names_in(content)
        first = min(needed)
        for prefix in sorted({one.removesuffix(first) for one in there if one.endswith(first)}):
            if all(prefix + one in there for one in needed):
                return _renamed(content, prefix)
    return None


def names_in(content: Mapping[str, Any]) -> set[str]:
    """Joints and links that a description names."""
    joints = {*content.get("closing", ()), *content.get("torques", ())}
    for coupling in content.get("couplings", ()):
        joints.update(coupling["joints"])
    for posture in content.get("preshapes", {}).values():
        joints.update(posture)
    return joints | {content.get("base", content["palm"]), content["palm"], *content["fingertips"]}


def _renamed(content: Mapping[str, Any], prefix: str) -> dict[str, Any]:
    def put(values: Mapping[str, Any]) -> dict[str, Any]:
        return {prefix + name: value for name, value in values.items()}

    links = {key: prefix + content[key] for key in ("base", "palm") if key in content}
    return {
        **content,
        **links,
        "fingertips": [prefix + name for name in content["fingertips"]],
        "closing": put(content["closing"]),
        "torques": put(content.get("torques", {})),
        "preshapes": {name: put(values) for name, values in content["preshapes"].items()},
        "couplings": [
            {**one, "joints": [prefix + name for name in one["joints"]]}
            for one in content.get("couplings", ())
        ],
    }
