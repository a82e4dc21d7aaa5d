"""Convex spherical polygons of contact normals, one per mesh vertex.

A contact on a sharp edge or corner may have any normal between the adjacent faces' normals: an arc
or a convex polygon on the unit sphere.
"""

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from grasp3d._kernels.compiling import kernel, merged

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


@kernel
def _centre(normals, first, count):
    """Middle of the normals: their mean, or the centre of the smallest cap around them."""
    centre = np.zeros(3)
    for i in range(first, first + count):
        centre += normals[i]
    length = math.sqrt(np.dot(centre, centre))
    if length < 1e-9:
        return normals[first].copy()
    centre /= length
    nearest = 1.0
    for i in range(first, first + count):
        nearest = min(nearest, np.dot(centre, normals[i]))
    if nearest > HEMISPHERE:
        return centre
    for step in range(2, 400):  # Badoiu & Clarkson 2003: steps 1/k toward the farthest normal
        far, least = first, 2.0
        for i in range(first, first + count):
            cosine = np.dot(centre, normals[i])
            if cosine < least:
                far, least = i, cosine
        centre += (normals[far] - centre) / step
        centre /= max(math.sqrt(np.dot(centre, centre)), 1e-300)
    return centre


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


@merged
def _copy(source, target):
    """Copy a vector; an assignment of arrays takes Numba far longer to compile."""
    for k in range(3):
        target[k] = source[k]


@kernel
def _tangents(centre):
    """Two unit vectors orthogonal to a unit vector and to each other (`np.cross` in full)."""
    axis, e1, e2 = np.zeros(3), np.empty(3), np.empty(3)
    shortest = 0
    for k in range(1, 3):
        if abs(centre[k]) < abs(centre[shortest]):
            shortest = k
    axis[shortest] = 1.0
    _write_cross(axis, centre, e1)
    length = math.sqrt(np.dot(e1, e1))
    for k in range(3):
        e1[k] /= length
    _write_cross(centre, e1, e2)
    return e1, e2


@merged
def _write_cross(a, b, out):
    """Write the cross product of two vectors."""
    out[0] = a[1] * b[2] - a[2] * b[1]
    out[1] = a[2] * b[0] - a[0] * b[2]
    out[2] = a[0] * b[1] - a[1] * b[0]


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
            _copy(normals[first], centres[v])
            continue
        centre = _centre(normals, first, count)
        _copy(centre, centres[v])
        nearest = 1.0
        for i in range(first, first + count):
            nearest = min(nearest, np.dot(centre, normals[i]))
        # No hemisphere contains the normals (the tip of a needle, a thin plate's rim).
        if nearest < HEMISPHERE:
            counts[v], radii[v] = 0, math.pi
            continue
        radii[v] = math.acos(min(1.0, nearest))
        # Central projection to the plane orthogonal to the centre maps great circles to lines, so
        # the spherical hull becomes a planar one.
        e1, e2 = _tangents(centre)
        plane = np.empty((count, 2))
        for i in range(count):
            normal = normals[first + i]
            height = np.dot(centre, normal)
            plane[i, 0] = np.dot(e1, normal) / height
            plane[i, 1] = np.dot(e2, normal) / height
        corners = _hull(plane)
        chosen = np.empty((corners.shape[0], 3))
        for i in range(corners.shape[0]):
            _copy(normals[first + corners[i]], chosen[i])
        for i in range(corners.shape[0]):
            _copy(chosen[i], normals[first + i])
        counts[v] = corners.shape[0]
