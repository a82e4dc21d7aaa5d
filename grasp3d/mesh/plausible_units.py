"""Units in which an object is plausible."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import get_args

from grasp3d.settings.units import METRES, Unit

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
    usual = fitting_units(size, USUAL)
    likely = tuple(unit for unit in PREFERRED if unit in usual)
    if not likely:
        plausible = fitting_units(size, PLAUSIBLE)
        likely = tuple(unit for unit in plausible if unit in usual or unit in PREFERRED)
    unit, units, remark = None, get_args(Unit), "; no hand holds any of these"
    if len(likely) > 1:
        units, remark = likely, "; these are equally plausible"
    elif likely:
        unit, units, remark = likely[0], tuple(dict.fromkeys((*likely, *PREFERRED))), ""
    sizes = ", ".join(f"{length_text(size * METRES[one])} if {one}" for one in units)
    return UnitGuess(unit, f"largest extent {size:.4g}: {sizes}{remark}")


def unit_warning(size: float, unit: Unit) -> str:
    """Warning that a stated unit is implausible; empty where it is plausible.

    Args:
        size: Size of the object, in that unit.
        unit: The unit that the file or the user states.
    """
    if unit in fitting_units(size, PLAUSIBLE):
        return ""
    text = f"the object is {length_text(size * METRES[unit])} large if its unit is {unit}"
    guess = guess_unit(size).unit
    better = fitting_units(size, PLAUSIBLE) if guess is None else (guess,)
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
    least, most = POSSIBLE
    if any(least <= size * METRES[one] <= most for one in ((unit,) if unit else get_args(Unit))):
        return ""
    text = length_text(size * METRES[unit]) if unit else f"{size:.2g} in any unit"
    return (
        f"the object is {text} large: no object to grasp is; is the transform of a part or a "
        "vertex of the file wrong?"
    )


def length_text(metres: float) -> str:
    """Write a length to two digits, in metres, centimetres or millimetres."""
    for unit in ("m", "cm", "mm"):
        rounded = float(f"{metres / METRES[unit]:.2g}")
        if rounded >= 1.0:
            break
    return f"{rounded:g} {unit}"


def fitting_units(size: float, limits: tuple[float, float]) -> tuple[Unit, ...]:
    """Units in which a size is within limits [m]."""
    least, most = limits[0] * (1.0 - _ROUNDING), limits[1] * (1.0 + _ROUNDING)
    return tuple(unit for unit in get_args(Unit) if least <= size * METRES[unit] <= most)


def _listed(words: Sequence[str]) -> str:
    return " or ".join(filter(None, [", ".join(words[:-1]), words[-1]]))
