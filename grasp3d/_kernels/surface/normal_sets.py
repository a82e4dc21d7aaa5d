"""Convex spherical polygons of contact normals, one per mesh vertex, and angles to them.

A contact on a sharp edge or corner may have any normal between the adjacent faces' normals: an arc
or a convex polygon on the unit sphere.
"""

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from grasp3d._kernels.compiling.decorators import kernel, part
from grasp3d._kernels.surface.vectors import angle_between, copy, cross, dot


@part
def _arc_angle(a, b, x, y, z):
    """Smallest angle between a direction and the normals on the arc from a to b."""
    wx, wy, wz = a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]
    # w: axis of the great circle through a and b. The projection of the direction to that circle is
    # on the arc where it lies after a and before b; otherwise an end of the arc is nearest.
    length = math.sqrt(wx * wx + wy * wy + wz * wz)
    if length > 1e-15:
        wx, wy, wz = wx / length, wy / length, wz / length
        after = x * (wy * a[2] - wz * a[1]) + y * (wz * a[0] - wx * a[2])
        after += z * (wx * a[1] - wy * a[0])
        before = x * (b[1] * wz - b[2] * wy) + y * (b[2] * wx - b[0] * wz)
        before += z * (b[0] * wy - b[1] * wx)
        if after >= 0.0 and before >= 0.0:
            height = x * wx + y * wy + z * wz
            px, py, pz = x - height * wx, y - height * wy, z - height * wz
            return math.atan2(abs(height), math.sqrt(px * px + py * py + pz * pz))
    return min(angle_between(a, (x, y, z)), angle_between(b, (x, y, z)))


@kernel
def smallest_angle(normals, first, count, x, y, z):
    """Smallest angle between a direction and a set of normals (see `order_normal_sets`)."""
    if count == 1:
        one = normals[first, 0], normals[first, 1], normals[first, 2]
        return angle_between(one, (x, y, z))
    if count == 0:
        return 0.0
    if count == 2:
        return _arc_angle(normals[first], normals[first + 1], x, y, z)
    # Inside a convex spherical polygon all its sides are passed on the left.
    inside = True
    least = math.pi
    for i in range(count):
        a, b = normals[first + i], normals[first + (i + 1) % count]
        side = (a[1] * b[2] - a[2] * b[1]) * x + (a[2] * b[0] - a[0] * b[2]) * y
        side += (a[0] * b[1] - a[1] * b[0]) * z
        if side < 0.0:
            inside = False
            least = min(least, _arc_angle(a, b, x, y, z))
    return 0.0 if inside else least


@kernel
def largest_angle(normals, first, count, x, y, z):
    """Largest angle between a direction and a set of normals."""
    if count == 1:  # bit-identical to smallest_angle
        return smallest_angle(normals, first, count, x, y, z)
    # The farthest normal from a direction is the nearest one to its opposite.
    return math.pi - smallest_angle(normals, first, count, -x, -y, -z)


HEMISPHERE = 0.02
"""Cosine between the centre and a normal below which a set counts as all directions."""

FLAT = 1e-12
"""Cross product below which three points of a polygon count as collinear."""


class ContactNormals(NamedTuple):
    """All normals that a contact at a vertex may have; see `order_normal_sets`."""

    start: npt.NDArray[np.int64]
    """First row of each vertex in `normals` (V + 1,)."""
    counts: npt.NDArray[np.int64]
    """Corners of each polygon of normals (V,)."""
    normals: npt.NDArray[np.float64]
    """Unit normals (K, 3)."""


@part
def _write_centre(normals, first, count, centre):
    """Write the middle of the normals: their mean, or the centre of the smallest cap around them.

    Returns:
        Smallest cosine between it and a normal.
    """
    for k in range(3):
        centre[k] = 0.0
        for i in range(first, first + count):
            centre[k] += normals[i, k]
    length = math.sqrt(dot(centre, centre))
    if length < 1e-9:
        copy(normals[first], centre)
        return _farthest(normals, first, count, centre)[1]
    for k in range(3):
        centre[k] /= length
    _, nearest = _farthest(normals, first, count, centre)
    if nearest > HEMISPHERE:
        return nearest
    for step in range(2, 400):  # Badoiu & Clarkson 2003: steps 1/k toward the farthest normal
        far, _ = _farthest(normals, first, count, centre)
        for k in range(3):
            centre[k] += (normals[far, k] - centre[k]) / step
        length = max(math.sqrt(dot(centre, centre)), 1e-300)
        for k in range(3):
            centre[k] /= length
    return _farthest(normals, first, count, centre)[1]


@part
def _farthest(normals, first, count, centre):
    """(row, cosine) of the normal with the largest angle from a direction."""
    far, least = first, 2.0
    for i in range(first, first + count):
        cosine = dot(centre, normals[i])
        if cosine < least:
            far, least = i, cosine
    return far, min(least, 1.0)


@kernel
def _hull(points):
    """Corners of the planar convex hull, counter-clockwise (Andrew's monotone chain)."""
    count = points.shape[0]
    order = np.arange(count)  # Shell sort by x, then y: most counts are small, a few are large
    gap = 1
    while 9 * gap < count:
        gap = 9 * gap // 4 + 1
    while gap > 0:
        for i in range(gap, count):
            j = i
            while j >= gap:
                a, b = order[j - gap], order[j]
                if points[a, 0] < points[b, 0] or (
                    points[a, 0] == points[b, 0] and points[a, 1] <= points[b, 1]
                ):
                    break
                order[j - gap], order[j] = b, a
                j -= gap
        gap = 4 * gap // 9
    chain = np.empty(2 * count, dtype=np.int64)
    size = 0
    for turn in range(2):  # lower chain, then upper chain
        base = size
        for step in range(count):
            new = order[step] if turn == 0 else order[count - 1 - step]
            while size - base >= 2:
                a, b = chain[size - 2], chain[size - 1]
                cross = (points[b, 0] - points[a, 0]) * (points[new, 1] - points[a, 1]) - (
                    points[b, 1] - points[a, 1]
                ) * (points[new, 0] - points[a, 0])
                if cross > FLAT:
                    break
                size -= 1
            chain[size] = new
            size += 1
        size -= 1
    return chain[: max(size, 1)]


@part
def _tangents(centre):
    """Two unit vectors orthogonal to a unit vector and to each other."""
    x, y, z = centre[0], centre[1], centre[2]
    if abs(x) <= min(abs(y), abs(z)):
        e1 = 0.0, -z, y
    elif abs(y) <= abs(z):
        e1 = z, 0.0, -x
    else:
        e1 = -y, x, 0.0
    length = math.sqrt(dot(e1, e1))
    e1 = e1[0] / length, e1[1] / length, e1[2] / length
    return e1, cross(centre, e1)


@kernel
def order_normal_sets(start, normals, counts, centres, radii):
    """Turn each vertex's distinct normals into a convex polygon, in place.

    Args:
        start: First row of each vertex in `normals`, shape (V + 1,).
        normals: Unit normals (K, 3); reordered, the polygon's corners first.
        counts: Written, corners of each polygon (V,): 0 no normal or every direction, 1 where the
            surface is smooth, 2 an arc, more a polygon, counter-clockwise about its centre.
        centres: Written, middle of each set (V, 3).
        radii: Written, largest angle from the centre to a normal [rad] (V,); pi where the set
            spans every direction; -1 where there is no normal at all.
    """
    for v in range(start.shape[0] - 1):
        first, count = start[v], start[v + 1] - start[v]
        if count == 0:
            counts[v], radii[v] = 0, -1.0
            continue
        if count == 1:
            counts[v], radii[v] = 1, 0.0
            copy(normals[first], centres[v])
            continue
        centre = centres[v]
        nearest = _write_centre(normals, first, count, centre)
        # No hemisphere contains the normals (the tip of a needle, a thin plate's rim).
        if nearest < HEMISPHERE:
            counts[v], radii[v] = 0, math.pi
            continue
        radii[v] = math.acos(nearest)
        # Central projection to the plane orthogonal to the centre maps great circles to lines, so
        # the spherical hull becomes a planar one.
        e1, e2 = _tangents(centre)
        plane = np.empty((count, 2))
        for i in range(count):
            normal = normals[first + i]
            height = dot(centre, normal)
            plane[i, 0] = dot(e1, normal) / height
            plane[i, 1] = dot(e2, normal) / height
        corners = _hull(plane)
        chosen = np.empty((corners.shape[0], 3))
        for i in range(corners.shape[0]):
            copy(normals[first + corners[i]], chosen[i])
        for i in range(corners.shape[0]):
            copy(chosen[i], normals[first + i])
        counts[v] = corners.shape[0]
