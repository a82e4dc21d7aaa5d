"""Design of a finger, backward: which sensor, encoders or friction given grasps require.

A grasp of two fingers is surely stable while its critical friction angle and all uncertainties
together stay below the friction angle at the smallest friction (`MarginBudget`). Every uncertainty
only adds to this sum, so for each there is a largest value at which a given fraction of the grasps
is still S, with all others as they are. For J joints whose errors only turn the fingertip, encoders
of N counts must have pi J / N <= beta - alpha / 2 - beta* - eta; their location error makes eta
depend on N as well, which is included here.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from grasp3d.arrays import ArrayLike, short_repr
from grasp3d.contact.budget import PARTS, MarginBudget
from grasp3d.contact.encoders import MOST_COUNTS, JointEncoders
from grasp3d.contact.sensor import Sensor
from grasp3d.contact.tips import CylinderTip, EllipsoidTip
from grasp3d.errors import SettingError
from grasp3d.settings.uncertainty import Uncertainty, friction_interval

FIELD_ROUNDING = 1e-9
"""Fraction of the longest receptive field by which tested ones stay below it."""

BISECTIONS = 60
"""Bisections of an interval of lengths, which end at rounding errors."""

FRACTION_ROUNDING = 1e-12
"""Fraction of all grasps that rounding errors of weights may amount to."""


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
    at each contact point, of which the one with the largest margin counts; inf: no grasp."""
    opening: ArrayLike = math.inf
    """Distance between the contacts, at least 0, of the same shape; inf: locations do not
    matter."""
    weights: ArrayLike = 1.0
    """Weight of each contact point, at least 0, shape (k,)."""

    __repr__ = short_repr

    def __post_init__(self) -> None:
        pair = (
            np.atleast_1d(np.asarray(one, float)) for one in (self.critical_angle, self.opening)
        )
        critical, opening = np.broadcast_arrays(*pair)
        weights = np.broadcast_to(np.asarray(self.weights, float), critical.shape[:1])
        for name, values in zip(
            ("critical_angle", "opening", "weights"), (critical, opening, weights), strict=True
        ):
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
        _check(fraction)
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

        def with_counts(counts: int) -> FingerDesign:
            return replace(self, encoders=replace(encoders, counts=float(counts)))

        low, high = 0, 1
        while not _holds(with_counts(high), grasps, fraction):
            if high > MOST_COUNTS:
                return None
            low, high = high, 2 * high
        while high - low > 1:
            middle = (low + high) // 2
            holds = _holds(with_counts(middle), grasps, fraction)
            low, high = (low, middle) if holds else (middle, high)
        return high


def _holds(design: FingerDesign, grasps: GraspSamples, fraction: float) -> bool:
    _check(fraction)
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


def _check(fraction: float) -> None:
    if not 0.0 < fraction <= 1.0:
        raise SettingError(f"the fraction must be above 0 and at most 1; got {fraction:g}")
