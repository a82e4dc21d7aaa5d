"""Units of length, and which of them gives an object a plausible size for grasping."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import get_args

from grasp3d.settings.lengths import METRES, Unit

PLAUSIBLE = (0.002, 2.0)
"""Sizes of objects that a hand can hold [m]."""

POSSIBLE = (2e-6, 2e3)
"""Sizes beyond which a wrong unit is no explanation [m]: the units differ by up to 1000."""

USUAL = (0.01, 0.5)
"""Sizes of most such objects [m]."""

PREFERRED: tuple[Unit, ...] = ("m", "mm")
"""Units of robotics and of CAD. No object has a usual size in both."""

_ROUNDING = 1e-9


@dataclass(frozen=True)
class UnitGuess:
    """Likely unit of a mesh's coordinates."""

    unit: Unit | None
    """The likely unit; None if none is plausible, or several are equally so."""
    reason: str
    """Reason, in one sentence."""


def guess_unit(size: float) -> UnitGuess:
    """Guess the unit of a mesh that states none; the guess is reported and never applied.

    Args:
        size: Largest extent of the object, in the unknown unit.
    """
    usual = _fitting(size, USUAL)
    likely = tuple(unit for unit in PREFERRED if unit in usual)
    if not likely:
        plausible = _fitting(size, PLAUSIBLE)
        likely = tuple(unit for unit in plausible if unit in usual or unit in PREFERRED)
    if not likely:
        sizes = _size_texts(size, get_args(Unit))
        return UnitGuess(None, f"largest extent {size:.4g}: {sizes}; no hand holds any of these")
    if len(likely) > 1:
        sizes = _size_texts(size, likely)
        return UnitGuess(None, f"largest extent {size:.4g}: {sizes}; these are equally plausible")
    sizes = _size_texts(size, dict.fromkeys((*likely, *PREFERRED)))
    return UnitGuess(likely[0], f"largest extent {size:.4g}: {sizes}")


def unit_warning(size: float, unit: Unit) -> str:
    """Warning that a stated unit is implausible; empty where it is plausible.

    Args:
        size: Size of the object, in that unit.
        unit: The unit that the file or the user states.
    """
    if unit in _fitting(size, PLAUSIBLE):
        return ""
    text = f"the object is {length_text(size * METRES[unit])} large if its unit is {unit}"
    guess = guess_unit(size).unit
    better = _fitting(size, PLAUSIBLE) if guess is None else (guess,)
    if not better:
        return f"{text}; no unit (m, cm, mm, in) makes it one that a hand may hold"
    sizes = _listed([length_text(size * METRES[other]) for other in better])
    return f"{text}: is the unit right? If its unit were {_listed(better)} it would be {sizes}"


def impossible_size(size: float, unit: Unit | None) -> str:
    """Warning that an object cannot have a size; empty where it can.

    Args:
        size: Size of the object, in its unit.
        unit: The unit; None: not stated.
    """
    if any(_possible(size, known) for known in ((unit,) if unit else get_args(Unit))):
        return ""
    shown = length_text(size * METRES[unit]) if unit else f"{size:.2g} in any unit"
    return (
        f"the object is {shown} large: no object to grasp is; is the transform of a part or a "
        "vertex of the file wrong?"
    )


def _possible(size: float, unit: Unit) -> bool:
    return POSSIBLE[0] <= size * METRES[unit] <= POSSIBLE[1]


def length_text(metres: float) -> str:
    """Write a length to two digits, in metres, centimetres or millimetres."""
    for name in ("m", "cm"):
        if (rounded := _two_digits(metres / METRES[name])) >= 1.0:
            return f"{rounded:g} {name}"
    return f"{_two_digits(metres / METRES['mm']):g} mm"


def _two_digits(value: float) -> float:
    return float(f"{value:.2g}")


def _fitting(size: float, limits: tuple[float, float]) -> tuple[Unit, ...]:
    """Units in which a size is within limits [m]."""
    least, most = limits[0] * (1.0 - _ROUNDING), limits[1] * (1.0 + _ROUNDING)
    return tuple(unit for unit in get_args(Unit) if least <= size * METRES[unit] <= most)


def _size_texts(size: float, units: Iterable[Unit]) -> str:
    return ", ".join(f"{length_text(size * METRES[unit])} if {unit}" for unit in units)


def _listed(words: Sequence[str]) -> str:
    return " or ".join(filter(None, [", ".join(words[:-1]), words[-1]]))
