"""Sensors of a finger: the resolution of a tactile fingertip, and the encoders of its joints.

A fingertip localises a contact only to within its receptive field, an arc of length l on its
surface. On a tip of radius R the normals of that arc differ by up to alpha = l / R: the sensor
resolution. A flat tip has the same normal everywhere, so alpha = 0 and only the location is
uncertain. Fewer than seven contacts (four in the plane) are surely stable only while
alpha < 2 atan(friction) (Wan & Howe 2018, Sec. IV-A, who write alpha <= 2 beta; at the bound
itself no grasp is).

Wan & Howe's numbers (Sec. IV-A), for a hemispherical fingertip of 2 cm diameter: friction 0.5 needs
53 degrees, an arc of about 9 mm and 10 sensors; friction 0.2 needs 22.6 degrees, about 4 mm and 50
sensors. Computed here: 53.13 degrees, 9.27 mm, 10; 22.62 degrees, 3.95 mm and 52. Their 50 follows
from 3.95 mm rounded to 4.

Lengths may be in any unit, the same for all.
"""

import math
from dataclasses import dataclass

from grasp3d.errors import SettingError

COUNT_ROUNDING = 1e-12
"""Fraction by which a number of sensors may exceed a whole number and not be rounded up."""

MARGIN_ROUNDING = 1e-12
"""Margin up to which a sensor is not fine enough [rad]."""


def resolution_limit(friction: float) -> float:
    """Resolution alpha that a sensor must stay below for any grasp to be surely stable [rad].

    Wan & Howe 2018, Sec. IV-A: 2 atan(friction).

    Args:
        friction: Coulomb coefficient, above 0.

    Raises:
        SettingError: The friction is not a finite number above 0.
    """
    if not (friction > 0.0 and math.isfinite(friction)):
        raise SettingError(f"friction must be a finite number above 0; got {friction:g}")
    return 2.0 * math.atan(friction)


def required_counts(joints: int, friction: float, sensor_resolution: float = 0.0) -> int | None:
    """Counts per revolution that a finger's encoders need for any grasp to be surely stable.

    An encoder of N counts knows the angle of its joint to half a count, pi / N. The errors of J
    joints turn the fingertip, and so the normal, by at most their sum, which a stretched finger
    attains. With the sensor's alpha / 2 this must stay below the friction angle:
    J pi / N < atan(friction) - alpha / 2. Wan & Howe 2018 (Sec. IV-B) name encoders as an
    uncertainty, without numbers.

    Args:
        joints: Number of revolute joints between palm and fingertip, at least 1.
        friction: Coulomb coefficient, above 0.
        sensor_resolution: alpha [rad].

    Returns:
        The smallest number, after quadrature decoding; None: not even exact encoders suffice.

    Raises:
        SettingError: A value is outside its range.

    Example:
        >>> from grasp3d.contact import required_counts
        >>> required_counts(2, friction=0.5, sensor_resolution=0.4)
        24
    """
    if joints < 1:
        raise SettingError(f"a finger must have at least one joint; got {joints}")
    margin = (resolution_limit(friction) - sensor_resolution) / 2.0
    if margin <= MARGIN_ROUNDING:
        return None
    return math.floor(joints * math.pi / margin * (1.0 + COUNT_ROUNDING)) + 1


@dataclass(frozen=True)
class Sensor:
    """A tactile fingertip, hemispherical or flat, and the size of its receptive field.

    Example:
        A fingertip of 10 mm radius that cannot distinguish contacts within 4 mm:

        >>> import math
        >>> import grasp3d
        >>> sensor = grasp3d.Sensor(receptive_field=4.0, fingertip_radius=10.0)
        >>> angle = math.degrees(sensor.resolution)
        >>> print(f"{angle:.1f} degrees, {sensor.sensors_by_discs} sensors on the fingertip")
        22.9 degrees, 50 sensors on the fingertip
        >>> print(f"grasps can be surely stable above a friction of {sensor.required_friction:.2f}")
        grasps can be surely stable above a friction of 0.20
    """

    receptive_field: float
    """Length of the arc within which contact points cannot be distinguished, above 0 and below half
    the circumference."""
    fingertip_radius: float
    """Radius of the tip, above 0; inf: a flat tip."""

    def __post_init__(self) -> None:
        radius, field = self.fingertip_radius, self.receptive_field
        if not radius > 0.0:
            raise SettingError(f"fingertip radius must be above 0, inf for flat; got {radius:g}")
        if not 0.0 < field < math.inf:
            raise SettingError(f"receptive field must be a finite length above 0; got {field:g}")
        if not self.resolution < math.pi:
            raise SettingError(
                "receptive field must be shorter than half the fingertip's circumference, "
                f"pi x {radius:g} = {math.pi * radius:.4g}; got {field:g}"
            )

    @classmethod
    def for_resolution(cls, resolution: float, fingertip_radius: float) -> "Sensor":
        """Make a sensor of a given resolution.

        Args:
            resolution: Angle between the extreme normals [rad], above 0, below pi.
            fingertip_radius: Radius of the tip, above 0 and finite.

        Raises:
            SettingError: A value is outside its range, or the tip is flat: then the resolution is 0
                whatever the receptive field.
        """
        if not 0.0 < resolution < math.pi:
            raise SettingError(
                "a round fingertip's resolution must be above 0 and below 180 degrees (pi "
                f"radians); got {math.degrees(resolution):g} degrees (in Python angles are radians)"
            )
        if math.isinf(fingertip_radius):
            raise SettingError(
                "a flat fingertip has the same normal everywhere, its resolution is 0; "
                "give its receptive field instead"
            )
        return cls(resolution * fingertip_radius, fingertip_radius)

    @classmethod
    def limiting(cls, friction: float, fingertip_radius: float) -> "Sensor":
        """Make the sensor that is just too coarse for a friction; every finer one is fine enough.

        Args:
            friction: Coulomb coefficient, above 0.
            fingertip_radius: Radius of the tip, above 0 and finite.

        Raises:
            SettingError: A value is outside its range, or the tip is flat.
        """
        return cls.for_resolution(resolution_limit(friction), fingertip_radius)

    @property
    def flat(self) -> bool:
        """Whether the tip is flat."""
        return math.isinf(self.fingertip_radius)

    @property
    def resolution(self) -> float:
        """Sensor resolution alpha [rad]: the angle between the receptive field's outer normals."""
        return self.receptive_field / self.fingertip_radius

    @property
    def tilt(self) -> float:
        """Largest angle between the true and the perceived normal, alpha / 2 [rad]."""
        return self.resolution / 2.0

    @property
    def location_uncertainty(self) -> float:
        """Largest distance between true and perceived contact point: half the receptive field."""
        return self.receptive_field / 2.0

    @property
    def sensors_by_discs(self) -> int | None:
        """Fewest sensors that cover a hemisphere, counted as in Wan & Howe 2018.

        The area of the hemisphere divided by that of a disc as wide as the receptive field:
        8 / alpha^2, rounded up. It is a lower bound: no arrangement of two or more overlaps by less
        than 21 % (Kershner 1939 in the plane, L. Fejes Toth on the sphere).

        It is None for a flat tip, or one so nearly flat that the number overflows.
        """
        return _count(8.0, self.resolution)

    @property
    def sensors_by_caps(self) -> int | None:
        """Fewest sensors that cover a hemisphere, counting spherical caps of half-angle alpha / 2.

        1 / (1 - cos(alpha / 2)), rounded up; `sensors_by_discs` or one more, since caps are smaller
        than flat discs. This is also a lower bound, and None in the same cases.
        """
        return _count(0.5, math.sin(self.resolution / 4.0))

    @property
    def required_friction(self) -> float:
        """Friction above which grasps can be surely stable, tan(alpha / 2).

        At this value itself, no grasp of fewer than seven contacts (four in the plane) is surely
        stable. It is 0 for a flat tip.
        """
        return self.required_friction_at(math.inf)

    def line_error(self, opening: float) -> float:
        """Largest angle between the true and the perceived line of two opposing fingers.

        Each contact may lie anywhere in its receptive field; in the worst case both lie at ends of
        it, on opposite sides of the perceived line. Flat tips: atan(receptive field / opening).
        Exact for round tips as well: the ends of their receptive fields are R sin(alpha / 2) to the
        side and R (1 - cos(alpha / 2)) back, and no line turns past the one tangent to both tips.

        Args:
            opening: Distance between the perceived contacts, above 0; their normals lie on the
                line through them.

        Returns:
            The angle [rad].

        Raises:
            SettingError: The opening is not a length above 0.
        """
        if not opening > 0.0:
            raise SettingError(f"the distance between two fingers must be above 0; got {opening:g}")
        half, radius = opening / 2.0, self.fingertip_radius
        if self.flat:
            return math.atan2(self.location_uncertainty, half)
        tangent = math.atan2(math.sqrt(half) * math.sqrt(2.0 * radius + half), radius)
        tilt = min(self.tilt, tangent)
        back = radius * (2.0 * math.sin(tilt / 2.0) ** 2)
        return math.atan2(radius * math.sin(tilt), half + back)

    def misalignment(self, opening: float) -> float:
        """Largest angle between a true normal and the true line of two opposing fingers [rad].

        Tilt and turn of the line come from the same displacement and add up:
        alpha / 2 + `line_error`. Exact up to 90 degrees; from there on no friction is enough. Wan &
        Howe 2018 count the tilt alone, which is the limit for a wide opening.

        Args:
            opening: Distance between the perceived contacts, above 0, or inf.

        Raises:
            SettingError: The opening is not a length above 0.
        """
        return self.tilt + self.line_error(opening)

    def required_friction_at(self, opening: float) -> float:
        """Friction above which two opposing fingers with uncertain locations can be surely stable.

        The tangent of `misalignment`; receptive field / opening for flat tips.

        Args:
            opening: Distance between the perceived contacts, above 0, or inf.

        Returns:
            The coefficient; inf where no friction is enough.

        Raises:
            SettingError: The opening is not a length above 0.
        """
        angle = self.misalignment(opening)
        return math.tan(angle) if angle < math.pi / 2.0 else math.inf


def _count(numerator: float, denominator: float) -> int | None:
    """Number of sensors, numerator / denominator^2 rounded up; None where that overflows."""
    sensors = numerator / denominator / denominator if denominator > 0.0 else math.inf
    return None if math.isinf(sensors) else math.ceil(sensors * (1.0 - COUNT_ROUNDING))
