"""Ranges of numbers as they are written on the command line."""

import math

from grasp3d.errors import SettingError

MOST_RESOLUTIONS = 10_000


def resolutions(words: tuple[str, ...]) -> tuple[float, ...]:
    """Read sensor resolutions: numbers and ranges FROM:TO:STEP in degrees.

    Args:
        words: As on the command line.

    Returns:
        In radians, in increasing order, each once.

    Raises:
        SettingError: A word is neither, or there are too many resolutions.
    """
    degrees: set[float] = set()
    for word in words:
        degrees.update(_range(word))
        if len(degrees) > MOST_RESOLUTIONS:
            raise SettingError(f"sensor resolutions: more than {MOST_RESOLUTIONS} ({word})")
    return tuple(math.radians(degree) for degree in sorted(degrees))


def _range(word: str) -> list[float]:
    """Degrees that one word stands for."""
    wanted = f"sensor resolution {word!r}: a number of degrees, or FROM:TO:STEP with STEP above 0"
    try:
        numbers = [float(part) for part in word.split(":")]
    except ValueError as error:
        raise SettingError(wanted) from error
    if len(numbers) == 1:
        return numbers
    if len(numbers) != len(("from", "to", "step")) or not all(map(math.isfinite, numbers)):
        raise SettingError(wanted)
    first, last, step = numbers
    if not (step > 0.0 and first <= last):
        raise SettingError(wanted)
    count = min(int((last - first) / step + 1e-9), MOST_RESOLUTIONS) + 1
    return [round(first + step * index, 9) for index in range(count)]
