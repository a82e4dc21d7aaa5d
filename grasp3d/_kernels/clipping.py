"""Parts of triangles: those within bounds along the axes, and those within a ball.

A polygon is an array with a row for each corner, in order: position, then barycentric coordinates
in the triangle that it is part of (n, 6).
"""

import math

from grasp3d._kernels.compiling import kernel

CORNERS = 12
"""Rows that a triangle needs when it is cut by up to six planes."""


@kernel
def write_triangle(corners, side, polygon):
    """Write a triangle (3, 3) as a polygon, with x multiplied by `side`."""
    for i in range(3):
        polygon[i, 0] = side * corners[i, 0]
        for k in range(1, 3):
            polygon[i, k] = corners[i, k]
        for k in range(3):
            polygon[i, 3 + k] = 1.0 if k == i else 0.0
    return 3


@kernel
def clip(polygon, count, axis, sign, limit, clipped):
    """Write the part of a convex polygon where sign * coordinate <= limit.

    Args:
        polygon: The polygon.
        count: Number of its corners.
        axis: Index of the coordinate.
        sign: +1 or -1.
        limit: Largest value of sign * coordinate.
        clipped: Written, another array of the same shape.

    Returns:
        Number of corners of the part; 0: nothing remains.
    """
    kept = 0
    for i in range(count):
        j = i + 1 if i + 1 < count else 0
        here, there = limit - sign * polygon[i, axis], limit - sign * polygon[j, axis]
        if here >= 0.0:
            clipped[kept] = polygon[i]
            kept += 1
        if (here > 0.0 and there < 0.0) or (here < 0.0 and there > 0.0):
            t = here / (here - there)
            for k in range(6):
                clipped[kept, k] = (1.0 - t) * polygon[i, k] + t * polygon[j, k]
            clipped[kept, axis] = sign * limit
            kept += 1
    return kept


@kernel
def clip_to_rectangle(corners, side, half_width, half_height, polygon, spare):
    """Write the part of a triangle with |y| <= half_width and |z| <= half_height to `polygon`.

    Returns:
        Number of its corners; 0: nothing remains.
    """
    count, inside = write_triangle(corners, side, polygon), True
    for i in range(3):
        inside &= abs(corners[i, 1]) <= half_width and abs(corners[i, 2]) <= half_height
    if inside:
        return count
    count = clip(polygon, count, 1, 1.0, half_width, spare)
    count = clip(spare, count, 1, -1.0, half_width, polygon)
    count = clip(polygon, count, 2, 1.0, half_height, spare)
    return clip(spare, count, 2, -1.0, half_height, polygon)


@kernel
def projected_moments(polygon, count, mean):
    """Area of a convex polygon seen along x, and its centroid with respect to that area.

    Args:
        polygon: The polygon.
        count: Number of its corners.
        mean: Written, centroid as a row of a polygon (6,); nothing is written if the area is 0.
    """
    total = 0.0
    for i in range(1, count - 1):
        total += _projected_area(polygon, i)
    if total > 0.0:
        mean[:] = 0.0
        for i in range(1, count - 1):
            part = _projected_area(polygon, i) / (3.0 * total)
            for k in range(6):
                mean[k] += part * (polygon[0, k] + polygon[i, k] + polygon[i + 1, k])
    return total


@kernel
def _projected_area(polygon, i):
    """Area of the triangle of the corners 0, i and i + 1, seen along x."""
    ay, az = polygon[i, 1] - polygon[0, 1], polygon[i, 2] - polygon[0, 2]
    by, bz = polygon[i + 1, 1] - polygon[0, 1], polygon[i + 1, 2] - polygon[0, 2]
    return 0.5 * abs(ay * bz - az * by)


@kernel
def disc_moments(ax, ay, bx, by, radius, totals):
    """Add the area and first moments of a disc's part in the triangle of its centre, a and b.

    The sum over the edges of a polygon is that of the disc's part in the polygon.

    Args:
        ax: Start of the edge, relative to the centre of the disc.
        ay: The same.
        bx: End of the edge.
        by: The same.
        radius: Radius of the disc.
        totals: Added to: signed area, and its moments about the centre (3,).
    """
    dx, dy = bx - ax, by - ay
    first, last = crossings(ax, ay, dx, dy, radius)
    for piece in range(3):
        low = 0.0 if piece == 0 else (first if piece == 1 else last)
        high = first if piece == 0 else (last if piece == 1 else 1.0)
        if high <= low:
            continue
        px, py, qx, qy = ax + low * dx, ay + low * dy, ax + high * dx, ay + high * dy
        cross = px * qy - py * qx
        if piece == 1:  # inside: a triangle
            totals[0] += 0.5 * cross
            totals[1] += cross * (px + qx) / 6.0
            totals[2] += cross * (py + qy) / 6.0
        else:  # outside: a sector
            p, q = math.hypot(px, py), math.hypot(qx, qy)
            totals[0] += 0.5 * radius**2 * math.atan2(cross, px * qx + py * qy)
            totals[1] += radius**3 / 3.0 * (qy / q - py / p)
            totals[2] += radius**3 / 3.0 * (px / p - qx / q)


@kernel
def crossings(ax, ay, dx, dy, radius):
    """Where the edge a + t d, 0 <= t <= 1, enters and leaves a disc about the origin.

    Returns:
        (enters, leaves); both 1 where it does not meet the disc.
    """
    square = dx * dx + dy * dy
    if square == 0.0:
        return 1.0, 1.0
    nearest = -(ax * dx + ay * dy) / square
    cross = ax * dy - ay * dx
    half = radius * radius / square - (cross / square) ** 2
    if half <= 0.0:
        return 1.0, 1.0
    half = math.sqrt(half)
    first, last = max(nearest - half, 0.0), min(nearest + half, 1.0)
    return (first, last) if first < last else (1.0, 1.0)
