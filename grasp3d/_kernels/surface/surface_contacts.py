"""The faces of a surface, and the normals that a contact on a face may have."""

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from grasp3d._kernels.compiling.decorators import kernel, merged

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
def write_normals(face, weights, surface, sets, found):
    """Write the normals that a contact inside or on the border of a face may have.

    Args:
        face: The face.
        weights: Barycentric coordinates of the contact, three numbers.
        surface: `Surface`.
        sets: `ContactNormals`.
        found: Written, up to two normals (2, 3).

    Returns:
        (count, vertex): 1 normal or the 2 ends of an arc in `found`, or 0 for every direction, with
        vertex -1; or the vertex whose set of normals applies, where the contact is that vertex.
    """
    normals, corners, twins = surface.normals, surface.corners, surface.twins
    b0, b1, b2 = weights
    c0, c1, c2 = corners[face, 0], corners[face, 1], corners[face, 2]
    for k in range(3):
        found[0, k] = b0 * normals[c0, k] + b1 * normals[c1, k] + b2 * normals[c2, k]
    count = 1
    # On an edge or vertex of the face other faces' normals are possible too.
    if min(b0, b1, b2) <= ON_EDGE:
        for i in range(3):
            after, before = weights[(i + 1) % 3], weights[(i + 2) % 3]
            if after <= ON_EDGE and before <= ON_EDGE:
                vertex = surface.faces[face, i]
                if sets.counts[vertex] != 1:
                    return 0, vertex
            if weights[i] <= ON_EDGE and twins[face, i, 0] == ANY_NORMAL:
                return 0, -1
            if weights[i] <= ON_EDGE and twins[face, i, 0] >= 0:
                for k in range(3):
                    found[1, k] = after * normals[twins[face, i, 0], k]
                    found[1, k] += before * normals[twins[face, i, 1], k]
                count = 2
    for row in range(count):
        x, y, z = found[row, 0], found[row, 1], found[row, 2]
        length = math.sqrt(x * x + y * y + z * z)
        if length > 1e-12:
            found[row, 0], found[row, 1], found[row, 2] = x / length, y / length, z / length
        else:
            for k in range(3):
                found[row, k] = normals[c0, k]
    return count, -1


@kernel
def write_normals_of_all(faces, weights, surface, sets, counts, vertices, found):
    """Write the normals at many contacts; a contact at a vertex has the vertex's set of normals.

    Args:
        faces: Face of each contact (m,).
        weights: Barycentric coordinates on the face (m, 3).
        surface: `Surface`.
        sets: `ContactNormals`.
        counts: Written, normals in `found`, 0 for every direction (m,).
        vertices: Written, vertex whose set of normals applies, or -1 (m,).
        found: Written, one normal or the ends of an arc (m, 2, 3).
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
            counts[i], _ = write_normals(face, (w[0], w[1], w[2]), surface, sets, found[i])
