"""Units: a text with a unit becomes a number in metres, radians or another SI unit, once.

A length is in metres, or in the mesh's own unit where nobody states that unit and nothing needs
it: there a length that was stated with a unit cannot be compared with the mesh, and is refused.
"""

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Annotated, Any, Generic, Literal, TypeVar

from grasp3d.errors import SettingError
from grasp3d.settings.parsing import ParsedField, Settings, TextValue

Unit = Literal["m", "cm", "mm", "in"]
METRES: dict[Unit, float] = {"m": 1.0, "cm": 0.01, "mm": 0.001, "in": 0.0254}

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

Radians = Annotated[float, "angle"]
"""An angle; on the command line it is a text, see `parse_angle`."""

ANGLE_UNITS = ("deg", "degrees", "°", "rad")
"""Units of angles in texts."""

ANGLE = "an angle (a number of degrees, or a number with a unit: deg, rad)"
"""What the text of an angle must be, for messages."""

DEGREE = math.pi / 180.0

_NUMBER_AND_UNIT = re.compile(
    r"([-+]?(?:\d+\.?\d*|\.\d+)(?:e[-+]?\d+)?)\s*((?:[a-z][a-z/^0-9]*)?)", re.IGNORECASE
)
_ANGLE = re.compile(rf"(\S+?)\s*({'|'.join(ANGLE_UNITS)})?", re.IGNORECASE)

LengthT = TypeVar("LengthT", bound="float | None")
QuantityT = TypeVar("QuantityT", bound="float | None")
ValueT = TypeVar("ValueT")


class Metres(float, TextValue):
    """A length [m] that was stated with a unit: of a mesh without one it says nothing."""

    __slots__ = ()

    def __str__(self) -> str:
        """The text that settings take for it."""
        return f"{1000.0 * self:.15g} mm"


GivenLength = float | str
"""A length as settings take it: a number, or a text such as '80mm'."""


class Length(ParsedField[LengthT, LengthT | str], Generic[LengthT]):
    """A field of settings that holds a length in metres.

    It takes a number, or a text with a unit (m, cm, mm or in), such as '80mm' or '0.08 m'. Where
    the unit of a mesh is not known, a number is in that unit, and a text with another is refused.
    """

    def parse(self, name: str, value: Any) -> Any:
        """See `ParsedField.parse`."""
        if value is None and self._default is not None:
            raise _no_length(name, value)
        return parse_length(name, value)


class Lengths(ParsedField[tuple[float, ...], Sequence[GivenLength]]):
    """A field of settings that holds any number of lengths, as those of `Length`."""

    def parse(self, name: str, value: Any) -> Any:
        """See `ParsedField.parse`."""
        return tuple(parse_length(name, one) for one in value)


class Position(ParsedField[tuple[float, float, float] | None, Sequence[GivenLength] | str | None]):
    """A field of settings that holds a point: three lengths, as those of `Length`, or none.

    It takes three of them, or a text with commas, such as '10mm,0,-2.5mm'.
    """

    def parse(self, name: str, value: Any) -> Any:
        """See `ParsedField.parse`."""
        return parse_position(name, value)


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


class LengthSettings(Settings):
    """Settings, frozen dataclasses, with fields of type `Length` or `Position`."""

    def lengths(self) -> dict[str, Any]:
        """The lengths by name; none where there is none."""
        names = [name for name, one in self.parsed_fields.items() if isinstance(one, Length)]
        return {name: getattr(self, name) for name in names}


def with_lengths_scaled(value: ValueT, factor: float) -> ValueT:
    """Settings, or a value of one, with all lengths multiplied by a factor.

    Example:
        >>> import grasp3d
        >>> from grasp3d.settings.units import with_lengths_scaled
        >>> with_lengths_scaled(grasp3d.Sampling(max_opening=80.0), 0.001).max_opening
        0.08
    """
    scaled: Any = value
    if isinstance(value, LengthSettings):
        kinds = (Length, Lengths, Position)
        lengths = {
            name: _scaled(getattr(value, name), factor)
            for name, field in value.parsed_fields.items()
            if isinstance(field, kinds)
        }
        inner = {
            name: with_lengths_scaled(getattr(value, name), factor)
            for name in value.parsed_fields
            if isinstance(getattr(value, name), LengthSettings)
        }
        scaled = replace(value, **lengths, **inner)  # type: ignore[type-var]
    return scaled  # type: ignore[no-any-return]


def _scaled(length: Any, factor: float) -> Any:
    if isinstance(length, tuple):
        return tuple(_scaled(one, factor) for one in length)
    return None if length is None else _converted(length, factor)


def _converted(number: float, factor: float) -> float:
    """A number in another unit, to 15 digits: 80 mm are 0.08 m, and not a rounding error more."""
    return float(f"{number * factor:.15g}")


def with_units(name: str, value: Any) -> Iterator[tuple[str, Metres]]:
    """The lengths in settings, or in a value of one, that were stated with a unit, by name."""
    if isinstance(value, Metres):
        yield name, value
    elif isinstance(value, tuple):
        for one in value:
            yield from with_units(name, one)
    elif isinstance(value, Settings):
        for field in value.parsed_fields:
            yield from with_units(name or field, getattr(value, field))


def parse_length(name: str, value: Any) -> Any:
    """A length from a number or a text.

    Args:
        name: Name of the setting, for the error.
        value: A number, a text, or none.

    Returns:
        Numbers, and none, as they are; texts without a unit, and zero, as numbers; texts with a
        unit as `Metres`.

    Raises:
        SettingError: It is neither a number nor a number with a known unit.

    Example:
        >>> from grasp3d.settings.units import parse_length
        >>> parse_length("opening", "80mm"), str(parse_length("opening", "3in"))
        (0.08, '76.2 mm')
    """
    if not isinstance(value, str):
        if value is None or isinstance(value, float) or is_number(value):
            return value
        raise _no_length(name, value)
    text = value.strip()
    if text.lower() in {"inf", "nan"}:
        return float(text)
    match = _NUMBER_AND_UNIT.fullmatch(text)
    unit: Any = match[2].lower() if match else "none"
    if match is None or unit not in {"", *METRES}:
        raise _no_length(name, value)
    number = float(match[1])
    if not (unit and number and math.isfinite(number)):
        return number
    return Metres(_converted(number, METRES[unit]))


def parse_position(name: str, value: Any) -> Any:
    """A point from three lengths; see `parse_length`.

    Args:
        name: Name of the setting, for the error.
        value: Three lengths, a text of three with commas, or none.

    Raises:
        SettingError: It is no such point, or not finite.

    Example:
        >>> from grasp3d.settings.units import parse_position
        >>> parse_position("center_of_mass", "10mm,0,-2.5mm")
        (0.01, 0.0, -0.0025)
    """
    if value is None:
        return None
    parts = value.split(",") if isinstance(value, str) else value
    try:
        found = [parse_length(name, one) for one in parts]
        lengths = tuple(one if isinstance(one, Metres) else float(one) for one in found)
    except (TypeError, SettingError):
        lengths = ()
    if len(lengths) != 3 or not all(map(math.isfinite, lengths)):
        raise SettingError(
            f"{name} must be three finite lengths, x,y,z, with or without a unit "
            f"({', '.join(METRES)}); got {value!r}"
        )
    return lengths


def parse_angle(name: str, text: str) -> float:
    """An angle [rad] from a text, in which a number without a unit is one of degrees.

    Args:
        name: Name of the setting, for the error message.
        text: A number, or a number with a unit: deg, degrees, ° or rad.

    Raises:
        SettingError: It is no such text.

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
    """A quantity in its SI unit.

    Args:
        name: Name of the setting, for the error.
        value: A number in the SI unit, or a text of a number, with a unit or without.
        units: Its units by name, the SI unit first, as multiples of it.

    Raises:
        SettingError: It is neither, or it is not finite and above 0, or it is above `LARGEST`.

    Example:
        >>> from grasp3d.settings.units import MASSES, parse_quantity
        >>> parse_quantity("mass", "500 g", MASSES)
        0.5
    """
    si, number = next(iter(units)), _number(value, units)
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


def _number(value: object, units: Mapping[str, float]) -> float | None:
    """The number in the SI unit; None: it is no such quantity."""
    if not isinstance(value, str):
        return float(value) if is_number(value) else None  # type: ignore[arg-type]
    text = value.strip()
    if text.lower().lstrip("+-") in {"inf", "nan"}:
        return float(text)
    match = _NUMBER_AND_UNIT.fullmatch(text)
    if match is None:
        return None
    number, unit = float(match[1]), match[2].lower().replace("^", "")
    if not unit:
        return number
    for symbol, multiple in units.items():
        if symbol.lower().replace("^", "") == unit:
            return _converted(number, multiple)
    return None


def one_line(numbers: tuple[float, ...] | None) -> str | None:
    """Numbers as a text with commas, which settings that hold several of them take."""
    return None if numbers is None else ",".join(map(repr, numbers))


def describe_length(length: float | None) -> str:
    """A length for messages: 4 digits, and its unit if it was stated with one."""
    if length is None:
        return "none"
    return small_length(length, metres=True) if isinstance(length, Metres) else f"{length:.4g}"


def small_length(length: float, *, metres: bool, digits: int = 4) -> str:
    """A length that is small beside the object, for reports: in millimetres.

    Args:
        length: The length.
        metres: Whether it is in metres; otherwise its unit is not known.
        digits: Significant digits.

    Example:
        >>> from grasp3d.settings.units import small_length
        >>> small_length(0.001, metres=True), small_length(0.25, metres=False)
        ('1 mm', '0.25')
    """
    return f"{1000.0 * length:.{digits}g} mm" if metres else f"{length:.{digits}g}"


def is_number(value: object) -> bool:
    """Whether it is one number; arrays of several have `__float__` too."""
    single = getattr(value, "shape", ()) == ()
    return hasattr(value, "__float__") and single and not isinstance(value, bool)


def _no_length(name: str, value: object) -> SettingError:
    units = ", ".join(METRES)
    return SettingError(
        f"{name} must be a length: a number, or a number with a unit ({units}); got {value!r}"
    )
