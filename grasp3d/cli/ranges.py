"""Parsing of numbers and angles on the command line, one by one or as ranges."""

import math
from collections.abc import Iterator
from typing import Any

from grasp3d.cli.options import typed_angle
from grasp3d.errors import SettingError
from grasp3d.settings.friction import friction_interval
from grasp3d.settings.units import ANGLE, ANGLE_UNITS, parse_angle

MAX_VALUES = 10_000


def parse_angles(what: str, words: tuple[str, ...]) -> tuple[float, ...]:
    """Parse angles and ranges of them, FROM:TO:STEP, in degrees or with a unit.

    A unit at the end of a range is that of all its numbers: 0:0.6:0.1rad.

    Args:
        what: What a single value is, for the error.
        words: Words of the command line.

    Returns:
        Angles [rad], in increasing order, without duplicates.

    Raises:
        SettingError: A word is neither an angle nor a range, or there are too many.

    Example:
        >>> from grasp3d.cli.ranges import parse_angles
        >>> parse_angles("resolution", ("0:0.2:0.1rad", "0deg"))
        (0.0, 0.1, 0.2)
    """
    values = list(_values(what, ANGLE, words, ANGLE_UNITS))
    if len(values) == 1 and ":" not in words[0]:
        return (typed_angle(what, words[0].strip().lower()),)
    return tuple(sorted({parse_angle(what, f"{number!r}{unit}") for number, unit in values}))


def parse_frictions(what: str, words: tuple[str, ...]) -> tuple[float, ...]:
    """Parse coefficients of friction and ranges FROM:TO:STEP; see `parse_angles`.

    Args:
        what: What a single value is, for the error.
        words: Words of the command line.

    Returns:
        The coefficients, in increasing order, without duplicates.

    Raises:
        SettingError: A word is neither a coefficient nor a range, or there are too many.
    """
    values = sorted({number for number, _ in _values(what, "a number", words)})
    for number in values[:1] + values[-1:]:
        friction_interval(f"{number:g}")
    return tuple(values)


def _values(
    what: str, kind: str, words: tuple[str, ...], units: tuple[str, ...] = ()
) -> Iterator[tuple[float, Any]]:
    """Numbers of words and ranges, each with the unit at the end of its word; '' for none."""
    count = 0
    for word in words:
        text = word.strip().lower()
        unit = max((one for one in units if text.endswith(one)), key=len, default="")
        numbers = _range(what, kind, word, [one.removesuffix(unit) for one in text.split(":")])
        count += len(numbers)
        if count > MAX_VALUES:
            raise SettingError(
                f"{what} has more than {MAX_VALUES} values ({word}); use a larger STEP"
            )
        yield from ((number, unit) for number in numbers)


def _range(what: str, kind: str, word: str, parts: list[str]) -> list[float]:
    """Return the numbers of a word."""
    try:
        numbers = [float(part) for part in parts]
    except ValueError as error:
        raise _no_range(what, kind, word) from error
    if len(numbers) == 1:
        return numbers
    if len(numbers) != len(("from", "to", "step")) or not all(map(math.isfinite, numbers)):
        raise _no_range(what, kind, word)
    first, last, step = numbers
    if not (step > 0.0 and first <= last):
        raise _no_range(what, kind, word)
    count = min(int((last - first) / step + 1e-9), MAX_VALUES) + 1
    return [round(first + step * index, 9) for index in range(count)]


def _no_range(what: str, kind: str, word: str) -> SettingError:
    return SettingError(
        f"{what} must be {kind}, or a range FROM:TO:STEP with STEP above 0; got {word!r}"
    )
