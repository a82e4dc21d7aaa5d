"""Units of length: which of them makes an object one that a hand may hold."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import get_args

from grasp3d.settings import Unit

METRES: dict[Unit, float] = {"m": 1.0, "cm": 0.01, "mm": 0.001, "in": 0.0254}

PLAUSIBLE = (0.002, 2.0)
"""Sizes of objects that a hand may hold [m]."""

USUAL = (0.01, 0.5)
"""Sizes of most such objects [m]."""

PREFERRED: tuple[Unit, ...] = ("m", "mm")
"""Units of robotics and of CAD. No object has a usual size in both."""

_ROUNDING = 1e-9


@dataclass(frozen=True)
class UnitGuess:
    """Which unit a mesh's numbers may have."""

    unit: Unit | None
    """The likely one; None where none is, or several are equally so."""
    reason: str
    """Why, in one sentence."""


def guess_unit(size: float) -> UnitGuess:
    """Guess the unit of a mesh that states none, to be told and never applied.

    Args:
        size: Largest extent of the object, in the unit that is sought.
    """
    usual = _fitting(size, USUAL)
    likely = tuple(unit for unit in PREFERRED if unit in usual)
    if not likely:
        plausible = _fitting(size, PLAUSIBLE)
        likely = tuple(unit for unit in plausible if unit in usual or unit in PREFERRED)
    if not likely:
        told = _told(size, get_args(Unit))
        return UnitGuess(None, f"largest extent {size:.4g}: {told}; no hand holds any of these")
    if len(likely) > 1:
        told = _told(size, likely)
        return UnitGuess(None, f"largest extent {size:.4g}: {told}; these are equally plausible")
    told = _told(size, dict.fromkeys((*likely, *PREFERRED)))
    return UnitGuess(likely[0], f"largest extent {size:.4g}: {told}")


def unit_warning(size: float, unit: Unit) -> str:
    """Say why a stated unit is hardly right; empty where it may be.

    Args:
        size: Size of the object, in that unit.
        unit: The unit that the file or the user states.
    """
    if unit in _fitting(size, PLAUSIBLE):
        return ""
    doubt = f"the object is {length_text(size * METRES[unit])} large if its unit is {unit}"
    guess = guess_unit(size).unit
    better = _fitting(size, PLAUSIBLE) if guess is None else (guess,)
    if not better:
        return f"{doubt}; no unit (m, cm, mm, in) makes it one that a hand may hold"
    sizes = _listed([length_text(size * METRES[other]) for other in better])
    return f"{doubt}: is the unit right? If its unit were {_listed(better)} it would be {sizes}"


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


def _told(size: float, units: Iterable[Unit]) -> str:
    return ", ".join(f"{length_text(size * METRES[unit])} if {unit}" for unit in units)


def _listed(words: Sequence[str]) -> str:
    return " or ".join(filter(None, [", ".join(words[:-1]), words[-1]]))
