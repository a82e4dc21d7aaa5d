"""Checks of single setting values."""

import math
from numbers import Integral, Real
from typing import Literal, get_args

from grasp3d.errors import SettingError
from grasp3d.settings.units import describe_length

LARGEST_SEED = 2**63 - 1


def check_choice(what: str, value: object, choices: object) -> None:
    """Raise SettingError unless a value is one of the choices.

    Args:
        what: What the value names, for the error message: 'method'.
        value: The value.
        choices: A `Literal` of the choices.

    Raises:
        SettingError: The value is not one of the choices.
    """
    names = get_args(choices)
    if value not in names:
        verb = "are" if what.endswith("s") else "is"
        raise SettingError(f"no {what} {verb} called {value!r}; known: {', '.join(names)}")


def whole_number(name: str, value: object, minimum: int) -> int:
    """Convert a value to an integer after checking that it is a whole number.

    Args:
        name: Name of the setting, for the error message.
        value: The number.
        minimum: Smallest accepted number.

    Raises:
        SettingError: The value is not a whole number, or is smaller than the minimum.
    """
    if not isinstance(value, Integral) or isinstance(value, bool) or int(value) < minimum:
        raise SettingError(f"{name} must be a whole number of at least {minimum}; got {value!r}")
    return int(value)


def check_range(
    name: str,
    value: float,
    least: float,
    most: float = math.inf,
    *,
    ends: Literal["[]", "(]", "[)", "()"] = "[]",
    degrees: bool = False,
    unit: str = "",
) -> None:
    """Refuse a number that is outside a range, or that is not whole where the limits are whole.

    Args:
        name: Name of the setting, for the error message.
        value: The number.
        least: Lower end of the range.
        most: Upper end of the range.
        ends: Ends that belong to the range, in the notation of intervals.
        degrees: The number and the ends are angles [rad]; the message states degrees.
        unit: Unit for the message.

    Raises:
        SettingError: The value is outside the range, or is not a number.

    Example:
        >>> from grasp3d.settings.checks import check_range
        >>> check_range("level", 1.0, 0.5, 1.0, ends="()")
        Traceback (most recent call last):
            ...
        grasp3d.errors.SettingError: level must be above 0.5 and below 1; got 1
    """
    if not isinstance(value, Real):
        raise SettingError(f"{name} must be a number; got {value!r}")
    above = least < value if ends[0] == "(" else least <= value
    below = value < most if ends[1] == ")" else value <= most
    whole = not isinstance(least, int) or isinstance(value, Integral)
    if above and below and whole:
        return
    numbers = map(math.degrees, (least, most, value)) if degrees else (least, most, value)
    low, high, got = (one if isinstance(least, int) else f"{one:g}" for one in numbers)
    unit = " degrees" if degrees else unit and f" {unit}"
    text = f"above {low}" if ends[0] == "(" else f"at least {low}"
    if ends == "[]" and most < math.inf:
        text = f"from {low} to {high}"
    elif most < math.inf:
        text += f" and below {high}" if ends[1] == ")" else f" and at most {high}"
    hint = " (in Python angles are radians)" * degrees
    raise SettingError(f"{name} must be {text}{unit}; got {got}{unit}{hint}")


def check_length(name: str, length: float, *, above: bool = False) -> None:
    """Refuse a length that is negative or not finite.

    Args:
        name: Name of the setting, for the error message.
        length: The length.
        above: Whether 0 is refused as well.

    Raises:
        SettingError: The length is negative or not finite, or is 0 and `above` is set.
    """
    if not 0.0 <= length < math.inf or (above and not length):
        least = "above 0" if above else "of at least 0"
        raise SettingError(f"{name} must be a finite length {least}; got {describe_length(length)}")
