"""Convex polygons cut by lines and planes: parts of triangles, and regions of a plane.

A part of a triangle is an array (n, 6) with a row for each corner, in order: the position, then the
barycentric coordinates in the triangle. A region of a plane is the first `size` of `REGION_CORNERS`
rows of an array with two columns of coordinates, counter-clockwise; the other rows and the third
column are scratch.
"""

import math

from grasp3d._kernels.compiling import merged, part

MOST_EDGES = 12
"""Most sides of a convex face of a jaw."""

CORNERS = 2 * MOST_EDGES
"""Rows needed by a triangle that is cut by the sides of a face and two more planes."""


@part
def write_triangle(corners, side, polygon):
    """Write a triangle (3, 3) as a polygon, with x multiplied by `side`; return its 3 corners."""
    for i in range(3):
        polygon[i, 0] = side * corners[i, 0]
        for k in range(1, 3):
            polygon[i, k] = corners[i, k]
        for k in range(3):
            polygon[i, 3 + k] = 1.0 if k == i else 0.0
    return 3


@part
def clip(polygon, count, plane, clipped):
    """Write the part of a convex polygon where plane[0] x + plane[1] y + plane[2] z <= plane[3].

    Args:
        polygon: The polygon.
        count: Number of its corners.
        plane: Four numbers.
        clipped: Written, another array of the same shape.

    Returns:
        Number of corners of the part, 0 if nothing remains.
    """
    a, b, c, limit = plane
    kept = 0
    for i in range(count):
        j = i + 1 if i + 1 < count else 0
        here = limit - a * polygon[i, 0] - b * polygon[i, 1] - c * polygon[i, 2]
        there = limit - a * polygon[j, 0] - b * polygon[j, 1] - c * polygon[j, 2]
        if here >= 0.0:
            for k in range(6):
                clipped[kept, k] = polygon[i, k]
            kept += 1
        if (here > 0.0 and there < 0.0) or (here < 0.0 and there > 0.0):
            t = here / (here - there)
            for k in range(6):
                clipped[kept, k] = (1.0 - t) * polygon[i, k] + t * polygon[j, k]
            kept += 1
    return kept


@part
def clip_to_polygon(corners, side, plane, edges, polygon, spare):
    """Write the part of a triangle that is ahead of a convex face of a jaw.

    Args:
        corners: Corners of the triangle (3, 3).
        side: +1 or -1, the factor of x.
        plane: The jaw's face is at x = plane[0] + plane[1] y + plane[2] z, relative to the jaw.
        edges: Its sides: edges[..., 0] y + edges[..., 1] z <= edges[..., 2] (e, 3).
        polygon: Written; x is relative to the jaw's face.
        spare: Scratch.

    Returns:
        Number of corners of the part, 0 if nothing remains.
    """
    crossed = 0  # a bit for each side beyond which some corner lies
    for e in range(edges.shape[0]):
        y, z, limit, inside = edges[e, 0], edges[e, 1], edges[e, 2], 0
        for i in range(3):
            if y * corners[i, 1] + z * corners[i, 2] <= limit:
                inside += 1
        if inside == 0:
            return 0
        if inside < 3:
            crossed |= 1 << e
    count, cuts = write_triangle(corners, side, polygon), 0
    for i in range(3):
        polygon[i, 0] -= plane[0] + plane[1] * polygon[i, 1] + plane[2] * polygon[i, 2]
    for e in range(edges.shape[0]):
        if crossed >> e & 1:
            half_plane = (0.0, edges[e, 0], edges[e, 1], edges[e, 2])
            count = clip(polygon, count, half_plane, spare)
            polygon, spare, cuts = spare, polygon, cuts + 1
    if cuts % 2:  # the caller reads from the array that it passed as `polygon`
        for i in range(count):
            for k in range(6):
                spare[i, k] = polygon[i, k]
    return count


@part
def projected_moments(polygon, count, mean):
    """Area of a convex polygon seen along x; write the centroid with respect to that area.

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


@part
def _projected_area(polygon, i):
    """Area of the triangle with the corners 0, i and i + 1, seen along x."""
    ay, az = polygon[i, 1] - polygon[0, 1], polygon[i, 2] - polygon[0, 2]
    by, bz = polygon[i + 1, 1] - polygon[0, 1], polygon[i + 1, 2] - polygon[0, 2]
    return 0.5 * abs(ay * bz - az * by)


@part
def disc_moments(ax, ay, bx, by, radius, totals):
    """Add the area and first moments of the part of a disc in the triangle of its centre, a and b.

    The sum over the edges of a polygon is that of the disc's part in the polygon.

    Args:
        ax: First coordinate of the edge's start, relative to the centre of the disc.
        ay: Second coordinate.
        bx: First coordinate of the edge's end.
        by: Second coordinate.
        radius: Radius of the disc.
        totals: Increased, signed area and its moments about the centre (3,).
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


@part
def crossings(ax, ay, dx, dy, radius):
    """Find where the edge a + t d, 0 <= t <= 1, enters and leaves a disc about the origin.

    Returns:
        (enters, leaves); both are 1 if it does not meet the disc.
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


REGION_CORNERS = 32
"""Most corners of a polygon; each cut adds one, or two through rounding errors."""


@part
def cut(polygon, size, a, b, c):
    """Cut off the part of a polygon where a x + b y + c > 0; return (corners, least value before).

    Args:
        polygon: Corners (2 * REGION_CORNERS, 3).
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
    if size >= REGION_CORNERS - 2:  # no rows are left; an uncut polygon only contains too much
        return size, least
    left = REGION_CORNERS
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
    left -= REGION_CORNERS
    for i in range(left):
        polygon[i, 0], polygon[i, 1] = (
            polygon[REGION_CORNERS + i, 0],
            polygon[REGION_CORNERS + i, 1],
        )
    return left, least


@merged
def centroid(polygon, size):
    """Centroid of a polygon, or the mean of its corners if it has no area."""
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
