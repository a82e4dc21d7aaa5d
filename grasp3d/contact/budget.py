"""Budget of a grasp's margin: how much of the friction angle each uncertainty takes, or may take.

Two fingers are surely stable where their critical friction angle beta*, the tilt of the normals and
the turn of the line between the contacts together stay below the friction angle. So the friction
angle is the sum of beta*, of one part for each uncertainty, and of a margin; the grasp is S where
the margin is above 0. Wan & Howe 2018 (Sec. III-A, IV-B) name these uncertainties; all but the
sensor resolution are worked out here. A `FingerDesign` reads the sum backward: which sensor,
encoders or friction given grasps require.
"""

import math
from bisect import bisect_left
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Any

import numpy as np

from grasp3d.arrays import ArrayLike, Floats, short_repr
from grasp3d.contact.sensor import MOST_COUNTS, JointEncoders, Sensor
from grasp3d.contact.tips import CylinderTip, EllipsoidTip
from grasp3d.errors import SettingError
from grasp3d.settings.checks import check_range
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

FIELD_ROUNDING = 1e-9
"""Fraction of the longest receptive field by which tested ones stay below it."""

BISECTIONS = 60
"""Bisections of an interval of lengths, which end at rounding errors."""

FRACTION_ROUNDING = 1e-12
"""Fraction of all grasps that rounding errors of weights may amount to."""


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
        arrays = (np.asarray(getattr(self, name), dtype=np.float64) for name in names)
        for name, values in zip(names, np.broadcast_arrays(*arrays), strict=True):
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
        if (friction is None) == (further.friction is None):
            raise SettingError("a budget needs one friction: as friction=, or in the uncertainty")
        smallest, largest = friction_interval(further.friction if friction is None else friction)
        beta = math.atan(0.5 * (smallest + largest))
        total, joints = _uncertainty_of(sensor) + further, encoders or JointEncoders.exact()
        lengths = _number(total.location_error), joints.contact_error
        location, turn = _turns(np.asarray(opening, dtype=np.float64), *lengths)
        return cls(
            friction_angle=np.asarray(beta),
            critical_angle=np.asarray(critical_angle, dtype=np.float64),
            friction=np.asarray(beta - math.atan(smallest)),
            resolution=np.asarray(total.sensor_resolution / 2.0),
            normals=np.asarray(total.normal_error),
            location=location,
            encoders=joints.normal_error + turn,
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
        result = names[np.argmax(values, axis=0)]  # the first of equal ones: '' where all are 0
        return str(result) if result.ndim == 0 else result

    @property
    def line(self) -> str:
        """The budget of one grasp as one line, in degrees, without parts that are 0.

        Raises:
            SettingError: There are several grasps, or none.
        """
        if self.friction_angle.size != 1 or not np.all(np.isfinite(self.critical_angle)):
            raise SettingError("a budget is written as a line for one grasp; choose it with at()")
        parts = {name: value for name, value in self.parts.items() if float(value.item()) != 0.0}
        terms = {CRITICAL: self.critical_angle, **parts, MARGIN: self.margin}
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
        factors = np.ones(self.friction_angle.shape) if weights is None else np.asarray(weights)
        shares = np.where(np.isfinite(self.critical_angle), factors, 0.0)
        if not shares.sum() > 0.0:
            raise SettingError("there is no grasp whose margin could have a mean")
        columns = (np.where(shares > 0.0, getattr(self, one.name), 0.0) for one in fields(self))
        return MarginBudget(*(np.average(column, weights=shares) for column in columns))


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


@dataclass(frozen=True, eq=False)
class GraspSamples:
    """Grasps of two fingers that a design is for: one, or those of an object's surface.

    Example:
        >>> import grasp3d
        >>> from grasp3d.contact import FingerDesign, GraspSamples
        >>> grasps = GraspSamples(critical_angle=[0.0, 0.1, 0.4], opening=50.0)
        >>> design = FingerDesign(0.5, grasp3d.Sensor(receptive_field=4.0, fingertip_radius=10.0))
        >>> print(f"{design.stable_fraction(grasps):.0%} of the grasps are S")
        67% of the grasps are S
    """

    critical_angle: ArrayLike
    """Critical friction angle beta* of each [rad], shape (k,), or (k, c) where c grasps are known
    at each contact point, of which the grasp of largest margin counts; inf: no grasp."""
    opening: ArrayLike = math.inf
    """Distance between the contacts, at least 0, of the same shape; inf: locations do not
    matter."""
    weights: ArrayLike = 1.0
    """Weight of each contact point, at least 0, shape (k,)."""

    __repr__ = short_repr

    def __post_init__(self) -> None:
        pair = (np.array(one, float, ndmin=1) for one in (self.critical_angle, self.opening))
        critical, opening = np.broadcast_arrays(*pair)
        weights = np.broadcast_to(np.asarray(self.weights, float), critical.shape[:1])
        columns = {"critical_angle": critical, "opening": opening, "weights": weights}
        for name, values in columns.items():
            object.__setattr__(self, name, values)
        if not weights.sum() > 0.0:
            raise SettingError("there must be a grasp with a weight above 0")

    def fraction(self, chosen: ArrayLike) -> float:
        """Fraction, by weight, of chosen grasps.

        Args:
            chosen: Whether each is chosen, shape (k,).
        """
        weights = np.asarray(self.weights)
        return float(weights[np.asarray(chosen)].sum() / weights.sum())


@dataclass(frozen=True)
class FingerDesign:
    """Friction, sensor and encoders of two equal fingers, and what they require of each other.

    Every uncertainty only adds to the sum of a `MarginBudget`, so for each there is a largest value
    at which a given fraction of the grasps is still S, with all others as they are. For J joints
    whose errors only turn the fingertip, encoders of N counts must have
    pi J / N <= beta - alpha / 2 - beta* - eta; their location error makes eta depend on N as well,
    which is included.

    Lengths are in any unit, the same for all.

    Example:
        Encoders that a finger with two joints needs:

        >>> import grasp3d
        >>> from grasp3d.contact import FingerDesign, GraspSamples, JointEncoders
        >>> sensor = grasp3d.Sensor(receptive_field=4.0, fingertip_radius=10.0)
        >>> joints = JointEncoders(counts=4096, lengths=(60.0, 30.0))
        >>> design = FingerDesign((0.4, 0.6), sensor, joints)
        >>> one = GraspSamples(critical_angle=0.0, opening=50.0)
        >>> design.required_counts(one)
        176
        >>> print(f"{design.required_field(one, tip=10.0):.2f} mm")
        5.37 mm
    """

    friction: float | Sequence[float] | str
    """Coefficient of friction, above 0, or its interval, as `friction_interval` takes it."""
    sensor: Sensor | Uncertainty | None = None
    """The tactile sensor, or the uncertainty of one; None: exact."""
    encoders: JointEncoders | None = None
    """Encoders of each finger; None: exact."""
    other: Uncertainty = field(default_factory=Uncertainty)
    """Further errors of normals and locations."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "friction", friction_interval(self.friction))

    def budget(self, grasps: GraspSamples) -> MarginBudget:
        """The budget of the grasp at each contact point that has the largest margin, shape (k,).

        Args:
            grasps: The grasps.

        Raises:
            SettingError: A length has a unit of its own.
        """
        budget = MarginBudget.of(
            grasps.critical_angle,
            friction=friction_interval(self.friction),
            sensor=self.sensor,
            encoders=self.encoders,
            other=self.other,
            opening=grasps.opening,
        )
        if budget.margin.ndim == 1:
            return budget
        return budget.at((np.arange(len(budget.margin)), np.argmax(budget.margin, axis=1)))

    @property
    def uncertainty(self) -> Uncertainty:
        """All that is uncertain about a contact, but friction.

        Raises:
            SettingError: The sum is outside its range, such as normals that differ by 90 degrees.
        """
        joints = Uncertainty() if self.encoders is None else self.encoders.uncertainty
        return _uncertainty_of(self.sensor) + joints + self.other

    def stable_fraction(self, grasps: GraspSamples) -> float:
        """Fraction of the grasps, by weight, that are S with this design.

        Args:
            grasps: The grasps.

        Raises:
            SettingError: See `budget`.
        """
        return grasps.fraction(self.budget(grasps).margin > 0.0)

    def without(self, part: str) -> "FingerDesign":
        """The same design with one of its uncertainties removed.

        Args:
            part: Name of a part of `MarginBudget.parts`. Without 'friction' it is exactly the
                middle of its interval.

        Raises:
            SettingError: No part has that name.
        """
        removed = next((name for name, text in PARTS.items() if text == part), None)
        if removed is None:
            raise SettingError(
                f"no uncertainty is called {part!r}; known: {', '.join(PARTS.values())}"
            )
        if removed == "friction":
            middle = 0.5 * sum(friction_interval(self.friction))
            return replace(self, friction=middle)
        if removed == "encoders":
            return replace(self, encoders=None)
        zero = {
            "resolution": {"sensor_resolution": 0.0},
            "normals": {"normal_error": 0.0},
            "location": {"location_error": 0.0},
        }[removed]
        return replace(
            self,
            sensor=replace(_uncertainty_of(self.sensor), **zero),  # type: ignore[arg-type]
            other=replace(self.other, **zero),  # type: ignore[arg-type]
        )

    def required_friction(self, grasps: GraspSamples, fraction: float = 1.0) -> float:
        """Friction above which a fraction of the grasps is S; inf: none is sufficient.

        The smallest friction is meant, the lower end of an interval.

        Args:
            grasps: The grasps.
            fraction: Above 0 and at most 1.

        Raises:
            SettingError: The fraction is outside its range, or see `budget`.
        """
        check_range("the fraction", fraction, 0.0, 1.0, ends="(]")
        budget = self.budget(grasps)
        needed = budget.uncertain - budget.friction + budget.critical_angle
        order = np.argsort(needed)
        weights = np.asarray(grasps.weights)[order]
        reached = np.cumsum(weights) / weights.sum() >= fraction - FRACTION_ROUNDING
        angle = float(needed[order][np.argmax(reached)])
        return math.tan(angle) if angle < math.pi / 2.0 else math.inf

    def required_field(
        self,
        grasps: GraspSamples,
        fraction: float = 1.0,
        *,
        tip: float | CylinderTip | EllipsoidTip,
    ) -> float:
        """Receptive field below which a fraction of the grasps is S, whatever `sensor` is.

        Args:
            grasps: The grasps.
            fraction: Above 0 and at most 1.
            tip: Radius of a round fingertip, inf for a flat one; or a tip of another shape.

        Returns:
            The length; 0: none is short enough, inf: none is too long.

        Raises:
            SettingError: A value is outside its range, or see `budget`.
        """
        longest = _longest_field(tip, grasps)

        def with_field(length: float) -> FingerDesign:
            sensor = Sensor(length, tip) if isinstance(tip, float | int) else tip.sensor(length)
            return replace(self, sensor=sensor)

        return _largest(with_field, grasps, fraction, longest * (1.0 - FIELD_ROUNDING))

    def required_location(self, grasps: GraspSamples, fraction: float = 1.0) -> float:
        """Location error below which a fraction of the grasps is S, beside sensor and encoders.

        Args:
            grasps: The grasps.
            fraction: Above 0 and at most 1.

        Returns:
            The length; 0: none is small enough, inf: none is too large.

        Raises:
            SettingError: The fraction is outside its range, or see `budget`.
        """

        def with_location(length: float) -> FingerDesign:
            return replace(self, other=replace(self.other, location_error=length))

        return _largest(with_location, grasps, fraction, _longest(grasps))

    def required_counts(self, grasps: GraspSamples, fraction: float = 1.0) -> int | None:
        """Fewest counts per revolution, equal for all joints, at which a fraction is S.

        Args:
            grasps: The grasps.
            fraction: Above 0 and at most 1.

        Returns:
            The counts; None: not even exact encoders suffice.

        Raises:
            SettingError: The design has no encoders, the fraction is outside its range, or see
                `budget`.
        """
        encoders = self.encoders
        if encoders is None:
            raise SettingError("the design has no encoders whose counts could be computed")

        def with_counts(number: int) -> FingerDesign:
            return replace(self, encoders=replace(encoders, counts=float(number)))

        counts = range(1, MOST_COUNTS + 1)  # more of them never hold less
        index = bisect_left(counts, x=True, key=lambda n: _holds(with_counts(n), grasps, fraction))
        return counts[index] if index < len(counts) else None


def _holds(design: FingerDesign, grasps: GraspSamples, fraction: float) -> bool:
    check_range("the fraction", fraction, 0.0, 1.0, ends="(]")
    return design.stable_fraction(grasps) >= fraction - FRACTION_ROUNDING


def _largest(
    changed: Callable[[float], FingerDesign], grasps: GraspSamples, fraction: float, high: float
) -> float:
    """Largest value at which a fraction of the grasps is S; inf if it is still so at `high`."""
    if _holds(changed(high), grasps, fraction):
        return math.inf
    low, least = 0.0, FRACTION_ROUNDING * high
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        if middle > 0.0 and _holds(changed(middle), grasps, fraction):
            low = middle
        else:
            high = middle
    return low if low > least else 0.0


def _uncertainty_of(sensor: Sensor | Uncertainty | None) -> Uncertainty:
    if isinstance(sensor, Sensor):
        return sensor.uncertainty
    return sensor or Uncertainty()


def _longest_field(tip: float | CylinderTip | EllipsoidTip, grasps: GraspSamples) -> float:
    """A receptive field that is too long for every grasp, if any is."""
    if isinstance(tip, EllipsoidTip):
        return tip.longest_field
    radius = tip.radius if isinstance(tip, CylinderTip) else float(tip)
    return _longest(grasps) if math.isinf(radius) else math.pi * radius


def _longest(grasps: GraspSamples) -> float:
    """A length at which every line may turn by 90 degrees, as far as it may turn at all."""
    opening = np.asarray(grasps.opening)
    return 2.0 * max(1.0, float(np.max(opening[np.isfinite(opening)], initial=0.0)))
