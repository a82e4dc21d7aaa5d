"""Choices about a hand and its object: axes, approach angles, whether the object moves."""

import math
from typing import Literal

from grasp3d.errors import SettingError
from grasp3d.settings import whole_number

Axis = Literal["x", "y", "z", "-x", "-y", "-z"]
ObjectMotion = Literal["free", "fixed"]
"""Whether an object gives way to closing fingers."""

MIN_ANGLES, MAX_ANGLES = 8, 64


def check_approach(within: float, angles: int) -> None:
    """Refuse limits of the approach that are outside their range.

    Args:
        within: Largest angle from the preferred direction [rad].
        angles: Number of angles that are tested.

    Raises:
        SettingError: A value is outside its range.
    """
    if not 0.0 < within <= math.pi:
        raise SettingError(
            "approach_within must be above 0 and at most 180 degrees; "
            f"got {math.degrees(within):g} degrees"
        )
    if not MIN_ANGLES <= whole_number("approach_angles", angles, 0) <= MAX_ANGLES:
        raise SettingError(
            f"approach_angles must be from {MIN_ANGLES} to {MAX_ANGLES}; got {angles}"
        )
