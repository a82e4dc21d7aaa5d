"""Units in which an object is plausible."""

from dataclasses import dataclass
from typing import get_args

from grasp3d.errors import SettingError
from grasp3d.settings.units import METRES, Unit

PLAUSIBLE = (0.002, 2.0)
"""Sizes of objects that a hand can hold [m]."""

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
    """Guess the unit of a mesh that states none.

    Args:
        size: Largest extent of the object, in the unknown unit.
    """
    usual, plausible = _fitting(size, USUAL), _fitting(size, PLAUSIBLE)
    likely = [unit for unit in PREFERRED if unit in usual]
    likely = likely or [unit for unit in plausible if unit in (*usual, *PREFERRED)]
    sizes = ", ".join(f"{length_text(size * METRES[one])} if {one}" for one in METRES)
    reason = f"largest extent {size:.4g}: {sizes}"
    return UnitGuess(likely[0] if len(likely) == 1 else None, reason)


def unit_warning(size: float, unit: Unit | None) -> str:
    """Warning that a stated unit is implausible; empty if it is plausible, or not stated.

    Args:
        size: Size of the object, in that unit.
        unit: The unit that the file or the user states.
    """
    if unit is None or unit in _fitting(size, PLAUSIBLE):
        return ""
    text = f"the object measures {length_text(size * METRES[unit])} if its unit is {unit}"
    guess = guess_unit(size).unit
    better = _fitting(size, PLAUSIBLE) if guess is None else [guess]
    if not better:
        return (
            f"{text}; no unit (m, cm, mm, in) makes it one that a hand may hold: is a vertex, or "
            "the transform of a part, wrong?"
        )
    sizes = " or ".join(length_text(size * METRES[other]) for other in better)
    return f"{text}: is the unit right? If its unit were {' or '.join(better)} it would be {sizes}"


def guessed_unit(where: str, size: float) -> tuple[Unit, str]:
    """Guess the unit of a mesh, and return it with a warning that it is a guess.

    Args:
        where: The mesh, for the error.
        size: Its largest extent, in its unit.

    Raises:
        SettingError: No unit is likely, or several are equally so.
    """
    guess = guess_unit(size)
    if guess.unit is None:
        raise SettingError(f"{where}: its unit cannot be guessed ({guess.reason}); state it")
    return guess.unit, f"its unit, {guess.unit}, is a guess ({guess.reason})"


def unknown_unit(what: str, source: str, size: float) -> SettingError:
    """Make the error for a mesh whose unit is needed but not known.

    Args:
        what: What needs it, as the start of the message.
        source: Name of the mesh.
        size: Its largest extent, in its unit.
    """
    guess = guess_unit(size)
    return SettingError(
        f"{what}, but the unit of {source} is not known ({guess.reason}): add --unit "
        f"{guess.unit or '...'} (in Python unit={guess.unit or '...'!r})"
    )


def length_text(metres: float) -> str:
    """Write a length to two digits, in metres, centimetres or millimetres."""
    for unit in ("m", "cm", "mm"):
        rounded = float(f"{metres / METRES[unit]:.2g}")
        if rounded >= 1.0:
            break
    return f"{rounded:g} {unit}"


def _fitting(size: float, limits: tuple[float, float]) -> list[Unit]:
    """Units in which a size is within limits [m]."""
    least, most = limits[0] * (1.0 - _ROUNDING), limits[1] * (1.0 + _ROUNDING)
    return [unit for unit in get_args(Unit) if least <= size * METRES[unit] <= most]
