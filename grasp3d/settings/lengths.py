"""Lengths in settings: numbers in the mesh's unit, or texts with a unit of their own."""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Generic, Literal, TypeVar, TypeVarTuple

from grasp3d.errors import SettingError
from grasp3d.settings.parsing import ParsedField, Settings, TextValue

Unit = Literal["m", "cm", "mm", "in"]
METRES: dict[Unit, float] = {"m": 1.0, "cm": 0.01, "mm": 0.001, "in": 0.0254}

LengthT = TypeVar("LengthT", bound="float | None")
SettingsTs = TypeVarTuple("SettingsTs")

NUMBER_AND_UNIT = re.compile(
    r"([-+]?(?:\d+\.?\d*|\.\d+)(?:e[-+]?\d+)?)\s*((?:[a-z][a-z/^0-9]*)?)", re.IGNORECASE
)
"""Text of a number with a unit or without."""


@dataclass(frozen=True, repr=False)
class Measure(TextValue):
    """A length with its unit; zero and infinity need none, and are numbers."""

    number: float
    unit: Unit

    def __str__(self) -> str:
        return f"{self:.15g}"

    def __format__(self, spec: str) -> str:
        return f"{self.number:{spec}} {self.unit}" if spec else str(self)

    def __repr__(self) -> str:
        """The text that settings take for it."""
        return repr(str(self))

    @property
    def metres(self) -> float:
        """The length [m]."""
        return self.number * METRES[self.unit]

    def in_unit(self, unit: Unit) -> float:
        """The length as a number in a unit.

        To 15 digits, so that 80 mm are 0.08 m and not 0.08 and a rounding error.
        """
        if unit == self.unit:
            return self.number
        return float(f"{self.metres / METRES[unit]:.15g}")


AnyLength = float | Measure
"""A length: a number in the mesh's unit, or with a unit of its own."""

GivenLength = float | str | Measure
"""A length as settings take it: also a text, such as '80mm'."""


class Length(ParsedField[LengthT, LengthT | str | Measure], Generic[LengthT]):
    """A field of settings that holds a length.

    It takes a number, in the mesh's unit, or a text with a unit (m, cm, mm or in), such as '80mm'
    or '0.08 m', and then holds a `Measure` until the settings meet a mesh (`settings_in_unit`);
    where a length is computed with, it is a number.
    """

    def parse(self, name: str, value: Any) -> Any:
        """See `ParsedField.parse`."""
        if value is None and self._default is not None:
            raise _no_length(name, value)
        return parse_length(name, value)


class Lengths(ParsedField[tuple[AnyLength, ...], Sequence[GivenLength]]):
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


class LengthSettings(Settings):
    """Settings, frozen dataclasses, with fields of type `Length` or `Position`."""

    @classmethod
    def length_names(cls) -> tuple[str, ...]:
        """Names of the fields that are lengths."""
        return tuple(name for name, one in cls.parsed_fields.items() if isinstance(one, Length))

    def lengths(self) -> dict[str, Any]:
        """The lengths by name: numbers, with a unit, or none."""
        return {name: getattr(self, name) for name in self.length_names()}


def settings_in_unit(
    unit: Unit | None, *settings: *SettingsTs, source: str = "the mesh"
) -> tuple[*SettingsTs]:
    """Settings with every length as a number.

    Args:
        unit: Unit of the numbers: that of the mesh; None: it is not known.
        settings: Settings, or None, which stays None.
        source: Name of the mesh, for the error.

    Raises:
        SettingError: A length has a unit, but that of the mesh is not known.

    Example:
        >>> import grasp3d
        >>> from grasp3d.settings.lengths import settings_in_unit
        >>> settings_in_unit("m", grasp3d.GraspModel(location_error="2mm"))[0].location_error
        0.002
    """
    converted: Any = tuple(_in_unit("", one, unit, source) for one in settings)
    return converted  # type: ignore[no-any-return]


def _in_unit(name: str, value: Any, unit: Unit | None, source: str) -> Any:
    """A value of settings, or settings, with every length in it as a number."""
    if isinstance(value, Measure):
        return length_in_unit(name, value, unit, source=source)
    if isinstance(value, tuple):
        parts = [_in_unit(name, one, unit, source) for one in value]
        same = all(one is other for one, other in zip(parts, value, strict=True))
        return value if same else type(value)(parts)
    if not isinstance(value, Settings):
        return value
    lengths = {name: getattr(value, name) for name in value.parsed_fields}
    converted = {name: _in_unit(name, one, unit, source) for name, one in lengths.items()}
    changed = {name: one for name, one in converted.items() if one is not lengths[name]}
    return replace(value, **changed) if changed else value  # type: ignore[type-var]


def parse_length(name: str, value: Any) -> Any:
    """Check a length and write it in one way.

    Args:
        name: Name of the setting, for the error.
        value: A number, a text, or none.

    Returns:
        Numbers, and none, as they are; texts without a unit, and zero, as numbers; texts with a
        unit as a `Measure`, of 15 digits.

    Raises:
        SettingError: It is neither a number nor a number with a known unit.
    """
    if not isinstance(value, str):
        if value is None or isinstance(value, float | Measure) or is_number(value):
            return value
        raise _no_length(name, value)
    text = value.strip()
    match = NUMBER_AND_UNIT.fullmatch(text)
    if match is None:
        if text.lower() in {"inf", "nan"}:
            return float(text)
        raise _no_length(name, value)
    number, suffix = float(match[1]), match[2].lower()
    if not suffix:
        return number
    unit = next((known for known in METRES if known == suffix), None)
    if unit is None:
        raise _no_length(name, value)
    return measure(number, unit)


def measure(number: float, unit: Unit | None) -> AnyLength:
    """A length with a unit, or without one, to 15 digits: the third of 0.1 mm is 0.3 mm."""
    rounded = float(f"{number:.15g}")
    if unit is None or not (rounded and math.isfinite(rounded)):
        return rounded
    return Measure(rounded, unit)


def parse_position(name: str, value: Any) -> Any:
    """Check a point and write its lengths in one way; see `parse_length`.

    Args:
        name: Name of the setting, for the error.
        value: Three lengths, a text of three with commas, or none.

    Raises:
        SettingError: It is no such point, or not finite.

    Example:
        >>> from grasp3d.settings.lengths import parse_position
        >>> parse_position("center_of_mass", "10mm,0,-2.5mm")
        ('10 mm', 0.0, '-2.5 mm')
    """
    if value is None:
        return None
    parts = value.split(",") if isinstance(value, str) else value
    try:
        lengths = tuple(parse_length(name, one) for one in parts)
    except (TypeError, SettingError):
        lengths = ()
    lengths = tuple(one if isinstance(one, Measure | None) else float(one) for one in lengths)
    numbers = [one for one in lengths if not isinstance(one, Measure)]
    if len(lengths) != 3 or None in lengths or not all(map(math.isfinite, numbers)):
        raise SettingError(
            f"{name} must be three finite lengths, x,y,z, with or without a unit "
            f"({', '.join(METRES)}); got {value!r}"
        )
    return lengths


def one_line(numbers: tuple[float, ...] | None) -> str | None:
    """Numbers as a text with commas, which settings that hold several of them take."""
    return None if numbers is None else ",".join(map(repr, numbers))


def length_in_unit(
    name: str, value: GivenLength | None, unit: Unit | None, *, source: str = "the mesh"
) -> Any:
    """A length as a number in a unit.

    Args:
        name: Name of the setting, for the error.
        value: A number in that unit, a length with a unit, or none.
        unit: The unit; None: it is not known.
        source: Name of the mesh, for the error.

    Raises:
        SettingError: It has a unit, but that of the mesh is not known.
    """
    length = parse_length(name, value)
    if not isinstance(length, Measure):
        return length
    return length.in_unit(known_unit(unit, f"{name} is {length}", source))


def known_unit(unit: Unit | None, what: str, source: str) -> Unit:
    """The unit of a mesh; `what` needs it, and `source` is its name, for the error.

    Raises:
        SettingError: It is not known.
    """
    if unit is None:
        raise SettingError(
            f"{what}, but the unit of {source} is not known: give the unit of its coordinates "
            "(--unit, in Python unit=...)"
        )
    return unit


def comparable(*lengths: AnyLength | None) -> tuple[float, ...] | None:
    """Lengths as numbers in one unit, zero and infinity in any; None: some have a unit, some not.

    Args:
        lengths: Lengths as settings hold them; none counts as 0.
    """
    values = [length or 0.0 for length in lengths]
    numbers = [one for one in values if not isinstance(one, Measure)]
    if len(numbers) < len(values) and any(0.0 < abs(one) < math.inf for one in numbers):
        return None
    return tuple(one.metres if isinstance(one, Measure) else one for one in values)


def describe_length(length: AnyLength | None) -> str:
    """A length for messages: 4 digits, and its unit if it has one."""
    return "none" if length is None else f"{length:.4g}"


def small_length(length: AnyLength, unit: Unit | None = None, digits: int = 4) -> str:
    """A length that is small beside the object, for reports: in millimetres if its unit is metric.

    Args:
        length: A number in `unit`, or with a unit of its own.
        unit: Unit of the number; None: not known.
        digits: Significant digits.

    Example:
        >>> from grasp3d.settings.lengths import Measure, small_length
        >>> small_length(0.001, "m"), small_length(Measure(0.1, "cm")), small_length(0.25, "in")
        ('1 mm', '1 mm', '0.25 in')
    """
    if isinstance(length, Measure):
        return small_length(length.number, length.unit, digits)
    if unit is None or unit == "in":
        return f"{length:.{digits}g}" + (f" {unit}" if unit else "")
    return f"{1000.0 * METRES[unit] * length:.{digits}g} mm"


def is_number(value: object) -> bool:
    """Whether it is one number; arrays of several have `__float__` too."""
    single = getattr(value, "shape", ()) == ()
    return hasattr(value, "__float__") and single and not isinstance(value, bool)


def _no_length(name: str, value: object) -> SettingError:
    units = ", ".join(METRES)
    return SettingError(
        f"{name} must be a length: a number, or a number with a unit ({units}); got {value!r}"
    )
