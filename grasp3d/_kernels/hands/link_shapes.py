"""Convex shapes of links: signed distance of a point, and distance from a triangle.

A shape is a core over which a ball moves. The core is a box, a cylinder or a convex hull (ball of
radius 0), a segment along z (capsule) or a point (sphere). All is in the frame of the shape.
"""

import math
from typing import NamedTuple

import numpy as np

from grasp3d._kernels.compiling import Floats1, Floats2, Floats3, Ints1, merged, part
from grasp3d._kernels.surface.vectors import (
    combined,
    copy,
    cross,
    difference,
    divided,
    dot,
    norm,
    squared_distance,
    triple,
)

BOX, CYLINDER, CAPSULE, SPHERE, HULL = 0, 1, 2, 3, 4
"""Kinds of shapes. Sizes: half lengths; radius, half length (cylinder, capsule); radius; none."""

ROUNDS = 64
"""Most iterations of a distance: a curved core takes about 20, others fewer than 10."""

EXACT = 1e-12
"""Relative gap between the bounds of a squared distance at which the search ends."""

TOUCHING = 1e-9
"""Distance of a core from a triangle below which they count as overlapping [m]."""

NEAR = 1e-6
"""Distance below which the way out of the shape gives the direction [m]."""

EVEN = 1e-9
"""Depth, or difference of depths, that does not matter [m]."""

COARSE = 256
"""Number of planes that approximate a hull to estimate depths in it."""

CUTS = 64
"""Most points of a triangle that are tried to find its deepest one; few take more than 10."""

CORE, FACE, CORNERS = 0, 4, 8
"""First rows in `ShapeScratch.simplex` of points of the core, of the triangle, and differences."""


class Hulls(NamedTuple):
    """Vertices of convex hulls, and the edges between them."""

    vertices: Floats2
    """(v, 3)."""
    first: Ints1
    """First row of each vertex in `neighbours` (v + 1,)."""
    neighbours: Ints1
    """Vertices at the other ends of each vertex's edges."""
    at: Ints1
    """First vertex of each shape's hull (m,)."""


class LinkShapes(NamedTuple):
    """Shapes of all links in metres, grouped by link."""

    kinds: Ints1
    """BOX, CYLINDER, ... (m,)."""
    links: Ints1
    """Link of each shape, ascending (m,)."""
    poses: Floats3
    """Transform from the frame of the shape to that of its link (m, 3, 4)."""
    sizes: Floats2
    """Sizes as for the kinds above (m, 3)."""
    boxes: Floats2
    """Centre and half lengths of the bounding box, and radius of the bounding ball (m, 7)."""
    hull: "Hulls"
    first_plane: Ints1
    """First row of each hull in `planes` (m + 1,)."""
    planes: Floats2
    """Outward unit normals, and the largest product of each with a point of the hull (f, 4): of all
    faces, after `COARSE` representative ones where there are more faces than that."""
    first_sample: Ints1
    """First row of each shape in `samples` (m + 1,)."""
    samples: Floats2
    """Surface points, corners and edges included, with outward unit normals (s, 6)."""


class ShapeScratch(NamedTuple):
    """Arrays of one distance."""

    simplex: Floats2
    """Support points: of the core, of the triangle, and their differences (12, 3)."""
    weights: Floats1
    """Weights of the support points (4,), and copies for the nearest points (4,)."""
    guess: Floats1
    """Vector from the triangle to the shape: a first guess, replaced by the one found (3,)."""
    on_core: Floats1
    """Nearest point of the core (3,)."""
    on_face: Floats1
    """Nearest point of the triangle (3,)."""
    at: Ints1
    """Vertex of the hull from which the search for its farthest one starts (1,)."""
    polygon: Floats3
    """Corners of what remains of a triangle after a cut, and before it (2, CUTS + 3, 3)."""
    point: Floats1
    """A triangle collapsed to a point (9,)."""


@merged
def radius_of(kind, size):
    """Radius of the ball that moves over a core."""
    return size[0] if kind in (CAPSULE, SPHERE) else 0.0


@merged
def box_distance(p, box):
    """Signed distance of a point from the box around a shape, negative inside."""
    x = abs(p[0] - box[0]) - box[3]
    y = abs(p[1] - box[1]) - box[4]
    z = abs(p[2] - box[2]) - box[5]
    inside = min(max(x, y, z), 0.0)
    x, y, z = max(x, 0.0), max(y, 0.0), max(z, 0.0)
    return math.sqrt(x * x + y * y + z * z) + inside


@part
def point_depth(p, kind, size, box, planes):
    """Signed distance of a point from a shape; for a point outside a hull, a lower bound."""
    if kind == BOX:
        return box_distance(p, box)
    if kind == HULL:
        largest = -math.inf
        for i in range(planes.shape[0]):
            largest = max(largest, dot(planes[i], p) - planes[i, 3])
        return largest
    if kind == SPHERE:
        return norm(p) - size[0]
    beyond = abs(p[2]) - size[1]
    across = math.sqrt(p[0] * p[0] + p[1] * p[1])
    if kind == CAPSULE:
        beyond = max(beyond, 0.0)
        return math.sqrt(across * across + beyond * beyond) - size[0]
    across -= size[0]
    outside = math.sqrt(max(across, 0.0) ** 2 + max(beyond, 0.0) ** 2)
    return outside + min(max(across, beyond), 0.0)


@part
def _farthest_vertex(hull, at, x, y, z):
    """Find the vertex of a hull farthest along a direction by climbing along edges."""
    vertices, best, last = hull.vertices, at[0], -1
    farthest = vertices[best, 0] * x + vertices[best, 1] * y + vertices[best, 2] * z
    while best != last:
        last = best
        for i in range(hull.first[last], hull.first[last + 1]):
            v = hull.neighbours[i]
            height = vertices[v, 0] * x + vertices[v, 1] * y + vertices[v, 2] * z
            if height > farthest:
                best, farthest = v, height
    at[0] = best
    return triple(vertices[best], 0)


@part
def support(kind, size, box, hull, at, shrink, x, y, z):
    """Point of a shrunk core that lies farthest along a direction."""
    cx, cy, cz = box[0], box[1], box[2]
    if kind == BOX:
        px = cx + shrink * (box[3] if x >= 0.0 else -box[3])
        py = cy + shrink * (box[4] if y >= 0.0 else -box[4])
        pz = cz + shrink * (box[5] if z >= 0.0 else -box[5])
        return px, py, pz
    if kind == HULL:
        p = _farthest_vertex(hull, at, x, y, z)
        return cx + shrink * (p[0] - cx), cy + shrink * (p[1] - cy), cz + shrink * (p[2] - cz)
    if kind == SPHERE:
        return 0.0, 0.0, 0.0
    pz = shrink * (size[1] if z >= 0.0 else -size[1])
    if kind == CAPSULE:
        return 0.0, 0.0, pz
    across = math.sqrt(x * x + y * y)
    if across < 1e-300:
        return 0.0, 0.0, pz
    return shrink * size[0] * x / across, shrink * size[0] * y / across, pz


@part
def nearest_in_shape(p, kind, size, box, hull, scratch):
    """Point of a shape nearest to a given point, which may be inside."""
    if kind == BOX:
        x, y, z = box[3], box[4], box[5]
        return min(max(p[0], -x), x), min(max(p[1], -y), y), min(max(p[2], -z), z)
    if kind == HULL:
        for c in range(3):
            copy(p, scratch.point[3 * c :])
        copy(difference(box, p), scratch.guess)
        distance = core_distance(kind, size, box, hull, 1.0, scratch.point, math.inf, scratch)
        q = triple(scratch.on_core, 0)
        return q if distance > 0.0 else (p[0], p[1], p[2])
    z = 0.0 if kind == SPHERE else min(max(p[2], -size[1]), size[1])
    rest = 0.0 if kind == CYLINDER else p[2] - z
    away = math.sqrt(p[0] * p[0] + p[1] * p[1] + rest * rest)
    share = size[0] / away if away > size[0] else 1.0
    return share * p[0], share * p[1], z + share * rest


@part
def _nearest_on_edge(corners, i, j, weights):
    """Squared distance of the origin from an edge of a simplex; writes the weights."""
    a, b = corners[i], corners[j]
    u = difference(b, a)
    uu = dot(u, u)
    t = min(max(-dot(a, u) / uu, 0.0), 1.0) if uu > 0.0 else 0.0
    weights[i], weights[j] = 1.0 - t, t
    p = combined(1.0 - t, a, t, b)
    return dot(p, p)


@part
def _nearest_on_face(corners, i, j, k, weights):
    """Squared distance of the origin from a face of a simplex; writes the weights."""
    a = triple(corners[i], 0)
    u, w = difference(corners[j], a), difference(corners[k], a)
    n = cross(u, w)
    nn = dot(n, n)
    if nn > 0.0:
        # Barycentric coordinates of the projection of the origin.
        s = -dot(cross(a, w), n) / nn
        t = -dot(cross(u, a), n) / nn
        if s >= 0.0 and t >= 0.0 and s + t <= 1.0:
            weights[i], weights[j], weights[k] = 1.0 - s - t, s, t
            height = dot(a, n)
            return height * height / nn
    least, best = math.inf, 0
    for edge in range(3):
        one, other = (i, j) if edge == 0 else ((i, k) if edge == 1 else (j, k))
        square = _nearest_on_edge(corners, one, other, weights)
        if square < least:
            least, best = square, edge
    one, other = (i, j) if best == 0 else ((i, k) if best == 1 else (j, k))
    weights[i], weights[j], weights[k] = 0.0, 0.0, 0.0
    return _nearest_on_edge(corners, one, other, weights)


@part
def _nearest_on_simplex(count, corners, weights):
    """Squared distance of the origin from a simplex, 0 if inside; writes the weights."""
    if count == 1:
        weights[0] = 1.0
        return dot(corners[0], corners[0])
    if count == 2:
        return _nearest_on_edge(corners, 0, 1, weights)
    if count == 3:
        return _nearest_on_face(corners, 0, 1, 2, weights)
    least, best = math.inf, -1
    for left in range(4):
        i, j, k = (1 if left == 0 else 0), (2 if left <= 1 else 1), (3 if left <= 2 else 2)
        a = triple(corners[i], 0)
        n = cross(difference(corners[j], a), difference(corners[k], a))
        origin, other = -dot(n, a), dot(n, difference(corners[left], a))
        size = norm(n) * norm(difference(corners[left], a))
        if origin * other > 0.0 and abs(other) > 1e-12 * size:
            continue
        square = _nearest_on_face(corners, i, j, k, weights)
        if square < least:
            least, best = square, left
    if best < 0:
        return 0.0
    i, j, k = (1 if best == 0 else 0), (2 if best <= 1 else 1), (3 if best <= 2 else 2)
    weights[best] = 0.0
    return _nearest_on_face(corners, i, j, k, weights)


@part
def core_distance(kind, size, box, hull, shrink, triangle, limit, scratch):
    """Distance of the core of a shape from a triangle (Gilbert, Johnson & Keerthi 1988).

    Args:
        kind: Kind of the shape.
        size: Sizes of the shape (3,).
        box: Box around the shape (7,).
        hull: `Hulls`.
        shrink: Factor by which the core is shrunk about the centre of its box.
        triangle: Nine numbers.
        limit: Distance beyond which the exact one does not matter. If the core is shrunk, the limit
            applies to the full shape; a negative limit requires that to overlap by that much.
        scratch: `ShapeScratch`. Where the distance is within the limit, the nearest points and the
            vector between them are written.

    Returns:
        The distance; inf if it is beyond the limit, 0 if they overlap.
    """
    simplex, weights, guess = scratch.simplex, scratch.weights, scratch.guess
    corners = simplex[CORNERS:]
    x, y, z = triple(guess, 0)
    if not x * x + y * y + z * z > 0.0:
        x = 1.0
    count, square = 0, math.inf
    for _ in range(ROUNDS):
        a = support(kind, size, box, hull, scratch.at, shrink, -x, -y, -z)
        best, farthest = 0, -math.inf
        for i in range(3):
            height = triangle[3 * i] * x + triangle[3 * i + 1] * y + triangle[3 * i + 2] * z
            if height > farthest:
                best, farthest = i, height
        b = triple(triangle, 3 * best)
        w = difference(a, b)
        along, length = x * w[0] + y * w[1] + z * w[2], x * x + y * y + z * z
        outer = along
        if shrink < 1.0:
            outer += (1.0 / shrink - 1.0) * dot((x, y, z), difference(a, box))
        if outer > limit * math.sqrt(length):
            copy((x, y, z), guess)
            return math.inf
        if count > 0:
            if square - along <= EXACT * square:
                break
            known = False
            for i in range(count):
                c = corners[i]
                known = known or (c[0] == w[0] and c[1] == w[1] and c[2] == w[2])
            if known:
                break
        copy(a, simplex[CORE + count])
        copy(b, simplex[FACE + count])
        copy(w, corners[count])
        nearer = _nearest_on_simplex(count + 1, corners, weights)
        if not nearer < square:  # limit of floating-point precision
            break
        square, kept = nearer, 0
        for i in range(count + 1):
            if weights[i] > 0.0:
                weights[kept] = weights[i]
                for row in (CORE, FACE, CORNERS):
                    copy(simplex[row + i], simplex[row + kept])
                kept += 1
        count = kept
        if square <= TOUCHING * TOUCHING:
            return 0.0
        x, y, z = 0.0, 0.0, 0.0
        for i in range(count):
            x += weights[i] * corners[i, 0]
            y += weights[i] * corners[i, 1]
            z += weights[i] * corners[i, 2]
        # Keep this simplex's weights for the nearest points: a worse one may overwrite them.
        for i in range(4):
            weights[4 + i] = weights[i] if i < count else 0.0
    for k in range(3):
        scratch.on_core[k], scratch.on_face[k] = 0.0, 0.0
        for i in range(count):
            scratch.on_core[k] += weights[4 + i] * simplex[CORE + i, k]
            scratch.on_face[k] += weights[4 + i] * simplex[FACE + i, k]
    distance = math.sqrt(x * x + y * y + z * z)
    copy((x, y, z), guess)
    return distance


@part
def shape_distance(kind, size, box, hull, planes, triangle, limit, scratch):
    """Signed distance of a shape from a triangle; if negative, the triangle's depth in the shape.

    Args:
        kind: Kind of the shape.
        size: Sizes of the shape (3,).
        box: Box around the shape (7,).
        hull: `Hulls`.
        planes: Planes of the shape's hull (f, 4).
        triangle: Nine numbers.
        limit: Signed distance beyond which the exact one does not matter.
        scratch: `ShapeScratch`.

    Returns:
        The distance; inf if it is beyond the limit. Written to the scratch: `on_face`, the point of
        the triangle, and `guess`, the unit vector from it to the shape or for the way out.
    """
    radius = radius_of(kind, size)
    if radius > 0.0:
        reach, distance = limit + radius, math.inf
        if reach > 0.0:
            distance = core_distance(kind, size, box, hull, 1.0, triangle, reach, scratch)
        if distance == math.inf:
            return distance
        if distance == 0.0:
            _across(triangle, scratch)
        else:
            copy(divided(scratch.guess, distance), scratch.guess)
        return distance - radius
    third = 1.0 / 3.0
    centroid = combined(third, triangle, third, triple(triangle, 3))
    centroid = combined(1.0, centroid, third, triple(triangle, 6))
    around = 0.0
    for i in range(3):
        around = max(around, squared_distance(centroid, triple(triangle, 3 * i)))
    if box_distance(centroid, box) - math.sqrt(around) >= limit:
        return math.inf
    distance = 0.0
    if limit > 0.0:
        distance = core_distance(kind, size, box, hull, 1.0, triangle, limit, scratch)
        if distance > NEAR:
            if distance < math.inf:
                copy(divided(scratch.guess, distance), scratch.guess)
            return distance
    return _deepest_of_face(kind, size, box, planes, triangle, min(limit, NEAR), scratch)


@part
def _way_out(p, kind, size, box, planes):
    """Depth of a point in a box, a cylinder or a hull, and the unit vector of the way out.

    Outside, the depth is minus the distance from the plane that is farthest away.
    """
    if kind == HULL:
        most, best = -math.inf, 0
        for i in range(planes.shape[0]):
            height = dot(planes[i], p) - planes[i, 3]
            if height > most:
                best, most = i, height
        return -most, triple(planes[best], 0)
    z = math.copysign(1.0, p[2])
    if kind == BOX:
        x, y = math.copysign(1.0, p[0]), math.copysign(1.0, p[1])
        one, two, three = box[3] - abs(p[0]), box[4] - abs(p[1]), box[5] - abs(p[2])
        if one <= min(two, three):
            return one, (x, 0.0, 0.0)
        return (two, (0.0, y, 0.0)) if two <= three else (three, (0.0, 0.0, z))
    across, end = math.sqrt(p[0] * p[0] + p[1] * p[1]), size[1] - abs(p[2])
    if size[0] - across >= end or across == 0.0:
        return end, (0.0, 0.0, z)
    return size[0] - across, (p[0] / across, p[1] / across, 0.0)


@part
def _deepest_of_face(kind, size, box, planes, triangle, limit, scratch):
    """Signed distance of the point of a triangle that is deepest in a box, a cylinder or a hull.

    Depth is concave inside the shape: from each point tried, a cut keeps the part of the triangle
    where deeper points may be.

    Returns:
        The distance; inf if it is not below the limit. Written to the scratch: the point `on_face`
        and the unit vector `guess` along which the shape has to move.
    """
    polygon, count, best, found = scratch.polygon, 3, -limit, False
    now, rough, top = 0, kind == HULL and planes.shape[0] > COARSE, 0
    for i in range(3):
        copy(triple(triangle, 3 * i), polygon[0, i])
    for turn in range(CUTS):
        x, y, z = 0.0, 0.0, 0.0
        if turn % 2 == 0:
            for i in range(count):
                x, y, z = x + polygon[now, i, 0], y + polygon[now, i, 1], z + polygon[now, i, 2]
            p = x / count, y / count, z / count
        else:
            p = triple(polygon[now, top], 0)
        depth, n = _way_out(p, kind, size, box, planes[:COARSE])
        if depth > best and rough:
            depth, n = _way_out(p, kind, size, box, planes)
        if depth > best:
            best, found = depth, True
            copy(p, scratch.on_face)
            copy((-n[0], -n[1], -n[2]), scratch.guess)
        # The part that may be deeper, according to this plane.
        other, left, highest, level = 1 - now, 0, -math.inf, dot(n, p) + depth - best - EVEN
        for i in range(count):
            a = triple(polygon[now, i], 0)
            b = triple(polygon[now, (i + 1) % count], 0)
            here, there = level - dot(n, a), level - dot(n, b)
            if here > 0.0:
                copy(a, polygon[other, left])
                if here > highest:
                    highest, top = here, left
                left += 1
            if here * there < 0.0:
                share = here / (here - there)
                copy(combined(1.0 - share, a, share, b), polygon[other, left])
                left += 1
        if left == 0:
            break
        now, count = other, left
    return -best if found else math.inf


@merged
def _across(triangle, scratch):
    """Write the unit normal of a triangle as the direction in which a shape moves away."""
    a = triple(triangle, 0)
    n = cross(difference(triple(triangle, 3), a), difference(triple(triangle, 6), a))
    length = norm(n)
    copy(divided(n, length) if length > 0.0 else (0.0, 0.0, 1.0), scratch.guess)


def make_shape_scratch() -> ShapeScratch:
    """Allocate the arrays of one distance."""
    one, two, three = np.zeros((3, 3))
    return ShapeScratch(
        np.zeros((12, 3)), np.zeros(8), one, two, three, np.zeros(1, np.int64),
        np.zeros((2, CUTS + 3, 3)), np.zeros(9),
    )  # fmt: skip
