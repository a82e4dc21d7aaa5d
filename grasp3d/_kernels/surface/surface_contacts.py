"""The faces of a surface: normals of contacts on them, and straight walks from face to face."""

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from grasp3d._kernels.compiling.decorators import kernel, merged, part
from grasp3d._kernels.surface.vectors import (
    combined,
    copy,
    difference,
    divided,
    dot,
    norm,
    weighted_sum,
)

ON_EDGE = 1e-9
"""Barycentric coordinate below which a contact lies on the opposite edge."""

ANY_NORMAL = -2
"""Value of `Surface.twins` on an edge of more than two faces."""


class Surface(NamedTuple):
    """The faces that rays intersect, with vertex normals for interpolation."""

    points: npt.NDArray[np.float64]
    """Positions of the vertices (V, 3)."""
    faces: npt.NDArray[np.int64]
    """Vertices of each face (F, 3)."""
    corners: npt.NDArray[np.int64]
    """Row of `normals` at each corner of each face (F, 3)."""
    normals: npt.NDArray[np.float64]
    """Unit normals at the corners (C, 3)."""
    twins: npt.NDArray[np.int64]
    """Rows of `normals` across each crease, for the two ends of the edge opposite each corner
    (F, 3, 2); -1 where the edge is smooth or open, ANY_NORMAL where more than two faces meet."""


@merged
def write_normals(face, weights, surface, sets, normals):
    """Write the normals that a contact inside or on the border of a face may have.

    Args:
        face: The face.
        weights: Barycentric coordinates of the contact, three numbers.
        surface: `Surface`.
        sets: `ContactNormals`.
        normals: Written, up to two normals (2, 3).

    Returns:
        (count, vertex): 1 normal or the 2 ends of an arc in `normals`, or 0 for every direction,
        with vertex -1; or the vertex whose set of normals applies, where the contact is that
        vertex.
    """
    rows, corners, twins = surface.normals, surface.corners[face], surface.twins[face]
    copy(weighted_sum(weights, rows[corners[0]], rows[corners[1]], rows[corners[2]]), normals[0])
    count = 1
    # On an edge or vertex of the face other faces' normals are possible too.
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


@kernel
def write_normals_of_all(faces, weights, surface, sets, counts, vertices, normals):
    """Write the normals at many contacts; a contact at a vertex has the vertex's set of normals.

    Args:
        faces: Face of each contact (m,).
        weights: Barycentric coordinates on the face (m, 3).
        surface: `Surface`.
        sets: `ContactNormals`.
        counts: Written, normals in `normals`, 0 for every direction (m,).
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
    """Walk straight over a surface: each next face is unfolded about the common edge.

    Args:
        face: Face to start from.
        weights: Barycentric coordinates of the start (3,); written, those of the end.
        angle: Direction in the plane of the face, from its first edge [rad].
        length: Length of the walk, which ends early at the border of the surface.
        points: Positions of the vertices (V, 3).
        faces: Vertices of each face (F, 3).
        adjacent_faces: Face across the edge opposite each corner (F, 3); -1: none, or several.

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
        # Rates of the barycentric coordinates along the direction: the first to reach 0 decides
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
    # Away from the edges, where a contact would have two normals.
    total = 0.0
    for i in range(3):
        weights[i] = max(weights[i], INSIDE)
        total += weights[i]
    for i in range(3):
        weights[i] /= total
    return face
