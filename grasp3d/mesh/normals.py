"""Contact normals: interpolated where smooth, one set per side at creases."""

from dataclasses import dataclass

import numpy as np

from grasp3d._kernels.surface.surface_contacts import ANY_NORMAL, ContactNormals, order_normal_sets
from grasp3d.arrays import Bools, Floats, Ints, first_alike, locked, short_repr, unit_rows
from grasp3d.mesh.measures import Triangles, connected, crowded_edges, paired_edges

HALF = 0.5
"""Length of a mean of unit normals below which it has no meaningful direction."""

SAME_DIGITS = 6
"""Unit normals at one vertex that agree to this many digits count as one."""


@dataclass(frozen=True, eq=False)
class CornerNormals:
    """Inward unit normals at the corners of the faces; corners on one smooth patch share one."""

    corners: Ints
    """Row of `normals` for each corner of each face, shape (F, 3)."""
    normals: Floats
    """Inward unit normals, shape (C, 3)."""
    vertices: Ints
    """Vertex of each normal, shape (C,)."""

    __repr__ = short_repr

    def locked(self) -> "CornerNormals":
        """A copy that cannot be changed."""
        return CornerNormals(*map(locked, (self.corners, self.normals, self.vertices)))


def corner_normals(surface: Triangles, crease_angle: float) -> CornerNormals:
    """Average the face normals around each vertex, but never across a crease.

    Faces around a vertex are one patch when they are connected by edges that bend by at most
    `crease_angle`. A patch that as a whole bends more (the tip of a cone) keeps its face normals.
    The average is weighted by the angle at the vertex, which does not depend on the tessellation.

    Args:
        surface: Faces that all have an area.
        crease_angle: Largest bend of a smooth edge [rad].
    """
    faces, flat = surface.faces, surface.normals
    one, two = surface.pairs
    smooth = surface.bends <= crease_angle + 1e-9
    patch = connected(faces.size, *_matched_corners(faces, one[smooth], two[smooth]))
    face_of_corner = np.repeat(np.arange(len(faces)), 3)
    weights = surface.angles.ravel()
    sums = [np.bincount(patch, weights * flat[face_of_corner, k]) for k in range(3)]
    mean = unit_rows(np.stack(sums, axis=1).astype(np.float64))
    cosine = np.einsum("ij,ij->i", mean[patch], flat[face_of_corner])
    least = np.full(len(mean), np.inf)
    np.minimum.at(least, patch, cosine)
    bent = (least < np.cos(crease_angle) - 1e-9) | (np.linalg.norm(mean, axis=1) < HALF)
    vertex = np.zeros(len(mean), dtype=np.int64)
    vertex[patch] = faces.ravel()
    own = bent[patch]  # corners that keep their face's normal
    row = np.where(own, len(mean) + np.cumsum(own) - 1, patch)
    normals = np.concatenate([mean, flat[face_of_corner[own]]])
    vertices_of = np.concatenate([vertex, faces.ravel()[own]])
    used, row = np.unique(row, return_inverse=True)
    return CornerNormals(
        corners=row.reshape(-1, 3).astype(np.int64),
        normals=normals[used],
        vertices=vertices_of[used],
    )


def _matched_corners(faces: Ints, one: Ints, two: Ints) -> tuple[Ints, Ints]:
    """Corner numbers (3 f + i) that lie at one vertex across each pair of half-edges."""
    left = np.stack([3 * (one // 3) + (one + k) % 3 for k in (1, 2)])  # next, next but one
    right = np.stack([3 * (two // 3) + (two + k) % 3 for k in (1, 2)])
    flat = faces.ravel()
    swap = flat[left[0]] != flat[right[0]]
    right[:, swap] = right[::-1, swap]
    return left, right


def crease_twins(faces: Ints, corners: Ints) -> Ints:
    """Rows of the corner normals on the other side of each crease, shape (F, 3, 2).

    Entry [f, i] belongs to the edge opposite corner i of face f, its two columns to the corners
    i + 1 and i + 2; -1 where the edge is smooth or on a border, -2 where more than two faces meet.
    """
    twins = np.full((3 * len(faces), 2), -1, dtype=np.int64)
    twins[crowded_edges(faces)] = ANY_NORMAL
    one, two = paired_edges(faces)
    left, right = _matched_corners(faces, one, two)
    rows = corners.ravel()
    crease = (rows[left] != rows[right]).any(axis=0)
    one, two, left, right = one[crease], two[crease], left[:, crease], right[:, crease]
    twins[one] = rows[right].T
    # The second face has the same two corners in its own order.
    own = 3 * (two // 3) + (two + 1) % 3
    straight = own == right[0]
    twins[two] = np.where(straight[:, None], rows[left].T, rows[left[::-1]].T)
    return twins.reshape(-1, 3, 2)


def normal_sets(count: int, normals: CornerNormals) -> tuple[ContactNormals, Floats, Floats]:
    """Collect the distinct corner normals at each vertex into a convex polygon of normals.

    Args:
        count: Number of vertices.
        normals: The corner normals.

    Returns:
        The sets (one normal where the surface is smooth; none, with a radius of pi, where any
        direction is possible); their middles, shape (V, 3); their radii about these, shape (V,).
    """
    order = np.argsort(normals.vertices, kind="stable")
    vertex, rows = normals.vertices[order], normals.normals[order]
    distinct = _distinct(vertex, rows)
    vertex, rows = vertex[distinct], np.ascontiguousarray(rows[distinct])
    start = np.searchsorted(vertex, np.arange(count + 1)).astype(np.int64)
    counts, middles, radii = np.zeros(count, np.int64), np.zeros((count, 3)), np.zeros(count)
    order_normal_sets(start, rows, counts, middles, radii)
    return (
        ContactNormals(locked(start), locked(counts), locked(rows)),
        locked(middles),
        locked(radii),
    )


def _distinct(vertex: Ints, rows: Floats) -> Bools:
    """Mark the first of every group of equal normals at one vertex, shape (C,)."""
    mask = np.ones(len(vertex), dtype=bool)
    several = np.flatnonzero(np.bincount(vertex)[vertex] > 1)
    keys = np.column_stack([vertex[several], np.round(rows[several], SAME_DIGITS) + 0.0])
    mask[several] = False
    mask[several[first_alike(keys)[0]]] = True
    return mask
