"""Masses, densities and forces in settings: numbers in SI units, or texts with a unit."""

import math
from collections.abc import Mapping
from typing import Any, Generic, TypeVar

from grasp3d.errors import SettingError
from grasp3d.settings.lengths import METRES, NUMBER_AND_UNIT, is_number
from grasp3d.settings.parsing import ParsedField

POUND = 0.45359237
"""International avoirdupois pound [kg]."""

MASSES: dict[str, float] = {"kg": 1.0, "g": 1e-3, "lb": POUND, "oz": POUND / 16.0}
FORCES: dict[str, float] = {"N": 1.0, "kN": 1e3, "lbf": POUND * 9.80665}
TORQUES: dict[str, float] = {"Nm": 1.0, "Ncm": 1e-2, "Nmm": 1e-3}
STIFFNESSES: dict[str, float] = {"N/m": 1.0, "N/mm": 1e3}
DENSITIES: dict[str, float] = {"kg/m^3": 1.0, "g/cm^3": 1e3, "lb/in^3": POUND / METRES["in"] ** 3}
"""Units by name, the SI unit first, as multiples of it."""

LARGEST = 1e9
"""Largest quantity in its SI unit: larger ones are mistakes, and overflow where they are squared.
"""

QuantityT = TypeVar("QuantityT", bound="float | None")


class Quantity(ParsedField[QuantityT, QuantityT | str], Generic[QuantityT]):
    """A field of settings that holds a positive number with a physical unit, or none.

    It takes a number in the SI unit, or a text with a unit, such as '500 g' or '40N', and holds the
    number in the SI unit.
    """

    def __init__(self, default: QuantityT, units: Mapping[str, float]) -> None:
        super().__init__(default)
        self._units = units

    def parse(self, name: str, value: Any) -> Any:
        """See `ParsedField.parse`."""
        return None if value is None else parse_quantity(name, value, self._units)


def parse_quantity(name: str, value: object, units: Mapping[str, float]) -> float:
    """A quantity in its SI unit.

    Args:
        name: Name of the setting, for the error.
        value: A number in the SI unit, or a text of a number, with a unit or without.
        units: Its units by name, the SI unit first, as multiples of it.

    Raises:
        SettingError: It is neither, or it is not finite and above 0, or it is above `LARGEST`.

    Example:
        >>> from grasp3d.settings.quantities import MASSES, parse_quantity
        >>> parse_quantity("mass", "500 g", MASSES)
        0.5
    """
    number = _number(value, units)
    if number is None:
        raise _no_quantity(name, value, units)
    if not (number > 0.0 and math.isfinite(number)):
        raise SettingError(f"{name} must be finite and above 0 [{next(iter(units))}]; got {value}")
    if number > LARGEST:
        raise SettingError(f"{name} must be at most {LARGEST:g} [{next(iter(units))}]; got {value}")
    return number


def _number(value: object, units: Mapping[str, float]) -> float | None:
    """The number in the SI unit; None: it is no such quantity."""
    if not isinstance(value, str):
        return float(value) if is_number(value) else None  # type: ignore[arg-type]
    text = value.strip()
    if text.lower().lstrip("+-") in {"inf", "nan"}:
        return float(text)
    match = NUMBER_AND_UNIT.fullmatch(text)
    if match is None:
        return None
    number, unit = float(match[1]), match[2]
    if not unit:
        return number
    for symbol, multiple in units.items():
        if symbol.lower().replace("^", "") == unit.lower().replace("^", ""):
            # To 15 digits, so that 300 g are 0.3 kg and not 0.3 and a rounding error.
            return float(f"{number * multiple:.15g}")
    return None


def _no_quantity(name: str, value: object, units: Mapping[str, float]) -> SettingError:
    symbols = ", ".join(units)
    return SettingError(
        f"{name} must be a number [{next(iter(units))}], or a number with a unit ({symbols}); "
        f"got {value!r}"
    )
