"""Choices about a hand and its object: axes, approach angles, whether the object moves."""

import math
from typing import Literal

from grasp3d.settings.checks import check_range

Standing = Literal["none", "as-is", "stable"]
"""What an object stands on: nothing, a table below it as it is, or in a resting pose."""

Axis = Literal["x", "y", "z", "-x", "-y", "-z"]
AXES: dict[str, tuple[float, float, float]] = {
    "x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0),
    "-x": (-1.0, 0.0, 0.0), "-y": (0.0, -1.0, 0.0), "-z": (0.0, 0.0, -1.0),
}  # fmt: skip
"""Unit vectors of the axes of a frame, by name."""

ObjectMotion = Literal["free", "fixed"]
"""Whether an object gives way to closing fingers."""

ContactRule = Literal["given", "closed"]
"""By which rule poses of hands with joints become contacts: as they are given, or closed from an
open preshape."""

MIN_ANGLES, MAX_ANGLES = 8, 64


def check_approach(within: float, angles: int) -> None:
    """Refuse limits of the approach that are outside their range.

    Args:
        within: Largest angle from the preferred direction [rad].
        angles: Number of angles that are tested.

    Raises:
        SettingError: A value is outside its range.
    """
    check_range("approach_within", within, 0.0, math.pi, ends="(]", degrees=True)
    check_range("approach_angles", angles, MIN_ANGLES, MAX_ANGLES)
