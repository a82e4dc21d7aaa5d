"""The uncertainties that a sweep varies: their names, values and units, and which are its axes."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, get_args

import numpy as np

from grasp3d.arrays import ArrayLike, Floats, locked
from grasp3d.errors import SettingError
from grasp3d.settings import GraspModel
from grasp3d.settings.lengths import (
    AnyLength,
    GivenLength,
    Measure,
    Unit,
    describe_length,
    measure,
    parse_length,
)
from grasp3d.settings.uncertainty import check_normal_error, check_resolution

AxisName = Literal[
    "friction", "friction_error", "normal_error", "location_error", "sensor_resolution"
]
"""Fields of `GraspModel` that a sweep varies. Of two axes the later one is along the columns."""

NAMES: tuple[AxisName, ...] = get_args(AxisName)

FRICTION: AxisName = "friction"
RESOLUTION: AxisName = "sensor_resolution"
"""Axes of a sweep that varies nothing else."""


@dataclass(frozen=True)
class AxisText:
    """How an axis is named and its values are written."""

    words: str
    """Its name."""
    symbol: str
    """Before its values."""
    unit: str = ""
    """Unit of the written values; '': numbers, or that of the sweep's lengths."""

    @property
    def is_angle(self) -> bool:
        """Whether its values are angles [rad], which are written in degrees."""
        return self.unit == "°"


AXES: dict[AxisName, AxisText] = {
    "friction": AxisText("friction", "μ"),
    "friction_error": AxisText("friction error", "μ error"),
    "normal_error": AxisText("normal error", "normal error", "°"),
    "location_error": AxisText("location error", "location error"),
    "sensor_resolution": AxisText("sensor resolution", "α", "°"),
}
"""The axes by name."""


@dataclass(frozen=True)
class AxisValues:
    """Values of every axis, one or several, each in increasing order."""

    values: Mapping[AxisName, Floats]
    unit: Unit | None = None
    """Unit of the location errors; None: that of the mesh."""

    @property
    def rows_and_columns(self) -> tuple[AxisName, AxisName]:
        """The two axes; friction and sensor resolution where nothing else has several values.

        Raises:
            SettingError: More than two have several values.
        """
        several = [name for name in NAMES if len(self.values[name]) > 1]
        if len(several) > 2:
            raise SettingError(
                f"a sweep has two axes, but {len(several)} settings have several values: "
                f"{', '.join(several)}; give one value for all but two of them"
            )
        if len(several) == 2:
            return several[0], several[1]
        if several and several[0] != FRICTION:
            return FRICTION, several[0]
        return FRICTION, RESOLUTION

    def grid(self, name: AxisName) -> Floats:
        """Values of an axis over the rows and columns: shape (m, 1), (1, k) or (1, 1)."""
        rows, _ = self.rows_and_columns
        values = self.values[name]
        return values[:, None] if name == rows else values[None, :]

    def friction_angles(self) -> tuple[Floats, Floats]:
        """Friction angles beta at the smallest and at the largest friction [rad], (m or 1, k or 1).

        Raises:
            SettingError: A friction error is not below the friction.
        """
        friction, error = np.broadcast_arrays(self.grid("friction"), self.grid("friction_error"))
        ends = [
            GraspModel(friction=float(one), friction_error=float(off)).friction_interval
            for one, off in zip(friction.flat, error.flat, strict=True)
        ]
        angles = np.array([[math.atan(least), math.atan(most)] for least, most in ends])
        least, most = angles.T.reshape(2, *friction.shape)
        return least, most

    def tilts(self) -> Floats:
        """Largest angles between true and perceived normals [rad], shape (m or 1, k or 1)."""
        return np.asarray(self.grid("sensor_resolution") / 2.0 + self.grid("normal_error"))

    @property
    def fixed_text(self) -> str:
        """What is the same in all entries, as text; errors of 0 are left out."""
        fixed = [name for name in NAMES if name not in self.rows_and_columns]
        values = {name: float(self.values[name][0]) for name in fixed}
        return ", ".join(
            f"{AXES[name].words} {describe_value(name, value, self.unit)}"
            for name, value in values.items()
            if value != 0.0 or name in {FRICTION, RESOLUTION}
        )

    @property
    def is_default(self) -> bool:
        """Whether friction and sensor resolution are the axes, and nothing else is uncertain."""
        others = [self.values[name] for name in NAMES if name not in {FRICTION, RESOLUTION}]
        return self.rows_and_columns == (FRICTION, RESOLUTION) and not any(map(np.any, others))

    def location_errors(self) -> list[AnyLength]:
        """Location errors as lengths: numbers, or with the unit."""
        numbers: list[float] = self.values["location_error"].tolist()
        return [measure(number, self.unit) for number in numbers]


def axis_values(**entries: ArrayLike | Sequence[GivenLength] | GivenLength) -> AxisValues:
    """Check the values of every axis and put them in order, each once.

    Args:
        entries: One or more values of every axis; location errors may be lengths with a unit.

    Raises:
        SettingError: A value is outside its range, or an axis has none.

    Example:
        >>> from grasp3d.surface.sweeps.axes import axis_values
        >>> axes = axis_values(
        ...     friction=0.5, friction_error=[0.0, 0.1], normal_error=0.0,
        ...     location_error=["2 mm", 0, "0.1 cm"], sensor_resolution=0.4,
        ... )
        >>> axes.rows_and_columns, axes.location_errors()
        (('friction_error', 'location_error'), [0.0, '1 mm', '2 mm'])
    """
    numbers, unit = in_one_unit(entries.pop("location_error"))
    values: dict[AxisName, Floats] = {"location_error": _in_order(numbers, "location error")}
    for name in NAMES:
        if name in entries:
            values[name] = _in_order(entries[name], AXES[name].words)
    for friction in values["friction"]:
        GraspModel(friction=float(friction))
    for resolution in values["sensor_resolution"]:
        check_resolution(float(resolution))
    for error in values["normal_error"]:
        check_normal_error(float(error))
    if values["location_error"][0] < 0.0:
        raise SettingError(
            f"location error must be at least 0; got {values['location_error'][0]:g}"
        )
    axes = AxisValues(values, unit)
    axes.friction_angles()
    return axes


def in_one_unit(
    lengths: ArrayLike | Sequence[GivenLength] | GivenLength,
) -> tuple[list[float], Unit | None]:
    """Lengths as numbers in the unit of the first one that has a unit, and that unit.

    Args:
        lengths: One or more lengths, as `parse_length` takes them.

    Raises:
        SettingError: One is no length, or some have a unit and others none.
    """
    items: Any = (
        [lengths] if isinstance(lengths, str | Measure) else np.asarray(lengths, object).ravel()
    )
    parsed = [parse_length("location_error", one) for one in items]
    unit: Any = next((one.unit for one in parsed if isinstance(one, Measure)), None)
    bare = [one for one in parsed if not isinstance(one, Measure) and one != 0.0]
    if unit is not None and bare:
        raise SettingError(
            f"location errors must all have a unit, or none; got {describe_length(bare[0])} beside "
            f"others in {unit}"
        )
    return [one.in_unit(unit) if isinstance(one, Measure) else one for one in parsed], unit


def describe_value(name: AxisName, value: float, unit: Unit | None = None) -> str:
    """A value of an axis as text, without its name: '0.5', '22.6°', '2 mm'.

    Args:
        name: The axis.
        value: The value; angles in radians.
        unit: Unit of lengths; None: that of the mesh.
    """
    axis = AXES[name]
    if axis.is_angle:
        return f"{math.degrees(value):.4g}°"
    return f"{value:.4g} {unit}" if name == "location_error" and unit else f"{value:.4g}"


def _in_order(values: Any, what: str) -> Floats:
    """One or more numbers in increasing order, each once."""
    try:
        numbers = np.unique(np.asarray(values, dtype=np.float64).reshape(-1))
    except (TypeError, ValueError) as error:
        raise SettingError(f"each {what} must be a number: {error}") from error
    if not len(numbers):
        raise SettingError(f"no {what} to sweep over: give at least one")
    if not math.isfinite(numbers[-1]):  # nan is sorted last
        raise SettingError(f"each {what} must be a finite number; got {numbers[-1]:g}")
    return locked(numbers)
