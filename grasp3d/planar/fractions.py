"""Length of a polygon's perimeter whose critical friction angle is below a given angle, exactly.

Along an edge the second finger's normal is constant, so whether the critical angle is below depends
only on the direction of the line through both contacts, and changes only where that direction makes
one of a few angles with a normal. There a line through the fixed contact crosses the edge; each
piece between two such points is classified at its middle.

Uncertain locations move the second contact against the first by up to d1 + d2, so that the whole
disc of that radius must be (or some point of it must not be) within the cones. The boundaries are
then lines parallel to those through the fixed contact, d1 + d2 away, and the circle of that radius
about it: their crossings with the edges are in closed form, too.
"""

import math

import numpy as np

from grasp3d.arrays import ArrayLike, Bools, Floats
from grasp3d.planar.contacts import TIE, Lines, OutlineContacts

CHUNK = 1 << 16
"""Pairs of an angle and an edge in memory at once."""


def length_below(
    angles: ArrayLike,
    fixed: OutlineContacts,
    edges: OutlineContacts,
    along: Floats,
    *,
    best: bool,
    location: float = 0.0,
) -> Floats:
    """Length of the part of the edges whose critical angle is below given angles.

    Args:
        angles: The angles [rad], any shape.
        fixed: The contact of the first finger.
        edges: The edges' starting points and normals (k,).
        along: The edges from start to end, shape (k, 2).
        best: Whether to take the best normals of the fixed finger and the best true locations
            instead of the worst.
        location: Sum of the two location errors [unit].

    Returns:
        Lengths [unit], of the shape of angles.
    """
    clipped = np.clip(np.asarray(angles, dtype=np.float64), 0.0, 1.5 * math.pi)
    flat = clipped.reshape(-1)
    step = max(1, CHUNK // len(along))
    chunks = [flat[start : start + step, None, None] for start in range(0, len(flat), step)]
    parts = [
        _length_below(chunk, fixed, edges, along, best=best, location=location) for chunk in chunks
    ]
    return np.concatenate([np.zeros(0), *parts]).reshape(clipped.shape)


def _length_below(
    angle: Floats,
    fixed: OutlineContacts,
    edges: OutlineContacts,
    along: Floats,
    *,
    best: bool,
    location: float,
) -> Floats:
    """See `length_below`; angle (b, 1, 1), result (b,)."""
    half_range, point = fixed.half_range[0], fixed.points[0]
    reach = angle + half_range if best else angle - half_range
    directions = [fixed.middle[0] + side * reach for side in (-1.0, 1.0)]
    directions += [edges.middle[:, None] + side * angle for side in (-1.0, 1.0)]
    crossings = [_crossings(point, directions, edges.points, along)]
    if location != 0.0:
        crossings = _located_crossings(point, directions, edges.points, along, location)
    breaks = _ordered(crossings)  # (b, k, m)
    half = 0.5 * (breaks[..., 1:] + breaks[..., :-1])[..., None]  # (b, k, m - 1, 1)
    apart = edges.points[:, None] - point + half * along[:, None]
    lines = Lines.of(apart, fixed.middle[0], edges.middle[:, None])
    if location == 0.0:
        below = _below(lines, reach, angle)
    else:
        found = (lines.best if best else lines.worst)((half_range, np.zeros(1)), location)
        below = found - angle < -TIE
    lengths = np.hypot(along[:, 0], along[:, 1])[:, None] * np.diff(breaks)
    return np.asarray(np.where(below, lengths, 0.0).sum(axis=(1, 2)))


def _below(lines: Lines, reach: Floats, angle: Floats) -> Bools:
    """Whether the angles to the first and second normals are below `reach` and `angle`."""
    off_first, off_second = lines.off()
    external = np.maximum(off_first - reach, off_second - angle) < -TIE
    internal = np.maximum(math.pi - off_first - reach, math.pi - off_second - angle) < -TIE
    return np.asarray(external | internal)


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
