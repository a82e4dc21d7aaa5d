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
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from grasp3d.errors import SettingError
from grasp3d.settings.checks import check_choice
from grasp3d.settings.uncertainty import Uncertainty

SMALL_UNCERTAINTY = 0.05
"""Largest location uncertainty that is small against the object, as a fraction of its size. At that
value the line of two opposing fingers may turn by about atan(2 x 0.05), which is the friction angle
of a friction of 0.1."""

COUNT_ROUNDING = 1e-12
"""Fraction by which a number of sensors may exceed a whole number and not be rounded up."""

ROUNDING = 1e-9
"""Fraction of a pitch by which a length may miss a whole number of pitches and count as one."""

JointKind = Literal["revolute", "prismatic"]
"""Kind of the joints of a finger; the jaws of a parallel gripper are prismatic."""

MOST_COUNTS = 2**40
"""Counts per revolution beyond any encoder, where a search for the required counts ends."""


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
        check_field(field)
        if not self.resolution < math.pi:
            raise SettingError(
                "receptive field must be shorter than half the fingertip's circumference, "
                f"pi x {radius:g} = {math.pi * radius:.4g}; got {field:g}"
            )

    @classmethod
    def for_resolution(cls, resolution: float, fingertip_radius: float) -> "Sensor":
        """Make the sensor that has a given resolution.

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
    def limiting(
        cls, friction: float, fingertip_radius: float, *, opening: float = math.inf
    ) -> "Sensor":
        """Sensor that is just too coarse for a friction: every finer one is fine enough.

        Args:
            friction: Coulomb coefficient, above 0.
            fingertip_radius: Radius of the tip; inf: flat.
            opening: Distance between two opposing fingers, to take their uncertain locations into
                account as well, see `misalignment`; inf: only the normals.

        Raises:
            SettingError: A value is outside its range, or the tip is flat and no opening is given:
                then no receptive field is too long.
        """
        beta = resolution_limit(friction) / 2.0
        half = _half(opening)
        if math.isinf(fingertip_radius):
            if math.isinf(half):
                raise SettingError(
                    "a flat fingertip has the same normal everywhere, so no receptive field is too "
                    "long for its normals; give the opening (on the command line --object-size) "
                    "to take its locations into account"
                )
            return cls(2.0 * half * friction, fingertip_radius)
        if not fingertip_radius > 0.0 or math.isinf(half / fingertip_radius):
            return cls(2.0 * beta * fingertip_radius, fingertip_radius)
        # The tip's centre, the contact and the line's midpoint make a triangle whose outer angle at
        # the contact is beta. In units of the radius: `tangent` is the length of the tangent from
        # the midpoint to the tip, `distance` that from the contact to the midpoint.
        tangent = math.sqrt(half / fingertip_radius) * math.sqrt(2.0 + half / fingertip_radius)
        distance = tangent * (tangent / (math.cos(beta) + math.hypot(math.cos(beta), tangent)))
        tilt = math.atan2(distance * math.sin(beta), 1.0 + distance * math.cos(beta))
        return cls(2.0 * tilt * fingertip_radius, fingertip_radius)

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
    def uncertainty(self) -> Uncertainty:
        """What this sensor leaves uncertain about a contact: its normal and its location.

        The location error is a length in the sensor's unit: a number, which is in the unit of the
        mesh that a model with it is used for.
        """
        return Uncertainty(
            sensor_resolution=self.resolution, location_error=self.location_uncertainty
        )

    @property
    def sensors_by_discs(self) -> int | None:
        """Fewest sensors that cover a hemisphere, as Wan & Howe 2018 count them.

        Area of the hemisphere over that of equal discs as wide as the receptive field: 8 / alpha^2,
        rounded up. A lower bound: no arrangement of two or more overlaps by less than 21 %
        (Kershner 1939 in the plane, L. Fejes Toth on the sphere).

        None for a flat tip, or one so nearly flat that the number overflows.
        """
        return _count(8.0, self.resolution)

    @property
    def sensors_by_caps(self) -> int | None:
        """Fewest sensors that cover a hemisphere, counting spherical caps of half-angle alpha / 2.

        1 / (1 - cos(alpha / 2)), rounded up; `sensors_by_discs` or one more, since caps are smaller
        than flat discs. A lower bound as well; None in the same cases.
        """
        return _count(0.5, math.sin(self.resolution / 4.0))

    @property
    def required_friction(self) -> float:
        """Friction above which grasps can be surely stable, tan(alpha / 2).

        At this value itself no grasp of fewer than seven contacts (four in the plane) is. 0 for a
        flat tip.
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
        half, radius = _half(opening), self.fingertip_radius
        if self.flat:
            return math.atan2(self.location_uncertainty, half)
        tangent = math.atan2(math.sqrt(half) * math.sqrt(2.0 * radius + half), radius)
        tilt = min(self.tilt, tangent)
        back = radius * (2.0 * math.sin(tilt / 2.0) ** 2)
        return math.atan2(radius * math.sin(tilt), half + back)

    def misalignment(self, opening: float) -> float:
        """Largest angle between a true normal and the true line of two opposing fingers [rad].

        Tilt and turn of the line come from the same displacement and add up: alpha / 2 +
        `line_error`. Exact up to 90 degrees, from where on no friction is enough. Wan & Howe 2018
        count the tilt alone, which is the limit for a wide opening.

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

    def warnings(self, object_size: float) -> tuple[str, ...]:
        """Warnings about what a model of uncertain normals alone neglects on an object.

        Args:
            object_size: Distance between two opposing fingers on the object, above 0.

        Returns:
            One sentence if the location uncertainty exceeds 5 % of the object's size, else none.

        Raises:
            SettingError: The size is not a length above 0.
        """
        turn, needed = self.line_error(object_size), self.required_friction_at(object_size)
        fraction = self.location_uncertainty / object_size
        if fraction <= SMALL_UNCERTAINTY:
            return ()
        friction = (
            f"which requires a friction above {needed:.4g} instead of {self.required_friction:.4g}"
            if math.isfinite(needed)
            else "which no friction compensates"
        )
        sentence = (
            f"the location uncertainty, {100.0 * fraction:.3g} % of the object's size, is not "
            f"small (up to {100.0 * SMALL_UNCERTAINTY:g} %): the line of two opposing fingers may "
            f"turn by up to {math.degrees(turn):.3g} degrees, {friction}"
        )
        return (sentence,)


def check_field(length: float) -> None:
    """Raise SettingError unless the length of a receptive field is above 0 and finite."""
    if not 0.0 < length < math.inf:
        raise SettingError(f"receptive field must be a finite length above 0; got {length:g}")


def _half(opening: float) -> float:
    if not opening > 0.0:
        raise SettingError(f"the distance between two fingers must be above 0; got {opening:g}")
    return opening / 2.0


def _count(numerator: float, denominator: float) -> int | None:
    """Number of sensors, numerator / denominator^2 rounded up; None where that overflows."""
    sensors = numerator / denominator / denominator if denominator > 0.0 else math.inf
    return None if math.isinf(sensors) else math.ceil(sensors * (1.0 - COUNT_ROUNDING))


def overlapping_field(receptive_field: float, pitch: float) -> float:
    """Length within which overlapping receptive fields do not distinguish contacts.

    It is the `receptive_field` of the `Sensor` that they are equal to, finer than one field.

    Sensing elements a pitch p apart, each of which reports whether the contact is within its own
    field of length l, distinguish contacts by *which* of them report. Along a line, fields begin
    every p and end every p, so the reports change at two combs of spacing p, shifted by l modulo p.
    At most n fields cover a point, n - 1 being the whole part of l / p. Contacts where n fields
    report lie within l - (n - 1) p of each other, and those between, where n - 1 report, within
    n p - l. The longer of the two is the length within which contacts are not distinguished: p / 2
    at best, for l = p (n - 1/2), and p at worst, for l = p (n - 1).

    The model: fields with sharp ends, equal lengths and pitches, yes or no from each, one direction
    on the tip. Elements that report how strongly they are touched can be finer than this; noise and
    uneven pitch make them coarser.

    Args:
        receptive_field: Length l of the field of each sensing element, above 0.
        pitch: Distance p between the middles of neighbouring fields, above 0; at most the length of
            the fields, since there are gaps between them otherwise.

    Returns:
        max(l - (n - 1) p, n p - l), n - 1 being the whole part of l / p; from p / 2 to p.

    Raises:
        SettingError: A value is outside its range.

    Example:
        Fields of 6 mm every 4 mm are as good as fields of 2 mm side by side:

        >>> from grasp3d.contact import overlapping_field
        >>> overlapping_field(6.0, 4.0), overlapping_field(4.0, 4.0)
        (2.0, 4.0)
    """
    check_field(receptive_field)
    if not 0.0 < pitch <= receptive_field:
        raise SettingError(
            "pitch must be above 0 and at most the receptive field, or contacts between the fields "
            f"are not felt; got {pitch:g} for fields of {receptive_field:g}"
        )
    whole = math.floor(receptive_field / pitch + ROUNDING)
    rest = max(0.0, receptive_field - whole * pitch)  # 0: fields end where others begin
    return max(rest, pitch - rest)


@dataclass(frozen=True)
class JointEncoders:
    """Encoders of the joints of one finger.

    An encoder of N counts per revolution reports the nearest count, so the angle of its joint is
    known to half a count, pi / N. Wan & Howe 2018 (Sec. III-A) name encoders as an uncertainty and
    work none out; here is the bound for a chain of joints.

    A turn of one joint by an angle e moves the contact by at most r e, where r is the distance of
    the contact from the joint's axis, and turns the fingertip by e. Put the errors in one after the
    other, from the base to the tip: each joint then still has its own distance from the contact,
    which depends only on the joints after it. So the contact moves by at most the sum of all r e,
    and the normal turns by at most the sum of all e: not only for small errors.

    Example:
        A finger with two joints, 60 mm and 30 mm from the contact, and encoders of 12 bits:

        >>> import math
        >>> from grasp3d.contact import JointEncoders
        >>> encoders = JointEncoders(counts=4096, lengths=(60.0, 30.0))
        >>> print(f"{math.degrees(encoders.normal_error):.3f} degrees")
        0.088 degrees
        >>> print(f"{encoders.location_error:.3f} mm")
        0.069 mm
    """

    counts: tuple[float, ...] | float
    """Counts per revolution of every encoder, or of each joint; above 0, inf: exact. After
    quadrature decoding: four times the number of lines of an incremental encoder."""
    lengths: tuple[float, ...]
    """Revolute: distance of each joint's axis from the contact. Prismatic: travel of the jaw per
    revolution of its encoder. At least 0, in any unit."""
    kind: JointKind = "revolute"

    def __post_init__(self) -> None:
        check_choice("joint kind", self.kind, JointKind)
        object.__setattr__(self, "lengths", _numbers(self.lengths))
        if isinstance(self.counts, Sequence):
            object.__setattr__(self, "counts", _numbers(self.counts))
        steps = self.counts if isinstance(self.counts, tuple) else (self.counts,)
        if not all(count > 0.0 for count in steps):
            raise SettingError(f"encoder counts must be above 0; got {self.counts}")
        if isinstance(self.counts, tuple) and len(steps) != len(self.lengths):
            raise SettingError(
                f"encoder counts must be one for all joints or one for each; got {len(steps)}, but "
                f"joints: {len(self.lengths)}"
            )
        if not all(0.0 <= length < math.inf for length in self.lengths):
            raise SettingError(
                f"lengths of joints must be finite and at least 0; got {self.lengths}"
            )

    @classmethod
    def exact(cls) -> "JointEncoders":
        """Encoders without any error."""
        return cls(math.inf, ())

    @property
    def joints(self) -> int:
        """Number of joints."""
        return len(self.lengths)

    @property
    def angle_errors(self) -> tuple[float, ...]:
        """Largest error of each joint's encoder [rad]: half a count, pi / counts."""
        steps = self.counts if isinstance(self.counts, tuple) else (self.counts,) * self.joints
        return tuple(math.pi / count for count in steps)

    @property
    def normal_error(self) -> float:
        """Largest angle by which the fingertip, and so the normal, turns [rad].

        The sum of the joints' errors, attained where all axes are parallel and across the normal;
        0 for prismatic joints.
        """
        return sum(self.angle_errors) if self.kind == "revolute" else 0.0

    @property
    def location_error(self) -> float:
        """Largest distance between the true and the perceived contact across the closing axis.

        Revolute joints: in any direction, the sum of length times error. 0 for prismatic joints.
        """
        return self._travel if self.kind == "revolute" else 0.0

    @property
    def closing_error(self) -> float:
        """Largest distance between true and perceived contact along the closing axis.

        Of prismatic joints, which move the contact along the closing axis: that turns no normals. 0
        for revolute joints, whose `location_error` holds in every direction.
        """
        return self._travel / (2.0 * math.pi) if self.kind == "prismatic" else 0.0

    @property
    def _travel(self) -> float:
        pairs = zip(self.lengths, self.angle_errors, strict=True)
        return sum(length * error for length, error in pairs)

    @property
    def contact_error(self) -> float:
        """Largest distance between the true and the perceived contact, in any direction.

        `location_error` or `closing_error`. An error along the closing axis turns no line by
        itself, but it makes the opening shorter, on which other location errors then act: so it is
        one of them.
        """
        return max(self.location_error, self.closing_error)

    @property
    def uncertainty(self) -> Uncertainty:
        """What these encoders make uncertain about a contact; the unit is that of the lengths.

        Raises:
            SettingError: The normal error is 90 degrees or more.
        """
        return Uncertainty(normal_error=self.normal_error, location_error=self.contact_error)


def _numbers(values: object) -> tuple[float, ...]:
    try:
        return tuple(float(value) for value in values)  # type: ignore[attr-defined]
    except (TypeError, ValueError) as error:
        raise SettingError(f"encoders take numbers, one for each joint; got {values!r}") from error
