"""The faces of a surface: normals of contacts on them, and straight walks from face to face.

A contact on a sharp edge or corner may have any normal between the adjacent faces' normals: an arc
or a convex polygon on the unit sphere.

The module also provides the effect of location errors on the contacts of a grasp, for searches.

The line between two contacts turns, and so do their normals: see `nearby_normals`, whose exact
values are known at the points of a lattice on each face.
"""

import math
from typing import NamedTuple

import numpy as np

from grasp3d._kernels.compiling import (
    FixedFloats1,
    FixedFloats2,
    FixedInts1,
    FixedInts2,
    Ints3,
    kernel,
    merged,
    part,
)
from grasp3d._kernels.surface.vectors import (
    angle_between,
    combined,
    copy,
    cross,
    difference,
    divided,
    dot,
    norm,
    triple,
    weighted_sum,
)
from grasp3d.arrays import locked


class Turns(NamedTuple):
    """Turns of the contacts of a surface for a search, known at the points of a lattice."""

    error: float
    """Sum of the location errors of two contacts, in units of the surface; 0 if exact."""
    vertices: FixedFloats1
    """Turn at each vertex [rad] (V,)."""
    levels: FixedInts1
    """Number of parts of each face's edges (F,)."""
    start: FixedInts1
    """First value of each face (F,)."""
    values: FixedFloats1
    """Turns on faces [rad] (K,): on a face of n parts, for j = 0 to n and i = 0 to n - j, at the
    point whose second and third barycentric coordinates are i / n and j / n."""
    least: FixedFloats1
    """Least turn on each face [rad] (F,)."""


NONE, NOWHERE = locked(np.zeros(0)), locked(np.zeros(0, dtype=np.int64))
EXACT = Turns(0.0, NONE, NOWHERE, NOWHERE, NONE, NONE)
"""Turns without location errors."""


@merged
def lattice_row(i, j, parts):
    """Row of a lattice point among those of its face; see `Turns`."""
    return j * (parts + 1) - j * (j - 1) // 2 + i


@merged
def turn_at_vertex(v, turns):
    """Turn of a contact at a vertex [rad]."""
    return turns.vertices[v] if turns.error > 0.0 else 0.0


@merged
def turn_on_face(face, weights, turns):
    """Turn of a contact on a face [rad], the largest of the three nearest known ones."""
    if not turns.error > 0.0:
        return 0.0
    parts, first = turns.levels[face], turns.start[face]
    x, y = parts * weights[1], parts * weights[2]
    i = min(max(int(x), 0), parts - 1)
    j = min(max(int(y), 0), parts - 1 - i)
    values = turns.values
    one = values[first + lattice_row(i + 1, j, parts)]
    two = values[first + lattice_row(i, j + 1, parts)]
    if x - i + y - j <= 1.0 or i + j + 2 > parts:
        return max(one, two, values[first + lattice_row(i, j, parts)])
    return max(one, two, values[first + lattice_row(i + 1, j + 1, parts)])


@merged
def least_turn(faces, turns):
    """Least turn of contacts on some faces [rad]."""
    if not turns.error > 0.0:
        return 0.0
    least = math.pi
    for i in range(faces.shape[0]):
        least = min(least, turns.least[faces[i]])
    return least


@merged
def line_turn(opening, turns):
    """Angle [rad] by which the line between two contacts may turn as its ends are not exact."""
    return math.asin(min(turns.error / opening, 1.0)) if turns.error > 0.0 else 0.0


@part
def _arc_angle(a, b, d):
    """Smallest angle between a direction and the normals on the arc from a to b."""
    # Axis of the great circle through a and b. The direction projected onto that circle is on the
    # arc if it lies after a and before b; otherwise an end of the arc is nearest.
    axis = cross(a, b)
    length = norm(axis)
    if length > 1e-15:
        axis = divided(axis, length)
        if dot(d, cross(axis, a)) >= 0.0 and dot(d, cross(b, axis)) >= 0.0:
            height = dot(d, axis)
            return math.atan2(abs(height), norm(combined(1.0, d, -height, axis)))
    return min(angle_between(a, d), angle_between(b, d))


@kernel()
def smallest_angle(normals, first, count, x, y, z):
    """Smallest angle between a direction and a set of normals (see `order_normal_sets`)."""
    d = x, y, z
    if count == 1:
        return angle_between(triple(normals[first], 0), d)
    if count == 0:
        return 0.0
    if count == 2:
        return _arc_angle(normals[first], normals[first + 1], d)
    # A point inside a convex spherical polygon has all its sides on the left.
    inside = True
    least = math.pi
    for i in range(count):
        a, b = normals[first + i], normals[first + (i + 1) % count]
        if dot(cross(a, b), d) < 0.0:
            inside = False
            least = min(least, _arc_angle(a, b, d))
    return 0.0 if inside else least


@kernel()
def largest_angle(normals, first, count, x, y, z):
    """Largest angle between a direction and a set of normals."""
    if count == 1:  # bit-identical to smallest_angle
        return smallest_angle(normals, first, count, x, y, z)
    # The farthest normal from a direction is the nearest one to its opposite.
    return math.pi - smallest_angle(normals, first, count, -x, -y, -z)


HEMISPHERE = 0.02
"""Cosine between the centre and a normal below which a set counts as every direction."""

FLAT = 1e-12
"""Cross product below which three points of a polygon count as collinear."""


class ContactNormals(NamedTuple):
    """All normals that a contact at a vertex may have; see `order_normal_sets`."""

    start: FixedInts1
    """First row of each vertex in `normals` (V + 1,)."""
    counts: FixedInts1
    """Number of corners of each polygon of normals (V,)."""
    normals: FixedFloats2
    """Unit normals (K, 3)."""


@part
def _write_centre(normals, first, count, centre):
    """Write the middle of the normals: their mean, or the centre of the smallest cap around them.

    Returns:
        Smallest cosine between the middle and a normal.
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
    """(row, cosine) of the normal with the largest angle to a direction."""
    far, least = first, 2.0
    for i in range(first, first + count):
        cosine = dot(centre, normals[i])
        if cosine < least:
            far, least = i, cosine
    return far, min(least, 1.0)


@kernel()
def _hull(points):
    """Corners of a planar convex hull, counter-clockwise (Andrew's monotone chain)."""
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


@kernel("Ints1, Floats2, Ints1, Floats2, Floats1")
def order_normal_sets(start, normals, counts, centres, radii):
    """Turn each vertex's distinct normals into a convex polygon, in place.

    Args:
        start: First row of each vertex in `normals`, shape (V + 1,).
        normals: Unit normals, reordered with the polygon's corners first (K, 3).
        counts: Written, corners of each polygon (V,): 0 no normal or every direction, 1 where the
            surface is smooth, 2 an arc, more a polygon, counter-clockwise about its centre.
        centres: Written, middle of each set (V, 3).
        radii: Written, largest angle from the centre to a normal [rad], pi if the set spans every
            direction, -1 if there is no normal (V,).
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
        # No hemisphere contains the normals (tip of a needle, rim of a thin plate).
        if nearest < HEMISPHERE:
            counts[v], radii[v] = 0, math.pi
            continue
        radii[v] = math.acos(nearest)
        # Central projection onto the plane orthogonal to the centre maps great circles to lines, so
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


ON_EDGE = 1e-9
"""Barycentric coordinate below which a contact lies on the opposite edge."""

ANY_NORMAL = -2
"""Value of `Surface.twins` at an edge of more than two faces."""


class Surface(NamedTuple):
    """The faces that rays intersect, with vertex normals for interpolation."""

    points: FixedFloats2
    """Positions of the vertices (V, 3)."""
    faces: FixedInts2
    """Vertices of each face (F, 3)."""
    corners: FixedInts2
    """Row of `normals` at each corner of each face (F, 3)."""
    normals: FixedFloats2
    """Unit normals at the corners (C, 3)."""
    twins: Ints3
    """Rows of `normals` across each crease, for the two ends of the edge opposite each corner
    (F, 3, 2); -1 where the edge is smooth or open, ANY_NORMAL where more than two faces meet."""
    turns: Turns
    """Effect of location errors on contacts."""


@merged
def write_normals(face, weights, surface, sets, normals):
    """Write the normals that a contact within a face or on its border may have.

    Args:
        face: The face.
        weights: Barycentric coordinates of the contact, three numbers.
        surface: `Surface`.
        sets: `ContactNormals`.
        normals: Written, up to two normals (2, 3).

    Returns:
        (count, vertex): with vertex -1, count is 1 for one normal, 2 for the ends of an arc, or 0
        for every direction. Otherwise the contact is at that vertex, whose set of normals applies.
    """
    rows, corners, twins = surface.normals, surface.corners[face], surface.twins[face]
    copy(weighted_sum(weights, rows[corners[0]], rows[corners[1]], rows[corners[2]]), normals[0])
    count = 1
    # On an edge or vertex of the face, normals of other faces are possible, too.
    if min(weights[0], weights[1], weights[2]) <= ON_EDGE:
        for i in range(3):
            after, before = weights[(i + 1) % 3], weights[(i + 2) % 3]
            if after <= ON_EDGE and before <= ON_EDGE:
                vertex = surface.faces[face, i]
                if sets.counts[vertex] != 1:
                    return 0, vertex
            if weights[i] <= ON_EDGE and twins[i, 0] == ANY_NORMAL:
                return 0, -1
            if weights[i] <= ON_EDGE and twins[i, 0] >= 0:
                copy(combined(after, rows[twins[i, 0]], before, rows[twins[i, 1]]), normals[1])
                count = 2
    for row in range(count):
        length = norm(normals[row])
        if length > 1e-12:
            copy(divided(normals[row], length), normals[row])
        else:
            copy(rows[corners[0]], normals[row])
    return count, -1


@merged
def point_on_face(face, weights, surface):
    """Position of a point on a face, from its barycentric coordinates."""
    points, corners = surface.points, surface.faces[face]
    return weighted_sum(weights, points[corners[0]], points[corners[1]], points[corners[2]])


@kernel("Ints1, Floats2, Surface, ContactNormals, Ints1, Ints1, Floats3")
def write_normals_of_all(faces, weights, surface, sets, counts, vertices, normals):
    """Write the normals at many contacts; a contact at a vertex has the vertex's set of normals.

    Args:
        faces: Face of each contact (m,).
        weights: Barycentric coordinates on the face (m, 3).
        surface: `Surface`.
        sets: `ContactNormals`.
        counts: Written, number of normals in `normals`, 0 for every direction (m,).
        vertices: Written, vertex whose set of normals applies, or -1 (m,).
        normals: Written, one normal or the ends of an arc (m, 2, 3).
    """
    for i in range(faces.shape[0]):
        face, w = faces[i], weights[i]
        vertices[i] = -1
        for k in range(3):
            if max(w[(k + 1) % 3], w[(k + 2) % 3]) <= ON_EDGE:
                vertices[i] = surface.faces[face, k]
        if vertices[i] >= 0:
            counts[i] = sets.counts[vertices[i]]
        else:
            counts[i], _ = write_normals(face, (w[0], w[1], w[2]), surface, sets, normals[i])


MOST_FACES = 512
"""Most faces that a walk crosses."""

INSIDE = 1e-4
"""Smallest barycentric coordinate at the end of a walk: contacts stay off edges and creases."""

_GOLDEN = np.uint64(0x9E3779B97F4A7C15)
_ONE, _TWO = np.uint64(0xBF58476D1CE4E5B9), np.uint64(0x94D049BB133111EB)
_S11, _S27, _S30, _S31 = np.uint64(11), np.uint64(27), np.uint64(30), np.uint64(31)


@merged
def random_bits(state):
    """Next 64-bit number of a pseudo-random sequence (splitmix64: Steele, Lea & Flood 2014)."""
    state[0] += _GOLDEN
    z = state[0]
    z = (z ^ (z >> _S30)) * _ONE
    z = (z ^ (z >> _S27)) * _TWO
    return z ^ (z >> _S31)


@merged
def random_fraction(state):
    """Next random number, at least 0 and below 1."""
    return np.float64(random_bits(state) >> _S11) * (1.0 / 9007199254740992.0)


@merged
def _edges(face, points, faces):
    """The edges of a face from its first corner to the others."""
    corner = points[faces[face, 0]]
    return difference(points[faces[face, 1]], corner), difference(points[faces[face, 2]], corner)


@part
def walk(face, weights, angle, length, points, faces, adjacent_faces):
    """Walk straight over a surface, with each next face unfolded about the common edge.

    Args:
        face: Face to start from.
        weights: Barycentric coordinates of the start (3,), replaced by those of the end.
        angle: Direction in the plane of the face, from its first edge [rad].
        length: Length of the walk, which ends early at the border of the surface.
        points: Positions of the vertices (V, 3).
        faces: Vertices of each face (F, 3).
        adjacent_faces: Face across the edge opposite each corner, -1 for none or several (F, 3).

    Returns:
        The face where the walk ends.
    """
    u, w = _edges(face, points, faces)
    # The direction from its components along the first edge and across it.
    u = divided(u, norm(u))
    across = combined(1.0, w, -dot(u, w), u)
    direction = combined(math.cos(angle), u, math.sin(angle) / norm(across), across)
    for _ in range(MOST_FACES):
        u, w = _edges(face, points, faces)
        uu, ww, uw = dot(u, u), dot(w, w), dot(u, w)
        du, dw = dot(u, direction), dot(w, direction)
        area = uu * ww - uw * uw
        r1, r2 = (ww * du - uw * dw) / area, (uu * dw - uw * du) / area
        # Rates of the barycentric coordinates along the direction: the first one to reach 0 gives
        # the edge through which the walk leaves the face.
        rates = (-(r1 + r2), r1, r2)
        step, leaving = length, -1
        for i in range(3):
            if rates[i] < 0.0 and weights[i] < -rates[i] * step:
                step, leaving = weights[i] / -rates[i], i
        for i in range(3):
            weights[i] += step * rates[i]
        length -= step
        if leaving < 0 or adjacent_faces[face, leaving] < 0:
            break
        # The direction's component along the edge stays; the rest turns into the next face.
        other = adjacent_faces[face, leaving]
        p, q = faces[face, (leaving + 1) % 3], faces[face, (leaving + 2) % 3]
        wp, wq = max(weights[(leaving + 1) % 3], 0.0), max(weights[(leaving + 2) % 3], 0.0)
        total = max(wp + wq, 1e-300)
        opposite = 0
        for i in range(3):
            weights[i] = 0.0
            if faces[other, i] == p:
                weights[i] = wp / total
            elif faces[other, i] == q:
                weights[i] = wq / total
            else:
                opposite = i
        edge = difference(points[q], points[p])
        edge = divided(edge, norm(edge))
        along = dot(direction, edge)
        away = difference(points[faces[other, opposite]], points[p])
        across = combined(1.0, away, -dot(away, edge), edge)
        side = math.sqrt(max(0.0, 1.0 - along * along)) / norm(across)
        direction = combined(along, edge, side, across)
        face = other
    # Stay away from the edges, where a contact would have two normals.
    total = 0.0
    for i in range(3):
        weights[i] = max(weights[i], INSIDE)
        total += weights[i]
    for i in range(3):
        weights[i] /= total
    return face
