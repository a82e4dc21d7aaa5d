"""Length of a polygon's perimeter whose critical friction angle is below a given angle, exactly.

Along an edge the second finger's normal is constant, so whether the critical angle is below depends
only on the direction of the line through both contacts, and changes only where that direction makes
one of a few angles with a normal. There a line through the fixed contact crosses the edge; each
piece between two such points is classified at its middle.
"""

import math

import numpy as np

from grasp3d.arrays import ArrayLike, Floats
from grasp3d.planar.contacts import TIE, OutlineContacts, turn_between

CHUNK = 1 << 16
"""Pairs of an angle and an edge in memory at once."""


def length_below(
    angles: ArrayLike,
    fixed: OutlineContacts,
    edges: OutlineContacts,
    along: Floats,
    *,
    best: bool,
) -> Floats:
    """Length of the part of the edges whose critical angle is below given angles.

    Args:
        angles: The angles [rad], any shape.
        fixed: The contact of the first finger.
        edges: The edges' starting points and normals (k,).
        along: The edges from start to end, shape (k, 2).
        best: Whether to take the best normals of the fixed finger instead of the worst.

    Returns:
        Lengths [unit], of the shape of angles.
    """
    clipped = np.clip(np.asarray(angles, dtype=np.float64), 0.0, 1.5 * math.pi)
    flat = clipped.reshape(-1)
    step = max(1, CHUNK // len(along))
    parts = [
        _length_below(flat[start : start + step, None, None], fixed, edges, along, best=best)
        for start in range(0, len(flat), step)
    ]
    return np.concatenate([np.zeros(0), *parts]).reshape(clipped.shape)


def _length_below(
    angle: Floats, fixed: OutlineContacts, edges: OutlineContacts, along: Floats, *, best: bool
) -> Floats:
    """See `length_below`; angle (b, 1, 1), result (b,)."""
    half_range = fixed.half_range[0]
    reach = angle + half_range if best else angle - half_range
    lines = [fixed.middle[0] + side * reach for side in (-1.0, 1.0)]
    lines += [edges.middle[:, None] + side * angle for side in (-1.0, 1.0)]
    breaks = _breaks(fixed.points[0], lines, edges.points, along)  # (b, k, 6)
    half = 0.5 * (breaks[..., 1:] + breaks[..., :-1])[..., None]  # (b, k, 5, 1)
    apart = edges.points[:, None] - fixed.points[0] + half * along[:, None]
    toward = np.arctan2(apart[..., 1], apart[..., 0])
    off_first = turn_between(toward, fixed.middle[0])
    off_second = turn_between(toward + math.pi, edges.middle[:, None])
    external = np.maximum(off_first - reach, off_second - angle) < -TIE
    internal = np.maximum(math.pi - off_first - reach, math.pi - off_second - angle) < -TIE
    lengths = np.hypot(along[:, 0], along[:, 1])[:, None] * np.diff(breaks)
    return np.asarray(np.where(external | internal, lengths, 0.0).sum(axis=(1, 2)))


def _breaks(point: Floats, directions: list[Floats], starts: Floats, along: Floats) -> Floats:
    """Parameters from 0 to 1 along each edge where lines through a point cross it, in order.

    Lines parallel to an edge make no break: the direction is the same along all of it.

    Args:
        point: Shape (2,).
        directions: Polar angles of the lines, each of shape (b, k or 1, 1).
        starts: Shape (k, 2).
        along: Shape (k, 2).

    Returns:
        Shape (b, k, len(directions) + 2).
    """
    shape = np.broadcast_shapes(*(d.shape for d in directions), (len(along), 1))
    phi = np.concatenate([np.broadcast_to(d, shape) for d in directions], axis=-1)
    back = point - starts
    above = np.cos(phi) * back[:, 1:] - np.sin(phi) * back[:, :1]
    slope = np.cos(phi) * along[:, 1:] - np.sin(phi) * along[:, :1]
    crossing = np.divide(above, slope, out=np.zeros_like(above), where=slope != 0.0)
    ends = np.broadcast_to([0.0, 1.0], (*shape[:2], 2))
    return np.sort(np.clip(np.concatenate([ends, crossing], axis=-1), 0.0, 1.0), axis=-1)
