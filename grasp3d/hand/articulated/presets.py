"""Hands with joints that are known by name: numbers of their makers, for URDFs of the user."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from grasp3d.errors import SettingError
from grasp3d.hand.gripper_json import read_json
from grasp3d.system.names import unknown

if TYPE_CHECKING:
    from grasp3d.hand.link_tree import LinkTree

FORMAT, VERSION = "grasp3d articulated hand", 1
"""What the keys `format` and `version` of a description contain."""

FOLDER = Path(__file__).parents[1] / "presets"

NAMES = ("allegro", "leap", "shadow", "barrett")
"""Hands that are known; their JSON files have notes on where the numbers come from."""


def content_of(name: str) -> Any:
    """The description of a hand that is known by name, without a file of links and joints.

    Raises:
        SettingError: None has that name.
    """
    if name not in NAMES:
        raise SettingError(unknown("hand with joints", name, NAMES))
    return read_json(FOLDER / f"{name}.json")


def numbers_of(name: str, tree: "LinkTree") -> dict[str, Any]:
    """What is known of a hand, in the names that a file has for links and joints.

    Args:
        name: Name of the hand.
        tree: Links and joints of the file; a prefix before all names, as in rh_FFJ1, is found.

    Raises:
        SettingError: No hand has that name, or the file has other joints.
    """
    content = content_of(name)
    known = {joint.name for joint in tree.joints.values() if joint.kind != "fixed"} | {*tree.links}
    needed = names_in(content)
    first = min(needed)
    for prefix in sorted({one.removesuffix(first) for one in known if one.endswith(first)}):
        if all(prefix + one in known for one in needed):
            return _renamed(content, prefix)
    missing = sorted(needed - known)
    raise tree.error(
        f"it is no {name} as that is known: it has no {', '.join(missing[:5])}"
        f"{' ...' if len(missing) > 5 else ''}"
    )


def fitting(tree: "LinkTree") -> str | None:
    """Name of the hand whose joints and links a file has; None: none."""
    for name in NAMES:
        try:
            numbers_of(name, tree)
        except SettingError:
            continue
        return name
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
