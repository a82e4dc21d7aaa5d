"""Parsing of numbers, angles and lengths on the command line, one by one or as ranges."""

import math

from grasp3d.errors import SettingError
from grasp3d.settings.lengths import METRES, AnyLength, measure
from grasp3d.settings.uncertainty import friction_interval

_LENGTH = f"a length (a number, or a number with a unit: {', '.join(METRES)})"
"""What one word of lengths must be."""

MAX_VALUES = 10_000


def parse_angles(what: str, words: tuple[str, ...]) -> tuple[float, ...]:
    """Parse angles: numbers and ranges FROM:TO:STEP in degrees.

    Args:
        what: What a single value is, for the error.
        words: Words of the command line.

    Returns:
        Angles [rad], in increasing order, without duplicates.

    Raises:
        SettingError: A word is neither a number nor a range, or there are too many.
    """
    return tuple(math.radians(degree) for degree in _numbers(what, "a number of degrees", words))


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
    return _numbers(what, "a number", words)


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
    lengths: dict[AnyLength, None] = {}
    for word in map(str.lower, words):
        unit = next(
            (one for one in sorted(METRES, key=len, reverse=True) if word.endswith(one)), None
        )
        parts = [part.removesuffix(unit or "").strip() for part in word.split(":")]
        if any(part.endswith(tuple(METRES)) for part in parts):
            raise _no_range(what, _LENGTH, word)
        for number in _range(what, _LENGTH, word, parts):
            lengths[measure(number, unit)] = None
        _check_count(what, len(lengths), word)
    return tuple(lengths)


def _numbers(what: str, kind: str, words: tuple[str, ...]) -> tuple[float, ...]:
    numbers: set[float] = set()
    for word in words:
        numbers.update(_range(what, kind, word, word.split(":")))
        _check_count(what, len(numbers), word)
    return tuple(sorted(numbers))


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


def _check_count(what: str, count: int, word: str) -> None:
    if count > MAX_VALUES:
        raise SettingError(f"{what} has more than {MAX_VALUES} values ({word}); use a larger STEP")


def _no_range(what: str, kind: str, word: str) -> SettingError:
    return SettingError(
        f"{what} must be {kind}, or a range FROM:TO:STEP with STEP above 0; got {word!r}"
    )
