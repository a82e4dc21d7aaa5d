"""Grippers that are known by name.

Makers state strokes and forces; the other lengths are measured on the geometry of published robot
descriptions. Fingers and palm are boxes around that geometry, but for exceptions that are stated.
The JSON file of each gripper has notes on where its numbers come from.
"""

from difflib import get_close_matches
from pathlib import Path

from grasp3d.errors import SettingError
from grasp3d.hand.gripper_json import gripper_of, read_json
from grasp3d.hand.parallel_gripper import ParallelGripper

PRESETS: dict[str, ParallelGripper] = {
    name: gripper_of(read_json(Path(__file__).with_name(f"{name}.json")))
    for name in ("franka", "robotiq_2f85", "robotiq_2f140", "wsg50", "tactile")
}
"""The grippers by name."""

ALIASES = {"panda": "franka"}
"""Other names of presets."""


def preset(name: str) -> ParallelGripper:
    """A gripper that is known by name.

    Args:
        name: Its name or alias.

    Raises:
        SettingError: No preset has that name.

    Example:
        >>> from grasp3d.hand.presets import preset
        >>> preset("robotiq_2f85").max_opening
        0.085
        >>> preset("nope")
        Traceback (most recent call last):
            ...
        grasp3d.errors.SettingError: no gripper is called 'nope'; known: franka (panda), ...
    """
    key = ALIASES.get(name, name)
    if key in PRESETS:
        return PRESETS[key]
    near = get_close_matches(name, [*PRESETS, *ALIASES], 1)
    guess = f" (did you mean {near[0]}?)" if near else ""
    raise SettingError(f"no gripper is called {name!r}{guess}; known: {', '.join(preset_names())}")


def preset_names() -> list[str]:
    """Names of the presets, with their aliases in brackets."""
    others = {name: [alias for alias, of in ALIASES.items() if of == name] for name in PRESETS}
    return [f"{name} ({', '.join(more)})" if more else name for name, more in others.items()]
