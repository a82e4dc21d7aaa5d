"""Fingertips whose curvature varies: cylinders and ellipsoids.

On such a tip the sensor resolution depends on the contact point, and on the direction in which the
contact is displaced. A receptive field of length l reports the normal at its middle; the true
contact is up to l / 2 away along the tip, and the normal there differs by some angle. Twice its
largest value is alpha, as on a sphere, where it is l / R everywhere.

A cylinder's normal turns only around its axis: alpha = l cos(direction) / R, where the direction is
measured from the circumference. An ellipsoid's normal turns fastest near the end of its longest
axis, towards its shortest one: `EllipsoidTip.worst`. `sensor()` gives the round tip that has this
alpha: its resolution and its uncertainty are safe for the tip.

Lengths may be in any unit, the same for all.
"""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from grasp3d.arrays import ArrayLike, Floats, angles_between, unit_rows
from grasp3d.contact.friction_cones import cone_edges
from grasp3d.contact.sensor import COUNT_ROUNDING, Sensor, check_field
from grasp3d.errors import SettingError

DIRECTIONS = 64
"""Directions in which normals are followed from a contact point."""

SMALL_TURN = 1e-6
"""Angle up to which an ellipse is as good as its circle of curvature [rad]."""

STEPS = 48
"""Steps of each way along an ellipsoid, of the fourth order."""


@dataclass(frozen=True)
class CylinderTip:
    """A fingertip with the shape of a cylinder's side, without the edges at its ends.

    Example:
        >>> import math
        >>> from grasp3d.contact import CylinderTip
        >>> tip = CylinderTip(radius=10.0)
        >>> for degrees in (0.0, 60.0, 90.0):
        ...     angle = math.degrees(tip.resolution(4.0, direction=math.radians(degrees)))
        ...     print(f"{degrees:.0f} degrees from the circumference: {angle:.1f} degrees")
        0 degrees from the circumference: 22.9 degrees
        60 degrees from the circumference: 11.5 degrees
        90 degrees from the circumference: 0.0 degrees
    """

    radius: float
    """Radius, above 0."""

    def resolution(self, receptive_field: float, *, direction: float = 0.0) -> float:
        """Sensor resolution along a direction on the tip [rad].

        Args:
            receptive_field: Length within which contact points are not distinguished.
            direction: Angle from the circumference [rad]; the worst is 0, and along the axis the
                normal is the same everywhere.

        Raises:
            SettingError: A length is outside its range.
        """
        return self.sensor(receptive_field).resolution * abs(math.cos(direction))

    def sensor(self, receptive_field: float) -> Sensor:
        """The round tip with the worst resolution of this one, that around the circumference.

        Args:
            receptive_field: Length within which contact points are not distinguished.

        Raises:
            SettingError: A length is outside its range.
        """
        return Sensor(receptive_field, self.radius)


@dataclass(frozen=True)
class TipResolution:
    """Sensor resolution at a contact point of a tip."""

    resolution: float
    """Resolution alpha [rad]: twice the largest angle between the normal at the contact point and
    normals within half a receptive field."""
    point: tuple[float, float, float]
    """The contact point, from the tip's centre and along its axes."""
    direction: tuple[float, float, float]
    """Unit tangent there, towards that normal."""


@dataclass(frozen=True)
class EllipsoidTip:
    """A fingertip with the shape of an ellipsoid, or of half of one.

    Example:
        A tip that is longer than wide:

        >>> import math
        >>> from grasp3d.contact import EllipsoidTip
        >>> tip = EllipsoidTip((10.0, 10.0, 15.0))
        >>> print(f"{math.degrees(tip.resolution_at(4.0, (0.0, 0.0, 1.0)).resolution):.1f} degrees")
        33.6 degrees
        >>> print(f"{math.degrees(tip.resolution_at(4.0, (1.0, 0.0, 0.0)).resolution):.1f} degrees")
        22.9 degrees
        >>> print(f"{math.degrees(tip.worst(4.0).resolution):.1f} degrees")
        34.2 degrees
    """

    semi_axes: tuple[float, float, float]
    """Half the extents of the ellipsoid along its axes, above 0."""

    def __post_init__(self) -> None:
        try:
            axes = tuple(float(axis) for axis in self.semi_axes)
        except (TypeError, ValueError):
            axes = ()
        if len(axes) != 3 or not all(0.0 < axis < math.inf for axis in axes):
            raise SettingError(
                "semi-axes of a fingertip must be three finite lengths above 0; got "
                f"{self.semi_axes}"
            )
        object.__setattr__(self, "semi_axes", axes)

    @property
    def largest_curvature(self) -> float:
        """Largest curvature of the tip: longest over shortest semi-axis squared.

        alpha is below receptive field times this, and close to it for small receptive fields.
        """
        return max(self.semi_axes) / min(self.semi_axes) ** 2

    @cached_property
    def longest_field(self) -> float:
        """Receptive field at which the resolution reaches 180 degrees, `worst` on this tip."""
        return 4.0 * _arc(max(self.semi_axes), min(self.semi_axes), math.pi / 4.0)

    def resolution_at(self, receptive_field: float, towards: ArrayLike) -> TipResolution:
        """Sensor resolution at a contact point, along the direction in which it is the largest.

        The normals are followed along 64 geodesics, the shortest ways on the tip.

        Args:
            receptive_field: Length within which contact points are not distinguished, above 0.
            towards: A direction from the centre, not 0; the contact point is where it leaves the
                tip.

        Raises:
            SettingError: A value is outside its range.
        """
        check_field(receptive_field)
        start = self._surface_point(towards)
        normal = self._normals(start)
        tangents = cone_edges(normal, math.pi / 2.0, edges=DIRECTIONS)
        ends = self._walk(np.broadcast_to(start, tangents.shape), tangents, receptive_field / 2.0)
        turned = angles_between(np.broadcast_to(normal, ends.shape), self._normals(ends))
        worst = int(np.argmax(turned.max(axis=0)))
        point, direction = map(_triple, (start, tangents[worst]))
        return TipResolution(2.0 * float(turned.max()), point, direction)

    def worst(self, receptive_field: float) -> TipResolution:
        """Largest sensor resolution on the whole tip.

        It is on the ellipse of the longest and the shortest axis: the end of the longest axis is
        midway between the contact point and the normal that differs most. (Tests compare this with
        a search over the tip.)

        Args:
            receptive_field: Length within which contact points are not distinguished, above 0.

        Raises:
            SettingError: The length is outside its range, or so long that normals differ by 90
                degrees and more.
        """
        check_field(receptive_field)
        if not receptive_field < self.longest_field:
            raise SettingError(
                f"receptive field must be below {self.longest_field:.4g} on this fingertip, since "
                "normals within half of a longer one differ by 90 degrees and more; got "
                f"{receptive_field:g}"
            )
        angle = self._turn(receptive_field / 4.0)  # on either side of the end of the longest axis
        point, direction = self._on_ellipse(angle)
        return TipResolution(4.0 * angle, point, direction)

    def sensor(self, receptive_field: float) -> Sensor:
        """The round tip that has the worst resolution of this one everywhere.

        Args:
            receptive_field: Length within which contact points are not distinguished, above 0.

        Raises:
            SettingError: See `worst`.
        """
        return Sensor(receptive_field, receptive_field / self.worst(receptive_field).resolution)

    def sensors_by_discs(self, receptive_field: float) -> int:
        """Fewest sensors that cover half of the ellipsoid, counted as for `Sensor`.

        Args:
            receptive_field: Length within which contact points are not distinguished, above 0.

        Raises:
            SettingError: The length is outside its range.
        """
        check_field(receptive_field)
        count = self._half_area / (math.pi * (receptive_field / 2.0) ** 2)
        return math.ceil(count * (1.0 - COUNT_ROUNDING))

    @cached_property
    def _half_area(self) -> float:
        """Half the area of the ellipsoid, by Carlson's symmetric elliptic integral."""
        from scipy.special import elliprg

        a, b, c = self.semi_axes
        return float(2.0 * math.pi * elliprg((a * b) ** 2, (a * c) ** 2, (b * c) ** 2))

    def _turn(self, length: float) -> float:
        """Angle of the normal at a way from the end of the longest axis towards the shortest."""
        from scipy.optimize import brentq

        long, short = max(self.semi_axes), min(self.semi_axes)
        if length * self.largest_curvature < SMALL_TURN:
            return length * self.largest_curvature
        return float(brentq(lambda turn: _arc(long, short, turn) - length, 0.0, math.pi / 4.0))

    def _surface_point(self, towards: ArrayLike) -> Floats:
        direction = np.asarray(towards, dtype=np.float64)
        scale = np.linalg.norm(direction / self.semi_axes) if direction.shape == (3,) else 0.0
        if not 0.0 < scale < math.inf:
            raise SettingError(f"a direction must be three finite numbers, not 0; got {towards!r}")
        return np.asarray(direction / scale)

    def _normals(self, points: Floats) -> Floats:
        return unit_rows(points / np.square(self.semi_axes))

    def _walk(self, points: Floats, tangents: Floats, length: float) -> Floats:
        """Points (steps, k, 3) along the geodesics from points (k, 3) with unit tangents (k, 3)."""
        inverse = 1.0 / np.square(self.semi_axes)

        def change(state: Floats) -> Floats:
            # The acceleration along the normal keeps the way on the surface x A x = 1.
            position, velocity = state
            gradient = position * inverse
            pull = (velocity**2 @ inverse) / (gradient**2).sum(axis=-1)
            return np.stack([velocity, -pull[:, None] * gradient])

        state, step, path = np.stack([points, tangents]), length / STEPS, []
        for _ in range(STEPS):  # Runge-Kutta
            one = change(state)
            two = change(state + 0.5 * step * one)
            three = change(state + 0.5 * step * two)
            four = change(state + step * three)
            state = state + step / 6.0 * (one + 2.0 * two + 2.0 * three + four)
            path.append(state[0])
        return np.array(path)

    def _on_ellipse(self, angle: float) -> tuple[tuple[float, float, float], ...]:
        """Point and tangent on the ellipse of the longest and the shortest axis.

        The normal there is at an angle from the longest axis, and the tangent points to its end.
        """
        long, short = int(np.argmax(self.semi_axes)), int(np.argmin(self.semi_axes))
        if long == short:  # a sphere
            short = (long + 1) % 3
        a, c = self.semi_axes[long], self.semi_axes[short]
        cosine, sine, axes = math.cos(angle), math.sin(angle), np.eye(3)
        point = (a * a * cosine * axes[long] + c * c * sine * axes[short]) / math.hypot(
            a * cosine, c * sine
        )
        return _triple(point), _triple(sine * axes[long] - cosine * axes[short])


def _arc(long: float, short: float, angle: float) -> float:
    """Length of an ellipse from the end of its longer axis to where the normal has an angle."""
    from scipy.special import ellipeinc

    # In the parameter t of (long cos t, short sin t), whose normal has the angle atan(tan t long /
    # short). The length from t = 0 is long E(t + 90 degrees) - long E(90 degrees).
    parameter = math.atan2(short * math.sin(angle), long * math.cos(angle))
    modulus = 1.0 - (short / long) ** 2
    quarter = math.pi / 2.0
    return float(long * (ellipeinc(parameter + quarter, modulus) - ellipeinc(quarter, modulus)))


def _triple(vector: Floats) -> tuple[float, float, float]:
    x, y, z = (float(value) + 0.0 for value in vector)
    return x, y, z
