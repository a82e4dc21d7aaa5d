"""Friction, which may be an interval, and checks of what a sensor does not resolve."""

import math
from collections.abc import Sequence
from typing import Any

from grasp3d.errors import SettingError
from grasp3d.settings.parsing import ParsedField

Interval = tuple[float, float]
"""Smallest and largest value."""

_BETWEEN = ".."
"""Between the ends of an interval in a text."""


def check_resolution(resolution: float) -> None:
    """Raise SettingError unless a sensor resolution is from 0 to below pi [rad]."""
    if not 0.0 <= resolution < math.pi:
        raise SettingError(
            "sensor resolution must be at least 0 and below 180 degrees (pi radians); "
            f"got {math.degrees(resolution):g} degrees (in Python angles are radians)"
        )


def check_normal_error(error: float) -> None:
    """Raise SettingError unless an error of normals is from 0 to below pi / 2 [rad]."""
    if not 0.0 <= error < math.pi / 2.0:
        raise SettingError(
            "normal error must be at least 0 and below 90 degrees (pi / 2 radians); "
            f"got {math.degrees(error):g} degrees (in Python angles are radians)"
        )


def check_tilt(tilt: float) -> None:
    """Raise SettingError unless true normals differ by less than pi / 2 from perceived ones."""
    if not tilt < math.pi / 2.0:
        raise SettingError(
            "half the sensor resolution and the normal error must add up to less than 90 degrees; "
            f"got {math.degrees(tilt):.4g} degrees"
        )


def friction_interval(value: object) -> Interval:
    """Smallest and largest coefficient of friction.

    Args:
        value: A number, two of them, or a text: '0.5' or '0.4..0.6'.

    Raises:
        SettingError: They are not finite numbers above 0 in increasing order.

    Example:
        >>> from grasp3d.settings.uncertainty import friction_interval
        >>> friction_interval("0.4..0.6"), friction_interval(0.5)
        ((0.4, 0.6), (0.5, 0.5))
    """
    if type(value) is float and 0.0 < value < math.inf:  # as in most models, which are made often
        return value, value
    parts = value.split(_BETWEEN) if isinstance(value, str) else value
    try:
        ends = [float(one) for one in parts] if isinstance(parts, Sequence) else [float(parts)]  # type: ignore[arg-type]
    except (TypeError, ValueError, OverflowError):
        ends = []
    if len(ends) == 1:
        ends *= 2
    if len(ends) != 2 or not all(0.0 < end < math.inf for end in ends) or ends[0] > ends[1]:
        quoted = f"{value:g}" if isinstance(value, float) else repr(value)
        raise SettingError(
            "friction must be a finite number above 0, or an interval of two, the smallest first "
            f"(0.4{_BETWEEN}0.6, in Python (0.4, 0.6)); got {quoted}"
        )
    return ends[0], ends[1]


class Friction(ParsedField[float, float | tuple[float, float] | str]):
    """A field of settings that holds a coefficient of friction.

    It takes a number, or an interval (smallest, largest), in a text '0.4..0.6', and holds its
    middle; half its width becomes the `friction_error` of the settings.
    """

    def parse(self, _name: str, value: Any) -> Any:
        """The interval of friction, which `GraspModel` parts into its middle and its error."""
        return value if isinstance(value, float) else friction_interval(value)
