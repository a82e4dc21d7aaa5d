"""Uncertainty: what is not known exactly about a contact, as one value.

A tactile sensor, the joints of a hand and the user each state it; such values add up. Wan & Howe
2018 (Sec. III-A and IV-B) name friction, contact location and joint encoders beside the sensor's
normals.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields
from typing import Any

from grasp3d.errors import SettingError
from grasp3d.settings.checks import check_length, parse_angle
from grasp3d.settings.lengths import (
    AnyLength,
    Length,
    LengthSettings,
    Measure,
    describe_length,
    measure,
)
from grasp3d.settings.parsing import ParsedField, TextValue

Interval = tuple[float, float]
"""Smallest and largest value."""

_BETWEEN = ".."
"""Between the ends of an interval in a text."""

_ANGLES = ("sensor_resolution", "normal_error")


@dataclass(frozen=True)
class Uncertainty(LengthSettings):
    """What is not known exactly about a contact.

    `a + b` is the uncertainty of a contact to which both apply: angles and lengths add up.
    `GraspModel.with_uncertainty` takes it.

    Attributes:
        sensor_resolution: Sensor resolution alpha [rad], from 0 to below pi: the true normal lies
            within alpha / 2 of the perceived one.
        normal_error: Further angle by which the true normal may differ [rad], from 0 to below
            pi / 2, as joint encoders cause it.
        location_error: Largest distance between the true and the perceived contact point, a
            length.
        friction: Smallest and largest coefficient of friction; None: nothing is said about it.

    Example:
        >>> import grasp3d
        >>> from grasp3d.settings.uncertainty import Uncertainty
        >>> sensor = Uncertainty(sensor_resolution=0.2, location_error="2 mm")
        >>> joints = Uncertainty(normal_error=0.01, location_error="0.5 mm")
        >>> total = sensor + joints
        >>> total.location_error, total.normal_error
        ('2.5 mm', 0.01)
        >>> grasp3d.GraspModel().with_uncertainty(total).location_error
        '2.5 mm'
    """

    sensor_resolution: float = 0.0
    normal_error: float = 0.0
    location_error: Length[float] = Length(0.0)
    friction: Interval | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        check_resolution(self.sensor_resolution)
        check_normal_error(self.normal_error)
        check_length("location error", self.location_error)
        if self.friction is not None:
            object.__setattr__(self, "friction", friction_interval(self.friction))

    def __add__(self, other: "Uncertainty") -> "Uncertainty":
        """The uncertainty of a contact to which both apply.

        Raises:
            SettingError: Both state a friction, or one length has a unit and the other none.
        """
        if not isinstance(other, Uncertainty):
            return NotImplemented
        if self.friction is not None and other.friction is not None:
            raise SettingError("two uncertainties with a friction do not add up; give it once")
        return Uncertainty(
            sensor_resolution=self.sensor_resolution + other.sensor_resolution,
            normal_error=self.normal_error + other.normal_error,
            location_error=_sum_of_lengths(self.location_error, other.location_error),
            friction=self.friction or other.friction,
        )


def check_resolution(resolution: float) -> None:
    """Raise SettingError unless a sensor resolution is from 0 to below pi [rad]."""
    if not 0.0 <= resolution < math.pi:
        raise SettingError(
            "sensor resolution must be at least 0 and below 180 degrees (pi radians); "
            f"got {math.degrees(resolution):g} degrees (in Python angles are radians)"
        )


def check_normal_error(error: float) -> None:
    """Raise SettingError unless an error of normals is from 0 to below pi / 2 [rad]."""
    if not 0.0 <= error < math.pi / 2.0:
        raise SettingError(
            "normal error must be at least 0 and below 90 degrees (pi / 2 radians); "
            f"got {math.degrees(error):g} degrees (in Python angles are radians)"
        )


def check_tilt(tilt: float) -> None:
    """Raise SettingError unless true normals differ by less than pi / 2 from perceived ones."""
    if not tilt < math.pi / 2.0:
        raise SettingError(
            "half the sensor resolution and the normal error, with those of a finger, must add up "
            f"to less than 90 degrees; got {math.degrees(tilt):.4g} degrees"
        )


def friction_interval(value: object) -> Interval:
    """Smallest and largest coefficient of friction.

    Args:
        value: A number, two of them, or a text: '0.5' or '0.4..0.6'.

    Raises:
        SettingError: They are not finite numbers above 0 in increasing order.

    Example:
        >>> from grasp3d.settings.uncertainty import friction_interval
        >>> friction_interval("0.4..0.6"), friction_interval(0.5)
        ((0.4, 0.6), (0.5, 0.5))
    """
    if type(value) is float and 0.0 < value < math.inf:  # as in most models, which are made often
        return value, value
    parts = value.split(_BETWEEN) if isinstance(value, str) else value
    try:
        ends = [float(one) for one in parts] if isinstance(parts, Sequence) else [float(parts)]  # type: ignore[arg-type]
    except (TypeError, ValueError, OverflowError):
        ends = []
    if len(ends) == 1:
        ends *= 2
    if len(ends) != 2 or not all(0.0 < end < math.inf for end in ends) or ends[0] > ends[1]:
        quoted = f"{value:g}" if isinstance(value, float) else repr(value)
        raise SettingError(
            "friction must be a finite number above 0, or an interval of two, the smallest first "
            f"(0.4{_BETWEEN}0.6, in Python (0.4, 0.6)); got {quoted}"
        )
    return ends[0], ends[1]


class Friction(ParsedField[float, float | tuple[float, float] | str]):
    """A field of settings that holds a coefficient of friction.

    It takes a number, or an interval (smallest, largest), in a text '0.4..0.6', and holds its
    middle; half its width becomes the `friction_error` of the settings.
    """

    def parse(self, _name: str, value: Any) -> Any:
        """The interval of friction, which `GraspModel` parts into its middle and its error."""
        return value if isinstance(value, float) else friction_interval(value)


def parse_uncertainty(text: str) -> Uncertainty:
    """Parse the uncertainty of a finger as text.

    Args:
        text: NAME=VALUE, separated by commas, with the names of the fields: angles in degrees
            or with a unit, lengths with or without one, friction as a number or an interval.

    Raises:
        SettingError: It is no such text, or a value is outside its range.

    Example:
        >>> from grasp3d.settings.uncertainty import parse_uncertainty
        >>> parse_uncertainty("location_error=1mm, friction=0.3..0.4")
        Uncertainty(..., location_error='1 mm', friction=(0.3, 0.4))
    """
    values: dict[str, object] = {}
    for part in filter(None, (one.strip() for one in text.split(","))):
        name, separator, value = (one.strip() for one in part.partition("="))
        name = name.replace("-", "_")
        names = [field.name for field in fields(Uncertainty)]
        if name not in names or not separator or name in values:
            raise SettingError(
                f"the uncertainty of a finger must be NAME=VALUE, separated by commas, with the "
                f"names {', '.join(names)}, each at most once ('location_error=1mm, "
                f"friction=0.3..0.4'); got {part!r}"
            )
        values[name] = parse_angle(name, value) if name in _ANGLES else value
    return Uncertainty(**values)  # type: ignore[arg-type]


def describe_uncertainty(value: Uncertainty) -> str:
    """The uncertainty of a finger as text, as `parse_uncertainty` reads it; '' for none."""
    parts = [
        f"{name}={degrees:.15g}"
        for name in _ANGLES
        if (degrees := math.degrees(getattr(value, name))) != 0.0
    ]
    if (length := value.location_error) != 0.0:
        parts.append(f"location_error={length if isinstance(length, Measure) else float(length)}")
    if value.friction is not None:
        parts.append(f"friction={_BETWEEN.join(map(repr, value.friction))}")
    return ", ".join(parts)


class Fingers(tuple[Uncertainty, ...], TextValue):
    """The uncertainty of each finger; none at all where nothing further is known of any."""

    __slots__ = ()

    def __str__(self) -> str:
        return "; ".join(map(describe_uncertainty, self))


class PerFinger(ParsedField[tuple[Uncertainty, ...], str | Sequence[Uncertainty]]):
    """A field of settings that holds the uncertainty of each finger; it is empty without any.

    It takes a text, see `parse_uncertainty`, with the fingers separated by semicolons, or a
    sequence of `Uncertainty`.
    """

    def __init__(self) -> None:
        super().__init__(Fingers())

    def parse(self, _name: str, value: Any) -> Fingers:
        """See `ParsedField.parse`."""
        return value if isinstance(value, Fingers) else parse_fingers(value)


def parse_fingers(value: str | Sequence[Uncertainty]) -> Fingers:
    """The uncertainty of each finger, from a text or from values; see `PerFinger`.

    Angles are rounded to 15 digits in degrees, so that their text is of the same values.

    Raises:
        SettingError: It is neither.
    """
    if isinstance(value, str):
        rounded = str(Fingers(_parsed_fingers(value.split(";"))))
        fingers = Fingers(_parsed_fingers(rounded.split(";")))
        return fingers if any(one != Uncertainty() for one in fingers) else Fingers()
    items: Any = value
    if not (isinstance(items, Sequence) and all(isinstance(one, Uncertainty) for one in items)):
        raise SettingError(
            "per_finger must be a text such as 'location_error=1mm; normal_error=5' (degrees), or "
            f"one Uncertainty for each finger; got {value!r}"
        )
    return parse_fingers(str(Fingers(items)))


def _parsed_fingers(texts: Sequence[str]) -> Iterator[Uncertainty]:
    for number, text in enumerate(texts, 1):
        try:
            yield parse_uncertainty(text)
        except SettingError as error:
            raise SettingError(f"finger {number}: {error}") from error


def _sum_of_lengths(one: AnyLength, two: AnyLength) -> AnyLength:
    """Sum of two lengths, in the unit of the length that has a unit."""
    for unit_of, other in ((one, two), (two, one)):
        if isinstance(unit_of, Measure):
            if other == 0.0:
                return unit_of
            if isinstance(other, Measure):
                return measure(unit_of.number + other.in_unit(unit_of.unit), unit_of.unit)
            raise SettingError(
                f"location errors of {describe_length(one)} and {describe_length(two)} do not add "
                "up: give both with a unit, or none"
            )
    return one + two  # type: ignore[operator]
