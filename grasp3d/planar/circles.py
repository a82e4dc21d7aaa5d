"""The paper's circle (Wan & Howe 2018, Sec. III-B)."""

import math
from dataclasses import dataclass

import numpy as np

from grasp3d.arrays import ArrayLike, Floats, locked
from grasp3d.planar.contacts import OutlineContacts
from grasp3d.planar.outlines import Outline, wrapped_position
from grasp3d.planar.polygons import length
from grasp3d.stability.angle_distributions import check_fraction
from grasp3d.stability.round_shapes import critical_angle_below


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
        check_fraction(fraction)
        return fraction * math.pi / 2.0


def circle_fractions(
    *,
    friction: float | tuple[float, float],
    sensor_resolution: float,
    friction_error: float = 0.0,
    normal_error: float = 0.0,
    location_error: float = 0.0,
) -> dict[str, float]:
    """Fractions of the paper's circle that are S, M and U; see `Outline.fractions`.

    `location_error` is a number of radii.

    Example:
        >>> from grasp3d.planar import circle_fractions
        >>> found = circle_fractions(friction=(0.9, 1.1), sensor_resolution=0.4, location_error=0.1)
        >>> {name: round(fraction, 3) for name, fraction in found.items()}
        {'S': 0.269, 'M': 0.388, 'U': 0.342}
    """
    return Circle().fractions(
        friction=friction,
        sensor_resolution=sensor_resolution,
        friction_error=friction_error,
        normal_error=normal_error,
        location_error=location_error,
    )
