"""Outlines of planar objects with one finger fixed on them (Wan & Howe 2018, Sec. III-B).

The paper's circle is such an outline.
"""

import math
from abc import abstractmethod
from dataclasses import dataclass
from typing import Required, TypedDict, Unpack

import numpy as np

from grasp3d.arrays import ArrayLike, Floats, locked, short_repr
from grasp3d.errors import SettingError
from grasp3d.planar.contacts import OutlineContacts
from grasp3d.settings.checks import check_range
from grasp3d.stability.angle_distributions import (
    AngleDistribution,
    check_number,
    critical_angle_below,
)

SMALLEST, LARGEST = 1e-100, 1e100
"""Limits of lengths: squares of smaller and larger ones underflow and overflow."""


class FractionSettings(TypedDict, total=False):
    """Keywords of `AngleDistribution.fractions`."""

    friction: Required[float | tuple[float, float]]
    sensor_resolution: Required[float]
    friction_error: float
    normal_error: float


class Outline(AngleDistribution):
    """A closed counter-clockwise curve in the plane with one finger fixed on it.

    As a distribution it gives fractions of its perimeter, along which the second finger may be, by
    critical friction angle, in closed form; `angle_distribution` is that at a location error.
    """

    name: str
    """Name for titles."""
    fixed: float
    """Arc length of the fixed finger [unit], from 0 to less than the perimeter."""

    @property
    @abstractmethod
    def perimeter(self) -> float:
        """Length of the curve [unit]."""

    @property
    @abstractmethod
    def center_mass(self) -> Floats:
        """Centroid of the area inside, shape (2,)."""

    @property
    @abstractmethod
    def torque_scale(self) -> float:
        """Largest distance of the curve from its center of mass [unit]."""

    @property
    @abstractmethod
    def corner_positions(self) -> Floats:
        """Arc lengths of the corners [unit], ascending, shape (c,)."""

    @abstractmethod
    def contacts_about_center(self, positions: ArrayLike) -> OutlineContacts:
        """Like `contacts_at`, with points relative to the center of mass."""

    def contacts_at(self, positions: ArrayLike) -> OutlineContacts:
        """Contacts at positions along the perimeter.

        Args:
            positions: Arc lengths [unit], shape (k,), taken modulo the perimeter.
        """
        near = self.contacts_about_center(positions)
        return OutlineContacts(locked(near.points + self.center_mass), near.first, near.last)

    @abstractmethod
    def fraction_below(self, angles: ArrayLike, *, location: float, best: bool) -> Floats:
        """Fractions of the perimeter where the worst or the best angle is below some angles.

        Args:
            angles: The angles [rad], any shape.
            location: Sum of the location errors of both fingers [unit].
            best: Whether to take the best normals and true locations instead of the worst.
        """

    def worst_below(self, angles: ArrayLike) -> Floats:
        """See `AngleDistribution`."""
        return self.fraction_below(angles, location=0.0, best=False)

    def best_below(self, angles: ArrayLike) -> Floats:
        """See `AngleDistribution`; not `worst_below` only if the fixed finger is at a corner."""
        return self.fraction_below(angles, location=0.0, best=True)

    def angle_distribution(self, *, location_error: float = 0.0) -> "OutlineAngles":
        """Distribution of the angles at a location error.

        Args:
            location_error: Largest distance between a true and a perceived contact point, for both
                fingers, as a number in the outline's unit.

        Raises:
            SettingError: It is not a finite number of at least 0.
        """
        check_number(location_error)
        return OutlineAngles(self, float(location_error))

    def fractions(
        self, *, location_error: float = 0.0, **settings: Unpack[FractionSettings]
    ) -> dict[str, float]:
        """Fractions of the perimeter that are S, M and U, in closed form.

        Args:
            location_error: See `angle_distribution`.
            **settings: As of `AngleDistribution.fractions`: friction, sensor_resolution,
                friction_error and normal_error.

        Raises:
            SettingError: A value is outside its range.

        Example:
            Contacts on a circle that are known to within a tenth of its radius:

            >>> from grasp3d.planar import Circle
            >>> fractions = Circle(30.0).fractions(
            ...     friction=1.0, sensor_resolution=0.5, location_error=3.0
            ... )
            >>> {name: round(fraction, 3) for name, fraction in fractions.items()}
            {'S': 0.271, 'M': 0.388, 'U': 0.341}
        """
        return self.angle_distribution(location_error=location_error).fractions(**settings)


@dataclass(frozen=True, eq=False)
class OutlineAngles(AngleDistribution):
    """Angles along an outline at a location error; see `Outline.angle_distribution`.

    Example:
        The coarsest sensor with which a fifth of a square of side 40 is surely stable:

        >>> import math
        >>> from grasp3d.planar import square
        >>> for error in (0.0, 1.0, 2.0):
        ...     located = square(20.0).angle_distribution(location_error=error)
        ...     angle = math.degrees(located.required_resolution(0.2, friction=0.5))
        ...     print(f"contacts within {error:g}: below {angle:.1f} degrees")
        contacts within 0: below 9.5 degrees
        contacts within 1: below 4.2 degrees
        contacts within 2: below 0.0 degrees
    """

    outline: Outline
    location_error: float
    """Of both fingers [unit of the outline]."""

    __repr__ = short_repr

    def angle_distribution(self, *, location_error: float = 0.0) -> "OutlineAngles":
        """Distribution on the same outline at another location error."""
        return self.outline.angle_distribution(location_error=location_error)

    def worst_below(self, angles: ArrayLike) -> Floats:
        """See `AngleDistribution`."""
        return self._below(angles, best=False)

    def best_below(self, angles: ArrayLike) -> Floats:
        """See `AngleDistribution`."""
        return self._below(angles, best=True)

    def _below(self, angles: ArrayLike, *, best: bool) -> Floats:
        location = 2.0 * self.location_error
        return self.outline.fraction_below(angles, location=location, best=best)


def wrapped_position(position: float, perimeter: float) -> float:
    """Arc length modulo the perimeter."""
    if not math.isfinite(position):
        raise SettingError(
            f"the fixed finger's position must be a finite arc length; got {position:g}"
        )
    wrapped = position % perimeter
    return wrapped if wrapped < perimeter else 0.0


def length(name: str, value: float) -> float:
    """Check a length: finite and above 0.

    Raises:
        SettingError: It is outside the limits.
    """
    if not SMALLEST <= value <= LARGEST:
        raise SettingError(
            f"the {name} must be above 0, from {SMALLEST:g} to {LARGEST:g}; got {value:g}"
        )
    return float(value)


@dataclass(frozen=True)
class Circle(Outline):
    """A circle about the origin; arc lengths begin at its lowest point."""

    radius: float = 1.0
    fixed: float = 0.0
    name: str = "circle"

    def __post_init__(self) -> None:
        """Check, and take the fixed position modulo the perimeter.

        Raises:
            SettingError: The radius is not a length, or the fixed position is not finite.
        """
        object.__setattr__(self, "radius", length("radius of the circle", self.radius))
        object.__setattr__(self, "fixed", wrapped_position(self.fixed, self.perimeter))

    @property
    def perimeter(self) -> float:
        """See `Outline`."""
        return 2.0 * math.pi * self.radius

    @property
    def center_mass(self) -> Floats:
        """See `Outline`."""
        return locked(np.zeros(2))

    @property
    def torque_scale(self) -> float:
        """See `Outline`."""
        return self.radius

    @property
    def corner_positions(self) -> Floats:
        """None."""
        return locked(np.zeros(0))

    def contacts_about_center(self, positions: ArrayLike) -> OutlineContacts:
        """See `Outline`."""
        turn = np.asarray(positions, dtype=np.float64) / self.radius - math.pi / 2.0
        outward = np.stack([np.cos(turn), np.sin(turn)], axis=-1)
        inward = locked(-outward)
        return OutlineContacts(locked(self.radius * outward), inward, inward)

    def fraction_below(self, angles: ArrayLike, *, location: float, best: bool) -> Floats:
        """See `Outline`: 2 x / pi, where the worst line at beta* = x makes that angle.

        The line through fingers an angle t apart about the center is (pi - t) / 2 off both normals,
        for every position of the fixed finger. No line is nearer to both, so the best angle does
        not depend on the location error.
        """
        ratio = 0.0 if best else location / (2.0 * self.radius)
        return critical_angle_below(angles, ratio) * (2.0 / math.pi)

    def worst_quantile(self, fraction: float) -> float:
        """See `AngleDistribution`: the inverse."""
        check_range("a fraction", fraction, 0.0, 1.0)
        return fraction * math.pi / 2.0


def circle_fractions(
    *, location_error: float = 0.0, **settings: Unpack[FractionSettings]
) -> dict[str, float]:
    """Fractions of the paper's circle that are S, M and U; keywords as of `Outline.fractions`.

    `location_error` is a number of radii.

    Example:
        >>> from grasp3d.planar import circle_fractions
        >>> table = circle_fractions(friction=(0.9, 1.1), sensor_resolution=0.4, location_error=0.1)
        >>> {name: round(fraction, 3) for name, fraction in table.items()}
        {'S': 0.269, 'M': 0.388, 'U': 0.342}
    """
    return Circle().fractions(location_error=location_error, **settings)
