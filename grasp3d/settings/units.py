"""Units: conversion of texts with a unit to numbers in metres, radians or other SI units.

A length is in metres, or in the mesh's own unit if that is neither stated nor needed. Such a mesh
cannot be compared with a length that was stated with a unit, which is then refused.
"""

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Annotated, Any, Generic, Literal, TypeVar

from grasp3d.errors import SettingError
from grasp3d.settings.parsing import ParsedField, Settings

Unit = Literal["m", "cm", "mm", "in"]
METRES: dict[Unit, float] = {"m": 1.0, "cm": 0.01, "mm": 0.001, "in": 0.0254}

POUND = 0.45359237
"""International avoirdupois pound [kg]."""

MASSES: dict[str, float] = {"kg": 1.0, "g": 1e-3, "lb": POUND, "oz": POUND / 16.0}
FORCES: dict[str, float] = {"N": 1.0, "kN": 1e3, "lbf": POUND * 9.80665}
TORQUES: dict[str, float] = {"Nm": 1.0, "Ncm": 1e-2, "Nmm": 1e-3}
STIFFNESSES: dict[str, float] = {"N/m": 1.0, "N/mm": 1e3}
DENSITIES: dict[str, float] = {"kg/m^3": 1.0, "g/cm^3": 1e3, "lb/in^3": POUND / METRES["in"] ** 3}
"""Units by name, the SI unit first, with their sizes in the SI unit."""

LARGEST = 1e9
"""Largest quantity in its SI unit: larger ones are mistakes, and their squares may overflow.
"""

Radians = Annotated[float, "angle"]
"""An angle; a text on the command line, see `parse_angle`."""

ANGLE_UNITS = ("deg", "degrees", "°", "rad")
"""Units of angles in texts."""

ANGLE = "an angle (a number of degrees, or a number with a unit: deg, rad)"
"""Description of an angle's text, for messages."""

DEGREE = math.pi / 180.0

_NUMBER_AND_UNIT = re.compile(
    r"([-+]?(?:\d+\.?\d*|\.\d+)(?:e[-+]?\d+)?)\s*((?:[a-z][a-z/^0-9]*)?)", re.IGNORECASE
)
_ANGLE = re.compile(rf"(\S+?)\s*({'|'.join(ANGLE_UNITS)})?", re.IGNORECASE)

NumberT = TypeVar("NumberT", bound="float | None")
ValueT = TypeVar("ValueT")


class Metres(float):
    """A length [m] stated with a unit; it cannot be compared with a mesh of unknown unit."""

    def __str__(self) -> str:
        """Return a text that settings take for the length."""
        return f"{1000.0 * self:.15g} mm"


GivenLength = float | str
"""A length as settings take it: a number, or a text such as '80mm'."""


class Length(ParsedField[NumberT, NumberT | str], Generic[NumberT]):
    """A field of settings that holds a length in metres.

    It takes a number, or a text with a unit (m, cm, mm or in), such as '80mm' or '0.08 m'. If the
    unit of a mesh is not known, a number is in that unit, and a text with a unit is refused.
    """

    def parse(self, name: str, value: Any) -> Any:
        """See `ParsedField.parse`."""
        if value is None and self._default is not None:
            raise _no_length(name, value)
        return parse_length(name, value)


class Lengths(ParsedField[tuple[float, ...] | None, Sequence[GivenLength] | str | None]):
    """A field of settings that holds a given number of lengths, as `Length` holds one, or None.

    It takes the lengths, or a text with commas, such as '10mm,0,-2.5mm'.
    """

    def __init__(self, count: int) -> None:
        super().__init__(None)
        self._count = count

    def parse(self, name: str, value: Any) -> Any:
        """See `ParsedField.parse`."""
        return parse_lengths(name, value, self._count)

    def plain(self, value: Any) -> Any:
        """See `ParsedField.plain`."""
        return None if value is None else ",".join(map(repr, value))


class Quantity(ParsedField[NumberT, NumberT | str], Generic[NumberT]):
    """A field of settings that holds a positive number with a physical unit, or None.

    It takes a number in the SI unit, or a text with a unit, such as '500 g' or '40N', and stores
    the number in the SI unit.
    """

    def __init__(self, default: NumberT, units: Mapping[str, float]) -> None:
        super().__init__(default)
        self._units = units

    def parse(self, name: str, value: Any) -> Any:
        """See `ParsedField.parse`."""
        return None if value is None else parse_quantity(name, value, self._units)


class LengthSettings(Settings):
    """Base of settings with fields of type `Length` or `Lengths`."""

    def lengths(self) -> dict[str, Any]:
        """The lengths by name; None where a length is not set."""
        names = [name for name, one in self.parsed_fields.items() if isinstance(one, Length)]
        return {name: getattr(self, name) for name in names}


def with_lengths_scaled(value: ValueT, factor: float) -> ValueT:
    """Return settings, or their lengths, with all lengths multiplied by a factor.

    Example:
        >>> import grasp3d
        >>> from grasp3d.settings.units import with_lengths_scaled
        >>> with_lengths_scaled(grasp3d.Sampling(max_opening=80.0), 0.001).max_opening
        0.08
    """
    scaled: Any = value
    if isinstance(value, LengthSettings):
        fields = {name: (one, getattr(value, name)) for name, one in value.parsed_fields.items()}
        changed = {
            name: with_lengths_scaled(one, factor)
            for name, (kind, one) in fields.items()
            if isinstance(kind, Length | Lengths) or isinstance(one, LengthSettings)
        }
        scaled = replace(value, **changed)  # type: ignore[type-var]
    elif isinstance(value, tuple):
        scaled = tuple(with_lengths_scaled(one, factor) for one in value)
    elif isinstance(value, float):
        scaled = _converted(value, factor)
    return scaled  # type: ignore[no-any-return]


def _converted(number: float, factor: float) -> float:
    """Convert a number to another unit, rounded to 15 digits, so that 80 mm are exactly 0.08 m."""
    return float(f"{number * factor:.15g}")


def with_units(name: str, value: Any) -> Iterator[tuple[str, Metres]]:
    """Yield, by name, the lengths that were stated with a unit in settings or in one value."""
    if isinstance(value, Metres):
        yield name, value
    elif isinstance(value, tuple):
        for one in value:
            yield from with_units(name, one)
    elif isinstance(value, Settings):
        for field in value.parsed_fields:
            yield from with_units(name or field, getattr(value, field))


def parse_length(name: str, value: Any) -> Any:
    """Parse a length from a number or a text.

    Args:
        name: Name of the setting, for the error message.
        value: A number, a text, or None.

    Returns:
        None for None, `Metres` for texts with a unit except zero, otherwise a number.

    Raises:
        SettingError: The value is neither a number nor a number with a known unit.

    Example:
        >>> from grasp3d.settings.units import parse_length
        >>> parse_length("opening", "80mm"), str(parse_length("opening", "3in"))
        (0.08, '76.2 mm')
    """
    if value is None or isinstance(value, float):
        return value
    number, unit = _number(value, METRES)
    if number is None:
        raise _no_length(name, value)
    return Metres(number) if unit and number and math.isfinite(number) else number


def parse_lengths(name: str, value: Any, count: int = 3) -> Any:
    """Parse several lengths, such as those of a point; see `parse_length`.

    Args:
        name: Name of the setting, for the error message.
        value: The lengths, a text of them with commas, or None.
        count: Required number of lengths.

    Raises:
        SettingError: The value is not this number of finite lengths.

    Example:
        >>> from grasp3d.settings.units import parse_lengths
        >>> parse_lengths("center_of_mass", "10mm,0,-2.5mm")
        (0.01, 0.0, -0.0025)
    """
    if value is None:
        return None
    try:
        parts = value.split(",") if isinstance(value, str) else value
        lengths = tuple(parse_length(name, one) for one in parts)
        if len(lengths) == count and all(map(math.isfinite, lengths)):
            return lengths
    except (TypeError, SettingError):
        pass
    raise SettingError(
        f"{name} must be {count} finite lengths with commas, with or without a unit "
        f"({', '.join(METRES)}); got {value!r}"
    )


def parse_angle(name: str, text: str) -> float:
    """Parse an angle [rad] from a text, in which a number without a unit is in degrees.

    Args:
        name: Name of the setting, for the error message.
        text: A number, or a number with a unit: deg, degrees, ° or rad.

    Raises:
        SettingError: The text is not an angle.

    Example:
        >>> from grasp3d.settings.units import parse_angle
        >>> parse_angle("search_angle", "0.26rad"), round(parse_angle("search_angle", "15 deg"), 4)
        (0.26, 0.2618)
    """
    match = _ANGLE.fullmatch(text.strip())
    try:
        number = float(match[1] if match else text)
    except ValueError as error:
        raise SettingError(f"{name} must be {ANGLE}; got {text!r}") from error
    in_radians = match is not None and (match[2] or "").lower() == "rad"
    return number if in_radians else math.radians(number)


def parse_quantity(name: str, value: object, units: Mapping[str, float]) -> float:
    """Convert a quantity to its SI unit.

    Args:
        name: Name of the setting, for the error message.
        value: A number in the SI unit, or a text of a number, with or without a unit.
        units: Accepted units by name, the SI unit first, with their sizes in the SI unit.

    Raises:
        SettingError: It is neither, it is not finite and above 0, or it is above `LARGEST`.

    Example:
        >>> from grasp3d.settings.units import MASSES, parse_quantity
        >>> parse_quantity("mass", "500 g", MASSES)
        0.5
    """
    si, (number, _) = next(iter(units)), _number(value, units)
    if number is None:
        symbols = ", ".join(units)
        raise SettingError(
            f"{name} must be a number [{si}], or a number with a unit ({symbols}); got {value!r}"
        )
    if not (number > 0.0 and math.isfinite(number)):
        raise SettingError(f"{name} must be finite and above 0 [{si}]; got {value}")
    if number > LARGEST:
        raise SettingError(f"{name} must be at most {LARGEST:g} [{si}]; got {value}")
    return number


def _number(value: Any, units: Mapping[Any, float]) -> tuple[float | None, str]:
    """Return the number in the SI unit, or None if it is not a quantity, and the text's unit."""
    if not isinstance(value, str):  # arrays of several numbers have `__float__`, too
        single = hasattr(value, "__float__") and getattr(value, "shape", ()) == ()
        return (float(value) if single and not isinstance(value, bool) else None), ""
    text = value.strip()
    if text.lower().lstrip("+-") in {"inf", "nan"}:
        return float(text), ""
    match = _NUMBER_AND_UNIT.fullmatch(text)
    unit = match[2].lower().replace("^", "") if match else ""
    multiples = {one.lower().replace("^", ""): size for one, size in units.items()}
    if match is None or unit not in {"", *multiples}:
        return None, unit
    number = float(match[1])
    return _converted(number, multiples[unit]) if unit else number, unit


def describe_length(length: float) -> str:
    """Format a length for messages: 4 digits, and its unit if it was stated with one."""
    return small_length(length, metres=isinstance(length, Metres))


def small_length(length: float, *, metres: bool, digits: int = 4) -> str:
    """Format a length for reports, in millimetres, or in metres from a metre on.

    Args:
        length: The length.
        metres: Whether it is in metres; otherwise its unit is not known.
        digits: Significant digits.

    Example:
        >>> from grasp3d.settings.units import small_length
        >>> small_length(0.001, metres=True), small_length(0.25, metres=False)
        ('1 mm', '0.25')
    """
    if not metres:
        return f"{length:.{digits}g}"
    return f"{length:.{digits}g} m" if length >= 1.0 else f"{1000.0 * length:.{digits}g} mm"


def _no_length(name: str, value: object) -> SettingError:
    units = ", ".join(METRES)
    return SettingError(
        f"{name} must be a length: a number, or a number with a unit ({units}); got {value!r}"
    )
