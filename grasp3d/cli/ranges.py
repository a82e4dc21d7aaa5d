"""Parsing of numbers, angles and lengths on the command line, one by one or as ranges."""

import math
from collections.abc import Iterator
from typing import Any

from grasp3d.errors import SettingError
from grasp3d.settings.checks import ANGLE, ANGLE_UNITS, parse_angle
from grasp3d.settings.lengths import METRES, AnyLength, measure
from grasp3d.settings.uncertainty import friction_interval

_LENGTH = f"a length (a number, or a number with a unit: {', '.join(METRES)})"
"""What one word of lengths must be."""

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
    values = _values(what, ANGLE, words, ANGLE_UNITS)
    return tuple(sorted({parse_angle(what, f"{number!r}{unit}") for number, unit in values}))


def parse_numbers(what: str, words: tuple[str, ...]) -> tuple[float, ...]:
    """Parse numbers and ranges FROM:TO:STEP; see `parse_angles`.

    Args:
        what: What a single value is, for the error.
        words: Words of the command line.

    Returns:
        The numbers, in increasing order, without duplicates.

    Raises:
        SettingError: A word is neither a number nor a range, or there are too many.
    """
    return tuple(sorted({number for number, _ in _values(what, "a number", words)}))


def parse_frictions(what: str, words: tuple[str, ...]) -> tuple[float, ...]:
    """Parse coefficients of friction: numbers and ranges FROM:TO:STEP; see `parse_angles`.

    Args:
        what: What a single value is, for the error.
        words: Words of the command line.

    Returns:
        The coefficients, in increasing order, without duplicates.

    Raises:
        SettingError: As for `parse_numbers`, or a word is an interval LOW..HIGH: the width of all
            intervals is that of another option, of the same name with `-error`.
    """
    for word in words:
        try:
            low, high = friction_interval(word)
        except SettingError:
            continue  # what is no interval either is refused below
        if low < high:
            raise SettingError(
                f"{what} takes no interval {word} here: give its middle and half its width, "
                f"{what} {0.5 * (low + high):.6g} {what}-error {0.5 * (high - low):.6g}"
            )
    return parse_numbers(what, words)


def parse_lengths(what: str, words: tuple[str, ...]) -> tuple[AnyLength, ...]:
    """Parse lengths and ranges of them, FROM:TO:STEP, with or without a unit.

    A unit at the end of a range is that of all its numbers without one: 0:5:0.5mm.

    Args:
        what: What a single value is, for the error.
        words: Words of the command line.

    Returns:
        Lengths as `parse_length` returns them, without duplicates.

    Raises:
        SettingError: A word is neither a length nor a range, or there are too many.

    Example:
        >>> from grasp3d.cli.ranges import parse_lengths
        >>> parse_lengths("location error", ("0:2:1mm", "0.5mm"))
        (0.0, '1 mm', '2 mm', '0.5 mm')
    """
    values = _values(what, _LENGTH, words, tuple(METRES))
    return tuple(dict.fromkeys(measure(number, unit or None) for number, unit in values))


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
