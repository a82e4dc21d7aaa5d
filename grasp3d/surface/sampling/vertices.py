"""What searches need of the vertices of a surface: their neighbours, and reference directions."""

import numpy as np
from scipy.sparse import coo_array

from grasp3d._kernels.surface.face_tree import FaceTree, face_tree
from grasp3d._kernels.surface.surface_contacts import Surface
from grasp3d.arrays import Floats, Ints, locked, unit_rows
from grasp3d.mesh import ObjectMesh


def contact_tree(mesh: ObjectMesh, surface: Surface) -> FaceTree:
    """A new tree over the faces in which contacts may be; searches find opposing contacts there."""
    faces, turns = mesh.contact_faces, surface.turns
    if turns.error > 0.0:
        turns = turns._replace(least=locked(turns.least[faces]))
    part = surface._replace(
        faces=locked(surface.faces[faces]), corners=locked(surface.corners[faces]), turns=turns
    )
    tree: FaceTree = face_tree(part)
    return tree._replace(order=faces[tree.order])


def places_in_tree(count: int, surface: Surface, tree: FaceTree) -> Ints:
    """Where each of `count` vertices comes first in the order of a tree, shape (V,).

    In this order neighbours mostly follow one another.
    """
    used, first = np.unique(surface.faces[tree.order], return_index=True)
    place = np.full(count, len(surface.faces) * 3)
    place[used] = first
    return place


def neighbours(mesh: ObjectMesh) -> tuple[Ints, Ints]:
    """(first, index): the adjacent vertices of each vertex, grouped by vertex, for the kernels.

    Only of those where contacts may be.
    """
    one, two = mesh.faces[:, [0, 1, 2]].ravel(), mesh.faces[:, [1, 2, 0]].ravel()
    allowed = mesh.allowed[one] & mesh.allowed[two]
    one, two = one[allowed], two[allowed]
    links = coo_array(
        (
            np.ones(2 * len(one), dtype=np.int8),
            (np.concatenate([one, two]), np.concatenate([two, one])),
        ),
        shape=(len(mesh.vertices),) * 2,
    ).tocsr()
    return links.indptr.astype(np.int64), links.indices.astype(np.int64)


MIN_LENGTH = 1e-3
"""Length of a reference vector's part orthogonal to the normal, from which it is used."""

SYMMETRIC = 1e-9
"""Third moment, in object sizes cubed, below which the object is symmetric along an axis."""


def tangents(mesh: ObjectMesh) -> Floats:
    """A unit vector orthogonal to each vertex's normal that turns with the object, shape (V, 3).

    Computed from the mesh's geometry, so that rotating, moving or scaling the object or reordering
    its vertices changes no search direction: from the vector from the centre to the vertex; where
    that is parallel to the normal, from the third moments of the surface, its principal axes, and
    finally, for objects as regular as a ball, from an edge.
    """
    centres = mesh.normal_centres
    points = mesh.normalized
    weights = mesh.vertex_areas / mesh.vertex_areas.sum()
    squares = np.einsum("ij,ij->i", points, points)
    moments = (points * weights[:, None]).T @ points
    third_moment = ((weights * squares)[:, None] * points).sum(axis=0)
    _, axes = np.linalg.eigh(moments)
    skew = ((points @ axes) ** 3 * weights[:, None]).sum(axis=0)
    signs = np.where(np.abs(skew) > SYMMETRIC, np.sign(skew), 0.0)
    edge = np.zeros_like(points)
    for k in (2, 1, 0):
        edge[mesh.faces[:, k]] = points[mesh.faces[:, (k + 1) % 3]] - points[mesh.faces[:, k]]
    references = [third_moment, axes[:, 2] * signs[2], axes[:, 0] * signs[0]]
    result = np.zeros_like(points)
    missing = np.ones(len(points), dtype=bool)
    for reference in (points, *references, unit_rows(edge)):
        across = reference - (reference * centres).sum(axis=1, keepdims=True) * centres
        clear = missing & (np.linalg.norm(across, axis=1) > MIN_LENGTH)
        result[clear] = across[clear]
        missing &= ~clear
    return unit_rows(result)
