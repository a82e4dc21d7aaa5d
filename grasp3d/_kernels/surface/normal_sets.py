"""Convex spherical polygons of contact normals, one per mesh vertex, and angles to them.

A contact on a sharp edge or corner may have any normal between the adjacent faces' normals: an arc
or a convex polygon on the unit sphere.
"""

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from grasp3d._kernels.compiling.decorators import kernel, part
from grasp3d._kernels.surface.vectors import (
    angle_between,
    combined,
    copy,
    cross,
    divided,
    dot,
    norm,
    triple,
)


@part
def _arc_angle(a, b, d):
    """Smallest angle between a direction and the normals on the arc from a to b."""
    # Axis of the great circle through a and b. The projection of the direction to that circle is on
    # the arc where it lies after a and before b; otherwise an end of the arc is nearest.
    axis = cross(a, b)
    length = norm(axis)
    if length > 1e-15:
        axis = divided(axis, length)
        if dot(d, cross(axis, a)) >= 0.0 and dot(d, cross(b, axis)) >= 0.0:
            height = dot(d, axis)
            return math.atan2(abs(height), norm(combined(1.0, d, -height, axis)))
    return min(angle_between(a, d), angle_between(b, d))


@kernel
def smallest_angle(normals, first, count, x, y, z):
    """Smallest angle between a direction and a set of normals (see `order_normal_sets`)."""
    d = x, y, z
    if count == 1:
        return angle_between(triple(normals[first], 0), d)
    if count == 0:
        return 0.0
    if count == 2:
        return _arc_angle(normals[first], normals[first + 1], d)
    # Inside a convex spherical polygon all its sides are passed on the left.
    inside = True
    least = math.pi
    for i in range(count):
        a, b = normals[first + i], normals[first + (i + 1) % count]
        if dot(cross(a, b), d) < 0.0:
            inside = False
            least = min(least, _arc_angle(a, b, d))
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
    length = norm(centre)
    if length < 1e-9:
        copy(normals[first], centre)
        return _farthest(normals, first, count, centre)[1]
    copy(divided(centre, length), centre)
    _, nearest = _farthest(normals, first, count, centre)
    if nearest > HEMISPHERE:
        return nearest
    for step in range(2, 400):  # Badoiu & Clarkson 2003: steps 1/k toward the farthest normal
        far, _ = _farthest(normals, first, count, centre)
        for k in range(3):
            centre[k] += (normals[far, k] - centre[k]) / step
        copy(divided(centre, max(norm(centre), 1e-300)), centre)
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
    e1 = divided(e1, norm(e1))
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
