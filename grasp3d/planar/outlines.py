"""Outlines of planar objects with one finger fixed on them (Wan & Howe 2018, Sec. IV)."""

import math
from abc import abstractmethod
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from grasp3d.arrays import ArrayLike, Floats, locked, short_repr
from grasp3d.errors import SettingError
from grasp3d.planar.contacts import STRAIGHT, OutlineContacts
from grasp3d.planar.fractions import length_below
from grasp3d.planar.polygons import TINY, area_centroid, length, simple_polygon
from grasp3d.settings import whole_number
from grasp3d.stability.angle_distributions import AngleDistribution, check_fraction


class Outline(AngleDistribution):
    """A closed counter-clockwise curve in the plane with one finger fixed on it.

    As a distribution it gives fractions of its perimeter, along which the second finger may be, by
    critical friction angle, in closed form.
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
        object.__setattr__(self, "fixed", _wrapped_position(self.fixed, self.perimeter))

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

    def worst_below(self, angles: ArrayLike) -> Floats:
        """See `AngleDistribution`: 2 angle / pi, for every position of the fixed finger.

        The line through fingers an angle t apart about the center is (pi - t) / 2 off both normals.
        """
        return np.clip(np.asarray(angles, dtype=np.float64) * (2.0 / math.pi), 0.0, 1.0)

    def best_below(self, angles: ArrayLike) -> Floats:
        """See `AngleDistribution`: a circle has no corners."""
        return self.worst_below(angles)

    def worst_quantile(self, fraction: float) -> float:
        """See `AngleDistribution`: the inverse."""
        check_fraction(fraction)
        return fraction * math.pi / 2.0


@dataclass(frozen=True, eq=False, init=False)
class Polyline(Outline):
    """Any closed polygon that does not touch itself; arc lengths begin at its first corner."""

    corners: Floats
    """Counter-clockwise corners without repetitions [unit], shape (n, 2)."""
    fixed: float
    name: str

    __repr__ = short_repr

    def __init__(self, corners: ArrayLike, fixed: float = 0.0, *, name: str = "polygon") -> None:
        """Check, copy and lock.

        Args:
            corners: Shape (k, 2), in either order; clockwise ones are reversed behind the first.
            fixed: Position of the fixed finger: arc length counter-clockwise from the first corner
                [unit], taken modulo the perimeter.
            name: Name for titles.

        Raises:
            SettingError: The corners are not a polygon, or the fixed position is not finite.
        """
        object.__setattr__(self, "corners", locked(simple_polygon(corners)))
        object.__setattr__(self, "fixed", _wrapped_position(fixed, self.perimeter))
        object.__setattr__(self, "name", name)

    @cached_property
    def perimeter(self) -> float:
        """See `Outline`."""
        return float(self._ends[-1])

    @cached_property
    def center_mass(self) -> Floats:
        """See `Outline`."""
        return locked(area_centroid(self.corners))

    @cached_property
    def torque_scale(self) -> float:
        """See `Outline`."""
        return float(np.hypot(*self._edges.points.T).max())

    @cached_property
    def corner_positions(self) -> Floats:
        """See `Outline`."""
        starts = self._ends - self._lengths
        starts[0] = 0.0
        return locked(starts[self._corners.half_range > STRAIGHT])

    def contacts_about_center(self, positions: ArrayLike) -> OutlineContacts:
        """See `Outline`; a contact within 1e-12 perimeters of a corner is at the corner."""
        wrapped = np.remainder(np.asarray(positions, dtype=np.float64), self.perimeter)
        edge = np.minimum(np.searchsorted(self._ends, wrapped, side="right"), len(self._ends) - 1)
        left = self._ends[edge] - wrapped
        fraction = 1.0 - left / self._lengths[edge]
        near = TINY * self.perimeter
        at_end, at_start = left <= near, self._lengths[edge] - left <= near
        edge = np.where(at_end, (edge + 1) % len(self._ends), edge)
        corner = at_end | at_start
        fraction = np.where(corner, 0.0, fraction)
        points = self._edges.points[edge] + fraction[:, None] * self._along[edge]
        normals = self._edges.last[edge]
        first = np.where(corner[:, None], self._corners.first[edge], normals)
        return OutlineContacts(locked(points), locked(first), locked(normals))

    def worst_below(self, angles: ArrayLike) -> Floats:
        """See `AngleDistribution`."""
        return self._fraction_below(angles, best=False)

    def best_below(self, angles: ArrayLike) -> Floats:
        """See `AngleDistribution`; not `worst_below` only if the fixed finger is at a corner."""
        return self._fraction_below(angles, best=True)

    def _fraction_below(self, angles: ArrayLike, *, best: bool) -> Floats:
        below = length_below(angles, self._finger, self._edges, self._along, best=best)
        return np.minimum(below / self.perimeter, 1.0)

    @cached_property
    def _finger(self) -> OutlineContacts:
        return self.contacts_about_center([self.fixed])

    @cached_property
    def _along(self) -> Floats:
        return np.asarray(np.roll(self.corners, -1, axis=0) - self.corners)

    @cached_property
    def _lengths(self) -> Floats:
        return np.asarray(np.hypot(*self._along.T))

    @cached_property
    def _ends(self) -> Floats:
        return np.cumsum(self._lengths)

    @cached_property
    def _edges(self) -> OutlineContacts:
        """Start point and normal of every edge."""
        normals = np.stack([-self._along[:, 1], self._along[:, 0]], axis=-1)
        normals /= self._lengths[:, None]
        return OutlineContacts(self.corners - self.center_mass, normals, normals)

    @cached_property
    def _corners(self) -> OutlineContacts:
        """Every corner with the normals of the edges before and behind it."""
        edges = self._edges
        return OutlineContacts(edges.points, np.roll(edges.last, 1, axis=0), edges.last)


def square(half_side: float = 1.0) -> Polyline:
    """Return the paper's square, the fixed finger in the middle of its bottom side.

    Args:
        half_side: Half of a side [unit].

    Raises:
        SettingError: It is not a length.
    """
    h = length("half side of the square", half_side)
    return Polyline([(0.0, -h), (h, -h), (h, h), (-h, h), (-h, -h)], name="square")


def regular_polygon(sides: int, radius: float = 1.0) -> Polyline:
    """Return a regular polygon, the fixed finger in the middle of its bottom side.

    Args:
        sides: Number of sides, at least 3.
        radius: Distance of the corners from the center [unit].

    Raises:
        SettingError: There are fewer sides, or the radius is not a length.
    """
    count = whole_number("the number of sides", sides, 3)
    r = length("radius of the polygon", radius)
    turn = (np.arange(count) + 0.5) * (2.0 * math.pi / count) - math.pi / 2.0
    corners = r * np.stack([np.cos(turn), np.sin(turn)], axis=-1)
    start = (0.0, -r * math.cos(math.pi / count))
    return Polyline(np.vstack([[start], corners]), name=f"regular polygon of {count} sides")


def circle_fractions(*, friction: float, sensor_resolution: float) -> dict[str, float]:
    """Fractions of the paper's circle that are S, M and U; see `AngleDistribution.fractions`."""
    return Circle().fractions(friction=friction, sensor_resolution=sensor_resolution)


def square_fractions(*, friction: float, sensor_resolution: float) -> dict[str, float]:
    """Fractions of the paper's square that are S, M and U; see `AngleDistribution.fractions`."""
    return square().fractions(friction=friction, sensor_resolution=sensor_resolution)


def _wrapped_position(position: float, perimeter: float) -> float:
    """Arc length modulo the perimeter."""
    if not math.isfinite(position):
        raise SettingError(
            f"the fixed finger's position must be a finite arc length; got {position:g}"
        )
    wrapped = position % perimeter
    return wrapped if wrapped < perimeter else 0.0
