"""Budget of a grasp's margin: how much of the friction angle each uncertainty takes.

Two fingers are surely stable where their critical friction angle beta*, the tilt of the normals and
the turn of the line between the contacts together stay below the friction angle. So the friction
angle is the sum of beta*, of one part for each uncertainty, and of a margin; the grasp is S where
the margin is above 0. Wan & Howe 2018 (Sec. III-A, IV-B) name these uncertainties; all but the
sensor resolution are worked out here.
"""

import math
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from grasp3d.arrays import ArrayLike, Floats, short_repr
from grasp3d.contact.encoders import JointEncoders
from grasp3d.contact.sensor import Sensor
from grasp3d.errors import SettingError
from grasp3d.settings.lengths import AnyLength, Measure
from grasp3d.settings.uncertainty import Interval, Uncertainty, friction_interval

PARTS = {
    "friction": "friction",
    "resolution": "sensor resolution",
    "normals": "normal error",
    "location": "location",
    "encoders": "encoders",
}
"""Fields of the uncertainties, with their names in figures and reports."""

CRITICAL, MARGIN = "critical angle", "margin"


@dataclass(frozen=True, eq=False)
class MarginBudget:
    """Parts of the friction angle of one grasp or of many: critical angle, uncertainties, margin.

    All are angles [rad], of one shape (...). They add up:
    friction_angle = critical_angle + friction + resolution + normals + location + encoders +
    margin.

    Example:
        A fingertip of 10 mm radius with a receptive field of 4 mm, encoders of 12 bits at two
        joints, and a friction of 0.4 to 0.6, on an antipodal grasp of 50 mm:

        >>> import grasp3d
        >>> from grasp3d.contact import JointEncoders, MarginBudget
        >>> budget = MarginBudget.of(
        ...     0.0,
        ...     friction=(0.4, 0.6),
        ...     sensor=grasp3d.Sensor(receptive_field=4.0, fingertip_radius=10.0),
        ...     encoders=JointEncoders(counts=4096, lengths=(60.0, 30.0)),
        ...     opening=50.0,
        ... )
        >>> for term in budget.line.split(" + "):
        ...     print(term)
        friction angle 26.57° = critical angle 0.00°
        friction 4.76°
        sensor resolution 11.46°
        location 4.59°
        encoders 0.25°
        margin 5.51°
        >>> budget.costliest
        'sensor resolution'
    """

    friction_angle: Floats
    """Friction angle beta at the middle of the friction interval."""
    critical_angle: Floats
    """Critical friction angle beta* of the grasp; inf: no grasp."""
    friction: Floats
    """What the uncertain friction takes: beta minus the friction angle at the smallest friction."""
    resolution: Floats
    """Half the sensor resolution, alpha / 2."""
    normals: Floats
    """Further error of the normals, without that of the encoders."""
    location: Floats
    """Turn of the line between the contacts, without the encoders' fraction of it."""
    encoders: Floats
    """Error of the normals by the encoders, and their fraction of the line's turn."""

    __repr__ = short_repr

    def __post_init__(self) -> None:
        names = [field.name for field in fields(self)]
        given = (np.asarray(getattr(self, name), dtype=np.float64) for name in names)
        for name, values in zip(names, np.broadcast_arrays(*given), strict=True):
            object.__setattr__(self, name, values)

    @classmethod
    def of(
        cls,
        critical_angle: ArrayLike,
        *,
        friction: float | Interval | str | None = None,
        sensor: Sensor | Uncertainty | None = None,
        encoders: JointEncoders | None = None,
        other: Uncertainty | None = None,
        opening: ArrayLike = math.inf,
    ) -> "MarginBudget":
        """Budget of grasps of two equal fingers.

        Each contact lies within the sum of all location errors of the perceived one, delta, so the
        line turns by up to eta = asin(min(1, 2 delta / opening)). This angle is split in proportion
        to the location errors: the encoders' fraction of it is counted as theirs. The margin is
        that of labels with the sum of the uncertainties.

        Args:
            critical_angle: Critical friction angle beta* [rad], shape (...); inf: no grasp.
            friction: Coefficient of friction, above 0, or its interval: (0.4, 0.6) or '0.4..0.6';
                None: that of `other`.
            sensor: A `Sensor`, or the uncertainty of one, its lengths in the unit of the opening.
            encoders: Encoders of the joints of each finger.
            other: Any further uncertainty: normals and location.
            opening: Distance between the contacts, at least 0, shape (...), or inf.

        Raises:
            SettingError: No friction is given, or two; or a length has a unit of its own.
        """
        further = other or Uncertainty()
        smallest, largest = friction_interval(_one_friction(friction, further))
        beta = math.atan(0.5 * (smallest + largest))
        known = sensor.uncertainty if isinstance(sensor, Sensor) else sensor
        total, joints = (known or Uncertainty()) + further, encoders or JointEncoders.exact()
        lengths = _number(total.location_error), joints.contact_error
        location, moved = _turns(np.asarray(opening, dtype=np.float64), *lengths)
        return cls(
            friction_angle=np.asarray(beta),
            critical_angle=np.asarray(critical_angle, dtype=np.float64),
            friction=np.asarray(beta - math.atan(smallest)),
            resolution=np.asarray(total.sensor_resolution / 2.0),
            normals=np.asarray(total.normal_error),
            location=location,
            encoders=joints.normal_error + moved,
        )

    @property
    def parts(self) -> dict[str, Floats]:
        """What each uncertainty takes [rad], by its name in figures, shape (...) each."""
        return {text: getattr(self, name) for name, text in PARTS.items()}

    @property
    def stack(self) -> dict[str, Floats]:
        """Critical angle, parts and margin, whose sum is the friction angle [rad]."""
        return {CRITICAL: self.critical_angle, **self.parts, MARGIN: self.margin}

    @property
    def uncertain(self) -> Floats:
        """Sum of all parts [rad]: a grasp is S below the friction angle minus this one."""
        return np.asarray(sum(self.parts.values()))

    @property
    def margin(self) -> Floats:
        """What is left of the friction angle [rad], shape (...); S: above 0; -inf: no grasp."""
        return np.asarray(self.friction_angle - self.uncertain - self.critical_angle)

    @property
    def costliest(self) -> Any:
        """Name of the uncertainty that takes the most, shape (...); '' where none takes any."""
        names = np.array(["", *self.parts])
        values = np.stack([np.zeros_like(self.friction_angle), *self.parts.values()])
        found = names[np.argmax(values, axis=0)]  # the first of equal ones: '' where all are 0
        return str(found) if found.ndim == 0 else found

    @property
    def line(self) -> str:
        """The budget of one grasp as one line, in degrees, without parts that are 0.

        Raises:
            SettingError: There are several grasps, or none.
        """
        if self.friction_angle.size != 1 or not np.all(np.isfinite(self.critical_angle)):
            raise SettingError("a budget is written as a line for one grasp; choose it with at()")
        shown = {name: value for name, value in self.parts.items() if float(value.item()) != 0.0}
        terms = {CRITICAL: self.critical_angle, **shown, MARGIN: self.margin}
        total = f"friction angle {_degrees(self.friction_angle)}"
        return f"{total} = " + " + ".join(f"{name} {_degrees(at)}" for name, at in terms.items())

    def at(self, index: Any) -> "MarginBudget":
        """Budget of some of the grasps.

        Args:
            index: Index of an array of the shape of the parts.
        """
        return MarginBudget(*(getattr(self, field.name)[index] for field in fields(self)))

    def mean(self, weights: ArrayLike | None = None) -> "MarginBudget":
        """Mean budget of those grasps that there are; its parts add up as those of each do.

        Args:
            weights: Weight of each grasp, such as an area, shape (...); None: all equal.

        Raises:
            SettingError: There is no grasp with a weight.
        """
        given = np.ones(self.friction_angle.shape) if weights is None else np.asarray(weights)
        used = np.where(np.isfinite(self.critical_angle), given, 0.0)
        if not used.sum() > 0.0:
            raise SettingError("there is no grasp whose margin could have a mean")
        columns = (np.where(used > 0.0, getattr(self, one.name), 0.0) for one in fields(self))
        return MarginBudget(*(np.average(column, weights=used) for column in columns))


def _one_friction(friction: float | Interval | str | None, other: Uncertainty) -> Any:
    if (friction is None) == (other.friction is None):
        raise SettingError("a budget needs one friction: as friction=, or in the uncertainty")
    return other.friction if friction is None else friction


def _turns(opening: Floats, *lengths: float) -> tuple[Floats, ...]:
    """Turn of the line by location errors of both contacts, split in proportion to them [rad]."""
    total = sum(lengths)
    if total == 0.0:
        return tuple(np.zeros(opening.shape) for _ in lengths)
    with np.errstate(divide="ignore", over="ignore"):
        turn = np.arcsin(np.minimum(1.0, 2.0 * total / opening))
    return tuple(turn * (length / total) for length in lengths)


def _number(length: AnyLength) -> float:
    if isinstance(length, Measure):
        raise SettingError(
            f"location error {length} has a unit: convert the uncertainty with "
            "settings_in_unit(unit of the opening, uncertainty)"
        )
    return float(length)


def _degrees(angle: Floats) -> str:
    return f"{round(math.degrees(float(angle.item())), 2) + 0.0:.2f}°"  # never -0.00
