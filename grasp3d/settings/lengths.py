"""Lengths in settings: numbers in the mesh's unit, or texts with a unit of their own."""

import math
import re
from collections.abc import Sequence
from dataclasses import fields, replace
from typing import Any, Generic, Literal, Self, TypeVar, get_args

from grasp3d.errors import SettingError

Unit = Literal["m", "cm", "mm", "in"]
METRES: dict[Unit, float] = {"m": 1.0, "cm": 0.01, "mm": 0.001, "in": 0.0254}

LengthT = TypeVar("LengthT", bound="float | None")

_TEXT = re.compile(r"([-+]?(?:\d+\.?\d*|\.\d+)(?:e[-+]?\d+)?)\s*([a-z]*)", re.IGNORECASE)


class Length(Generic[LengthT]):
    """A field of settings that holds a length.

    It takes a number, in the mesh's unit, or a text with a unit (m, cm, mm or in), such as '80mm'
    or '0.08 m'. `in_unit` of the settings converts such texts; where a length is computed with, it
    is a number.
    """

    def __init__(self, default: LengthT) -> None:
        self._default = default
        self._name = ""

    def __set_name__(self, _owner: type, name: str) -> None:
        self._name = name

    def __get__(self, instance: object | None, _owner: type) -> LengthT:
        return self._default if instance is None else vars(instance)[self._name]

    def __set__(self, instance: object, value: LengthT | str) -> None:
        if value is None and self._default is not None:
            raise _no_length(self._name, value)
        vars(instance)[self._name] = parse_length(self._name, value)


LengthOrText = float | str


class Position:
    """A field of settings that holds a point: three lengths, as those of `Length`, or none.

    It takes three of them, or a text with commas, such as '10mm,0,-2.5mm'.
    """

    def __init__(self) -> None:
        self._name = ""

    def __set_name__(self, _owner: type, name: str) -> None:
        self._name = name

    def __get__(self, instance: object | None, _owner: type) -> tuple[float, float, float] | None:
        return None if instance is None else vars(instance)[self._name]

    def __set__(self, instance: object, value: Sequence[LengthOrText] | str | None) -> None:
        vars(instance)[self._name] = parse_position(self._name, value)


class LengthSettings:
    """Settings, frozen dataclasses, with fields of type `Length` or `Position`."""

    def in_unit(self, unit: Unit | None, *, source: str = "the mesh") -> Self:
        """The same settings with every length as a number.

        Args:
            unit: Unit of the numbers: that of the mesh; None: it is not known.
            source: Name of the mesh, for the error.

        Raises:
            SettingError: A length has a unit, but that of the mesh is not known.
        """
        converted: dict[str, Any] = {
            name: length_in_unit(name, value, unit, source=source)
            for name, value in self.lengths().items()
            if isinstance(value, str)
        }
        for name in self._names_of(Position):
            point = getattr(self, name) or ()
            if any(isinstance(one, str) for one in point):
                converted[name] = tuple(
                    length_in_unit(name, one, unit, source=source) for one in point
                )
        return replace(self, **converted) if converted else self  # type: ignore[type-var]

    @classmethod
    def length_names(cls) -> tuple[str, ...]:
        """Names of the fields that are lengths."""
        return cls._names_of(Length)

    @classmethod
    def _names_of(cls, kind: type) -> tuple[str, ...]:
        """Names of the fields of a kind."""
        kinds = {name: one for base in cls.__mro__ for name, one in vars(base).items()}
        names = [field.name for field in fields(cls)]  # type: ignore[arg-type]
        return tuple(name for name in names if isinstance(kinds.get(name), kind))

    def lengths(self) -> dict[str, Any]:
        """The lengths by name: numbers, texts with a unit, or none."""
        return {name: getattr(self, name) for name in self.length_names()}


def parse_length(name: str, value: Any) -> Any:
    """Check a length and write it in one way.

    Args:
        name: Name of the setting, for the error.
        value: A number, a text, or none.

    Returns:
        Numbers, and none, as they are; texts without a unit, and zero, as numbers; texts with a
        unit as a number, a space and the unit.

    Raises:
        SettingError: It is neither a number nor a number with a known unit.
    """
    if not isinstance(value, str):
        if value is None or _is_number(value):
            return value
        raise _no_length(name, value)
    text = value.strip()
    found = _TEXT.fullmatch(text)
    if found is None:
        if text.lower() in {"inf", "nan"}:
            return float(text)
        raise _no_length(name, value)
    number, unit = float(found[1]), found[2].lower()
    if not unit:
        return number
    if unit not in METRES:
        raise _no_length(name, value)
    return f"{number:.15g} {unit}" if number and math.isfinite(number) else number


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
    given = value.split(",") if isinstance(value, str) else value
    try:
        lengths = tuple(parse_length(name, one) for one in given)
    except (TypeError, SettingError):
        lengths = ()
    lengths = tuple(one if isinstance(one, str | None) else float(one) for one in lengths)
    numbers = [one for one in lengths if not isinstance(one, str)]
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
    name: str, value: float | str | None, unit: Unit | None, *, source: str = "the mesh"
) -> Any:
    """A length as a number in a unit.

    Args:
        name: Name of the setting, for the error.
        value: A number in that unit, a text with a unit, or none.
        unit: The unit; None: it is not known.
        source: Name of the mesh, for the error.

    Raises:
        SettingError: It has a unit, but that of the mesh is not known.
    """
    length = parse_length(name, value)
    if not isinstance(length, str):
        return length
    if unit is None:
        raise SettingError(
            f"{name} is {length}, but the unit of {source} is not known: give the unit of its "
            "coordinates (--unit, in Python unit=...)"
        )
    number, own = length.split(" ")
    # To 15 digits, so that 80 mm are 0.08 m and not 0.08 and a rounding error.
    return float(number) if own == unit else float(f"{to_metres(length) / METRES[unit]:.15g}")


def to_metres(length: str) -> float:
    """The length of a text with a unit, as `parse_length` writes it [m]."""
    number, unit = length.split(" ")
    return float(number) * next(METRES[known] for known in get_args(Unit) if known == unit)


def comparable(*lengths: float | str | None) -> tuple[float, ...] | None:
    """Lengths as numbers in one unit, zero and infinity in any; None: some have a unit, some not.

    Args:
        lengths: Lengths as settings hold them; none counts as 0.
    """
    given = [length or 0.0 for length in lengths]
    numbers = [one for one in given if not isinstance(one, str)]
    if len(numbers) < len(given) and any(0.0 < abs(one) < math.inf for one in numbers):
        return None
    return tuple(to_metres(one) if isinstance(one, str) else one for one in given)


def describe_length(length: float | str | None) -> str:
    """A length for messages: 4 digits, and its unit if it has one."""
    if isinstance(length, str):
        number, unit = length.split(" ")
        return f"{float(number):.4g} {unit}"
    return "none" if length is None else f"{length:.4g}"


def small_length(length: float | str, unit: Unit | None = None, digits: int = 4) -> str:
    """A length that is small beside the object, for reports: in millimetres if its unit is metric.

    Args:
        length: A number in `unit`, or a text with a unit of its own.
        unit: Unit of the number; None: not known.
        digits: Significant digits.

    Example:
        >>> from grasp3d.settings.lengths import small_length
        >>> small_length(0.001, "m"), small_length("0.1 cm"), small_length(0.25, "in")
        ('1 mm', '1 mm', '0.25 in')
    """
    if isinstance(length, str):
        number, own = length.split(" ")
        return small_length(float(number), next(one for one in METRES if one == own), digits)
    if unit is None or unit == "in":
        return f"{length:.{digits}g}" + (f" {unit}" if unit else "")
    return f"{1000.0 * METRES[unit] * length:.{digits}g} mm"


def _is_number(value: object) -> bool:
    """Whether it is one number; arrays of several have `__float__` too."""
    single = getattr(value, "shape", ()) == ()
    return hasattr(value, "__float__") and single and not isinstance(value, bool)


def _no_length(name: str, value: object) -> SettingError:
    units = ", ".join(METRES)
    return SettingError(
        f"{name} must be a length: a number, or a number with a unit ({units}); got {value!r}"
    )
