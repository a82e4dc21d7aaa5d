"""Parsing of ranges of numbers on the command line."""

import math

from grasp3d.errors import SettingError

MAX_RESOLUTIONS = 10_000


def parse_resolutions(words: tuple[str, ...]) -> tuple[float, ...]:
    """Parse sensor resolutions: numbers and ranges FROM:TO:STEP in degrees.

    Args:
        words: Words of the command line.

    Returns:
        Sensor resolutions [rad], in increasing order, without duplicates.

    Raises:
        SettingError: A word is neither a number nor a range, or there are too many resolutions.
    """
    degrees: set[float] = set()
    for word in words:
        degrees.update(_range(word))
        if len(degrees) > MAX_RESOLUTIONS:
            raise SettingError(f"sensor resolutions: more than {MAX_RESOLUTIONS} ({word})")
    return tuple(math.radians(degree) for degree in sorted(degrees))


def _range(word: str) -> list[float]:
    """Return the numbers of a word [degrees]."""
    message = (
        f"sensor resolution {word!r} must be a number of degrees, or FROM:TO:STEP with STEP above 0"
    )
    try:
        numbers = [float(part) for part in word.split(":")]
    except ValueError as error:
        raise SettingError(message) from error
    if len(numbers) == 1:
        return numbers
    if len(numbers) != len(("from", "to", "step")) or not all(map(math.isfinite, numbers)):
        raise SettingError(message)
    first, last, step = numbers
    if not (step > 0.0 and first <= last):
        raise SettingError(message)
    count = min(int((last - first) / step + 1e-9), MAX_RESOLUTIONS) + 1
    return [round(first + step * index, 9) for index in range(count)]
