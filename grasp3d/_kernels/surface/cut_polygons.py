"""Convex polygons in the plane that are cut by lines, in place.

A polygon is the first `size` of `CORNERS` rows of an array with two columns of coordinates,
counter-clockwise; the other rows and the third column are scratch.
"""

import math

from grasp3d._kernels.compiling.decorators import merged, scratch_kernel

CORNERS = 32
"""Most corners of a polygon; each cut adds one, or two by rounding errors."""


@scratch_kernel
def cut(polygon, size, a, b, c):
    """Cut off the part of a polygon where a x + b y + c > 0; (corners left, least value before).

    Args:
        polygon: Corners (2 * CORNERS, 3).
        size: Number of corners.
        a: Coefficient of x.
        b: Coefficient of y.
        c: Constant.
    """
    least, greatest = math.inf, -math.inf
    for i in range(size):
        value = a * polygon[i, 0] + b * polygon[i, 1] + c
        polygon[i, 2] = value
        least, greatest = min(least, value), max(greatest, value)
    if greatest <= 0.0:
        return size, least
    if least >= 0.0:
        return 0, least
    if size >= CORNERS - 2:  # no row is left: a polygon that is not cut contains too much
        return size, least
    left = CORNERS
    for i in range(size):
        after = i + 1 if i + 1 < size else 0
        value, other = polygon[i, 2], polygon[after, 2]
        if value <= 0.0:
            polygon[left, 0], polygon[left, 1] = polygon[i, 0], polygon[i, 1]
            left += 1
        if value < 0.0 < other or other < 0.0 < value:
            t = value / (value - other)
            polygon[left, 0] = polygon[i, 0] + t * (polygon[after, 0] - polygon[i, 0])
            polygon[left, 1] = polygon[i, 1] + t * (polygon[after, 1] - polygon[i, 1])
            left += 1
    left -= CORNERS
    for i in range(left):
        polygon[i, 0], polygon[i, 1] = polygon[CORNERS + i, 0], polygon[CORNERS + i, 1]
    return left, least


@merged
def centroid(polygon, size):
    """Centroid of a polygon, or the mean of its corners where it has no area."""
    x0, y0 = polygon[0, 0], polygon[0, 1]
    area, x, y = 0.0, 0.0, 0.0
    for i in range(1, size - 1):
        ux, uy = polygon[i, 0] - x0, polygon[i, 1] - y0
        wx, wy = polygon[i + 1, 0] - x0, polygon[i + 1, 1] - y0
        part = ux * wy - uy * wx
        area += part
        x += part * (ux + wx)
        y += part * (uy + wy)
    if area > 0.0:
        return x0 + x / (3.0 * area), y0 + y / (3.0 * area)
    x, y = 0.0, 0.0
    for i in range(size):
        x += polygon[i, 0]
        y += polygon[i, 1]
    return x / size, y / size


@merged
def stays_inside(polygon, size, x, y):
    """Whether a point is inside a polygon."""
    for i in range(size):
        after = i + 1 if i + 1 < size else 0
        ex, ey = polygon[after, 0] - polygon[i, 0], polygon[after, 1] - polygon[i, 1]
        if ex * (y - polygon[i, 1]) - ey * (x - polygon[i, 0]) < 0.0:
            return False
    return True
