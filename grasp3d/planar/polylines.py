"""Polygons, the paper's square among them (Wan & Howe 2018, Sec. III-B)."""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Unpack

import numpy as np

from grasp3d.arrays import ArrayLike, Floats, locked, short_repr
from grasp3d.errors import SettingError
from grasp3d.planar.contacts import STRAIGHT, TIE, Lines, OutlineContacts
from grasp3d.planar.outlines import (
    LARGEST,
    SMALLEST,
    FractionSettings,
    Outline,
    length,
    wrapped_position,
)
from grasp3d.settings import whole_number

CHUNK = 1 << 16
"""Pairs of an angle and an edge in memory at once."""


def _located_crossings(
    point: Floats, directions: list[Floats], starts: Floats, along: Floats, location: float
) -> list[Floats]:
    """Parameters along each edge where borders of uncertain locations cross it, (b, k, ...) each.

    See `_crossings`. Contacts nearer than the location errors have lines of any direction: turned
    by 90 degrees.
    """
    turned = [*directions, *(direction + 0.5 * math.pi for direction in directions)]
    lines = [
        _crossings(point, turned, starts, along, shift) for shift in (-location, 0.0, location)
    ]
    circle = _circle_crossings(point, starts, along, location)
    return [*lines, np.broadcast_to(circle, (*lines[0].shape[:2], 2))]


def _crossings(
    point: Floats, directions: list[Floats], starts: Floats, along: Floats, shift: float = 0.0
) -> Floats:
    """Parameters along each edge where lines cross it, 0 at its start and 1 at its end.

    Lines parallel to an edge make no break: the direction is the same along all of it.

    Args:
        point: Point that the lines pass, shape (2,).
        directions: Polar angles of the lines, each of shape (b, k or 1, 1).
        starts: Shape (k, 2).
        along: Shape (k, 2).
        shift: Distance of the lines from the point, to their left.

    Returns:
        Shape (b, k, len(directions)).
    """
    shape = np.broadcast_shapes(*(d.shape for d in directions), (len(along), 1))
    phi = np.concatenate([np.broadcast_to(d, shape) for d in directions], axis=-1)
    back = point - starts
    above = np.cos(phi) * back[:, 1:] - np.sin(phi) * back[:, :1] + shift
    slope = np.cos(phi) * along[:, 1:] - np.sin(phi) * along[:, :1]
    return np.asarray(np.divide(above, slope, out=np.zeros_like(above), where=slope != 0.0))


def _circle_crossings(point: Floats, starts: Floats, along: Floats, radius: float) -> Floats:
    """Parameters along each edge where the circle about a point crosses it, shape (k, 2).

    Where it does not, both are those of the edge's point nearest to the centre.
    """
    squared = (along**2).sum(axis=1)
    back = point - starts
    nearest = (back * along).sum(axis=1) / squared
    distance = (back[:, 0] * along[:, 1] - back[:, 1] * along[:, 0]) ** 2 / squared
    half = np.sqrt(np.maximum(radius**2 - distance, 0.0) / squared)
    return np.stack([nearest - half, nearest + half], axis=-1)


def _ordered(crossings: list[Floats]) -> Floats:
    """Parameters (b, k, m) from 0 to 1 in order, with both ends."""
    ends = np.broadcast_to([0.0, 1.0], (*crossings[0].shape[:2], 2))
    return np.sort(np.clip(np.concatenate([ends, *crossings], axis=-1), 0.0, 1.0), axis=-1)


TINY = 1e-12
"""Fraction of an outline's size below which lengths count as 0."""

FEWEST = 3
"""Least number of corners of a polygon."""


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
        object.__setattr__(self, "fixed", wrapped_position(fixed, self.perimeter))
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
        rest = self._ends[edge] - wrapped
        fraction = 1.0 - rest / self._lengths[edge]
        near = TINY * self.perimeter
        at_end, at_start = rest <= near, self._lengths[edge] - rest <= near
        edge = np.where(at_end, (edge + 1) % len(self._ends), edge)
        corner = at_end | at_start
        fraction = np.where(corner, 0.0, fraction)
        points = self._edges.points[edge] + fraction[:, None] * self._along[edge]
        normals = self._edges.last[edge]
        first = np.where(corner[:, None], self._corners.first[edge], normals)
        return OutlineContacts(locked(points), locked(first), locked(normals))

    def fraction_below(self, angles: ArrayLike, *, location: float, best: bool) -> Floats:
        """See `Outline`: from the points of the edges where the label changes."""
        clipped = np.clip(np.asarray(angles, dtype=np.float64), 0.0, 1.5 * math.pi)
        flat = clipped.reshape(-1)
        step = max(1, CHUNK // len(self.corners))
        chunks = [flat[start : start + step, None, None] for start in range(0, len(flat), step)]
        parts = [self._length_below(chunk, best=best, location=location) for chunk in chunks]
        below = np.concatenate([np.zeros(0), *parts]).reshape(clipped.shape)
        return np.minimum(below / self.perimeter, 1.0)

    def _length_below(self, angle: Floats, *, best: bool, location: float) -> Floats:
        """Length of the part of the edges whose angle is below given ones (b, 1, 1), shape (b,)."""
        finger, edges, along = self._finger, self._edges, self._along
        half_range, point = finger.half_range[0], finger.points[0]
        reach = angle + half_range if best else angle - half_range
        directions = [finger.middle[0] + side * reach for side in (-1.0, 1.0)]
        directions += [edges.middle[:, None] + side * angle for side in (-1.0, 1.0)]
        crossings = [_crossings(point, directions, edges.points, along)]
        if location != 0.0:
            crossings = _located_crossings(point, directions, edges.points, along, location)
        breaks = _ordered(crossings)  # (b, k, m)
        half = 0.5 * (breaks[..., 1:] + breaks[..., :-1])[..., None]  # (b, k, m - 1, 1)
        apart = edges.points[:, None] - point + half * along[:, None]
        lines = Lines.of(apart, finger.middle[0], edges.middle[:, None])
        angles = (lines.best if best else lines.worst)((half_range, np.zeros(1)), location)
        below = angles - angle < -TIE
        lengths = self._lengths[:, None] * np.diff(breaks)
        return np.asarray(np.where(below, lengths, 0.0).sum(axis=(1, 2)))

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


def square_fractions(
    *, location_error: float = 0.0, **settings: Unpack[FractionSettings]
) -> dict[str, float]:
    """Fractions of the paper's square that are S, M and U; keywords as of `Outline.fractions`.

    `location_error` is a number of half sides.

    Example:
        >>> from grasp3d.planar import square_fractions
        >>> fractions = square_fractions(friction=1.0, sensor_resolution=0.4, location_error=0.1)
        >>> {name: round(fraction, 3) for name, fraction in fractions.items()}
        {'S': 0.25, 'M': 0.362, 'U': 0.388}
    """
    return square().fractions(location_error=location_error, **settings)


def simple_polygon(corners: ArrayLike) -> Floats:
    """Corners of a simple polygon, counter-clockwise.

    Consecutive equal corners count once, and the first corner may be repeated at the end. The first
    corner stays the first if the order is reversed.

    Args:
        corners: Shape (k, 2), in either order.

    Returns:
        Shape (at most k, 2).

    Raises:
        SettingError: They are not a simple polygon.
    """
    points = _finite_points(corners)
    size = float(np.abs(points - points.mean(axis=0)).max())
    if size < SMALLEST:
        raise SettingError("the corners of the outline must not all be one point")
    near = (points - points.mean(axis=0)) / size
    steps = np.hypot(*(near - np.roll(near, -1, axis=0)).T)
    keep = steps > TINY * len(near)
    near, points = near[keep], points[keep]
    if len(points) < FEWEST:
        raise SettingError(
            f"an outline needs at least {FEWEST} different corners; got {len(points)}"
        )
    _check_apart(near)
    area = float(_cross(near, np.roll(near, -1, axis=0)).sum())  # twice, above 0 if in order
    return points if area > 0.0 else np.roll(points[::-1], 1, axis=0)


def area_centroid(corners: Floats) -> Floats:
    """Centroid of the area inside a polygon, shape (2,)."""
    middle = corners.mean(axis=0)
    here = corners - middle
    there = np.roll(here, -1, axis=0)
    parts = _cross(here, there)
    return np.asarray(middle + parts @ (here + there) / (3.0 * parts.sum()))


def _finite_points(corners: ArrayLike) -> Floats:
    try:
        points = np.asarray(corners, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise SettingError(f"corners must be an array of numbers: {error}") from error
    if points.ndim != 2 or points.shape[1] != 2:
        raise SettingError(f"corners must have shape (k, 2); got {points.shape}")
    if len(points) < FEWEST:
        raise SettingError(f"an outline needs at least {FEWEST} corners; got {len(points)}")
    if not (np.abs(points) <= LARGEST).all():
        where = int(np.flatnonzero(~(np.abs(points) <= LARGEST).all(axis=1))[0])
        raise SettingError(
            f"corners must be finite and at most {LARGEST:g}; corner {where} is "
            f"({points[where, 0]:g}, {points[where, 1]:g})"
        )
    return points


def _check_apart(corners: Floats) -> None:
    """Refuse edges that cross, and corners that lie on other edges."""
    count = len(corners)
    ends = np.roll(corners, -1, axis=0)
    for i, (start, end) in enumerate(zip(corners, ends, strict=True)):
        along = end - start
        side = _cross(along, corners - start)  # of every corner
        fraction = np.clip((corners - start) @ along / (along @ along), 0.0, 1.0)
        distance = np.hypot(*(corners - start - fraction[:, None] * along).T)
        distance[[i, (i + 1) % count]] = math.inf
        if distance.min() <= TINY:
            raise SettingError(
                f"the outline must not touch itself; corner {int(distance.argmin())} lies on the "
                f"edge that starts at corner {i}"
            )
        straddles = side * np.roll(side, -1) < 0.0
        across = ends - corners
        parts = _cross(across, start - corners) * _cross(across, end - corners) < 0.0
        if (straddles & parts).any():
            raise SettingError(
                f"the outline must not cross itself; the edges that start at corners {i} and "
                f"{int((straddles & parts).argmax())} do"
            )


def _cross(first: Floats, second: Floats) -> Floats:
    return np.asarray(first[..., 0] * second[..., 1] - first[..., 1] * second[..., 0])
