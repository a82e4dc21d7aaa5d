"""Friction: a coefficient, or the interval in which it lies."""

import math
from collections.abc import Sequence
from typing import Any

from grasp3d.errors import SettingError
from grasp3d.settings.parsing import ParsedField

LARGEST_TYPED = 10.0
"""Largest coefficient in a text, in which one of 50 is rather a percentage than meant."""

_BETWEEN = ".."
"""Between the ends of an interval in a text."""


def friction_interval(value: object) -> tuple[float, float]:
    """Smallest and largest coefficient of friction.

    Args:
        value: A number, two of them, or a text: '0.5' or '0.4..0.6'.

    Raises:
        SettingError: They are not finite numbers above 0 in increasing order.

    Example:
        >>> from grasp3d.settings.friction import friction_interval
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
    if isinstance(value, str) and len(ends) == 2 and math.inf > ends[1] > LARGEST_TYPED:
        raise SettingError(
            f"friction must be a coefficient, and even that of rubber is some 2; got {value}: is "
            f"{ends[1] / 100.0:g} meant?"
        )
    if len(ends) != 2 or not all(0.0 < end < math.inf for end in ends) or ends[0] > ends[1]:
        quoted = f"{value:g}" if isinstance(value, float) else repr(value)
        raise SettingError(
            "friction must be a finite number above 0, or an interval of two, the smallest first "
            f"(0.4{_BETWEEN}0.6, in Python (0.4, 0.6)); got {quoted}"
        )
    return ends[0], ends[1]


class Friction(ParsedField[float | tuple[float, float], float | tuple[float, float] | str]):
    """A field of settings that holds a coefficient of friction, or an interval of it.

    It takes a number, or two of them, the smallest first, or a text: '0.5' or '0.4..0.6'.
    """

    def parse(self, _name: str, value: Any) -> Any:
        """See `ParsedField.parse`."""
        smallest, largest = friction_interval(value)
        return smallest if smallest == largest else (smallest, largest)

    def plain(self, value: Any) -> Any:
        """See `ParsedField.plain`."""
        return _BETWEEN.join(map(repr, value)) if isinstance(value, tuple) else value
