"""Convex polygons in a plane: corners in counterclockwise order, shape (n, 2).

Polygons of fewer than three corners are empty.
"""

from collections.abc import Iterator

import numpy as np

from grasp3d.arrays import Floats

SAME_CORNER = 1e-9
"""Distance up to which neighbouring corners are one [m]: the line through them has no direction."""


def rectangle(low: Floats, high: Floats) -> Floats:
    """The rectangle between two opposite corners (2,), shape (4, 2)."""
    return np.array([low, [high[0], low[1]], high, [low[0], high[1]]])


def clipped(polygon: Floats, values: Floats) -> Floats:
    """The part of a polygon where a linear function, of values (n,) at its corners, is at most 0.

    Example:
        >>> import numpy as np
        >>> from grasp3d.hand.convex_polygons import clipped, rectangle
        >>> square = rectangle(np.zeros(2), np.ones(2))
        >>> clipped(square, square[:, 0] - 0.5).tolist()
        [[0.0, 0.0], [0.5, 0.0], [0.5, 1.0], [0.0, 1.0]]
    """
    inside = values <= 0.0
    if inside.all():
        return polygon
    kept = []
    for i in range(len(polygon)):
        j = (i + 1) % len(polygon)
        if inside[i]:
            kept.append(polygon[i])
        if inside[i] != inside[j]:
            t = values[i] / (values[i] - values[j])
            kept.append((1.0 - t) * polygon[i] + t * polygon[j])
    points = np.array(kept).reshape(-1, 2)
    steps = np.abs(points - np.roll(points, 1, axis=0)).max(axis=1, initial=0.0)
    return np.asarray(points[steps > SAME_CORNER])


def common(one: Floats, two: Floats) -> Floats:
    """The part of a polygon that is within another one."""
    if len(one) < 3 or len(two) < 3:
        return one[:0]
    if (one.max(axis=0) < two.min(axis=0)).any() or (two.max(axis=0) < one.min(axis=0)).any():
        return one[:0]
    for *normal, offset in _sides(two):
        one = clipped(one, one @ normal + offset)
    return one


def without(polygon: Floats, hole: Floats, narrow: float) -> Iterator[Floats]:
    """Parts of a polygon that are outside another one, but for those at most `narrow` wide."""
    if width(common(polygon, hole)) <= narrow:
        yield polygon
        return
    for *normal, offset in _sides(hole):
        outside = polygon @ normal + offset
        part = clipped(polygon, -outside)
        if width(part) > narrow:
            yield part
        polygon = clipped(polygon, outside)


def _sides(polygon: Floats) -> Floats:
    """Half-planes ny y + nz z + d <= 0 whose intersection a polygon is, not scaled (n, 3)."""
    along = np.roll(polygon, -1, axis=0) - polygon
    normals = np.column_stack([along[:, 1], -along[:, 0]])
    return np.column_stack([normals, -(normals * polygon).sum(axis=1)])


def width(polygon: Floats) -> float:
    """Smallest distance of parallel lines that a polygon is between."""
    if len(polygon) < 3:
        return 0.0
    sides = _sides(polygon)
    rows = sides / np.hypot(sides[:, 0], sides[:, 1])[:, None]
    return float(-(polygon @ rows[:, :2].T + rows[:, 2]).min(axis=0).max())


def area(polygon: Floats) -> float:
    """Area of a polygon."""
    x, y = polygon.T
    return 0.5 * float(x @ np.roll(y, -1) - y @ np.roll(x, -1))


def without_flat_corners(polygon: Floats, distance: float) -> Floats:
    """A polygon without corners that are nearer than that to the line through their neighbours."""
    while len(polygon) > 2:
        before, after = np.roll(polygon, 1, axis=0), np.roll(polygon, -1, axis=0)
        (ax, ay), (bx, by) = (after - before).T, (polygon - before).T
        heights = np.abs(ax * by - ay * bx) / np.maximum(np.hypot(ax, ay), distance)
        flattest = int(heights.argmin())
        if heights[flattest] >= distance:
            break
        polygon = np.delete(polygon, flattest, axis=0)
    return polygon
