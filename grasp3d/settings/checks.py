"""Angles in settings, and checks of single values."""

import math
from numbers import Integral
from typing import Annotated, get_args

from grasp3d.errors import SettingError
from grasp3d.settings.lengths import AnyLength, comparable, describe_length

Radians = Annotated[float, "angle"]
"""An angle; on the command line it is in degrees."""

DEGREE = math.pi / 180.0
SEED_LIMIT = 2**63


def check_choice(what: str, value: object, choices: object) -> None:
    """Raise SettingError unless a value is one of the choices.

    Args:
        what: What the value names, for the error message: 'method'.
        value: The value.
        choices: A `Literal` of the choices.

    Raises:
        SettingError: The value is none of the choices.
    """
    known = get_args(choices)
    if value not in known:
        verb = "are" if what.endswith("s") else "is"
        raise SettingError(f"no {what} {verb} called {value!r}; known: {', '.join(known)}")


def whole_number(name: str, value: object, minimum: int) -> int:
    """Convert a value to an integer after checking that it is a whole number.

    Args:
        name: Name of the setting, for the error message.
        value: The number.
        minimum: Smallest number that is accepted.

    Raises:
        SettingError: The value is no whole number, or is smaller.
    """
    if not isinstance(value, Integral) or isinstance(value, bool) or int(value) < minimum:
        raise SettingError(f"{name} must be a whole number of at least {minimum}; got {value!r}")
    return int(value)


def check_seed(name: str, seed: object) -> None:
    """Refuse what is no seed of random numbers.

    Args:
        name: Name of the setting, for the error message.
        seed: The seed.

    Raises:
        SettingError: It is no whole number from 0 to below 2^63.
    """
    if whole_number(name, seed, 0) >= SEED_LIMIT:
        raise SettingError(f"{name} must be below 2^63; got {seed}")


def check_length(name: str, length: AnyLength, *, above: bool = False) -> None:
    """Refuse a length that is negative or not finite; in any unit.

    Args:
        name: Name of the setting, for the error message.
        length: The length.
        above: Whether 0 is refused as well.

    Raises:
        SettingError: It is no such length.
    """
    numbers = comparable(length) or ()
    if not all(0.0 <= one < math.inf for one in numbers) or (above and not all(numbers)):
        least = "above 0" if above else "of at least 0"
        raise SettingError(f"{name} must be a finite length {least}; got {describe_length(length)}")
