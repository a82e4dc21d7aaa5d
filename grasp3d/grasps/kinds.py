"""Kinds of grasps: those that pass into each other along the surface."""

import math

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from grasp3d.arrays import Bools, Floats, Ints
from grasp3d.surface.labels import SurfaceLabels

TURN = math.radians(30.0)
"""Largest angle between the approach directions of neighbouring grasps of one kind [rad]."""

STRETCH = 4.0
"""Largest distance of neighbours' opposing contacts, relative to that of the neighbours."""

NEAR = 1.0 / 32.0
"""Distance of neighbours' opposing contacts, in object sizes, that is allowed in any case."""


def grasp_kinds(labels: SurfaceLabels) -> Ints:
    """Number the kinds of the vertices' grasps, such as across, at the rim, at the handle.

    Neighbouring vertices have one kind of grasp where their opposing contacts are near each other
    and the gripper, if there is one, approaches from nearly the same direction.

    Args:
        labels: The labelled surface.

    Returns:
        The kind of each vertex's grasp, from 0, shape (V,); -1: no grasp.
    """
    mesh, faces = labels.mesh, labels.mesh.faces
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    has_grasp = np.zeros(len(mesh.vertices), dtype=bool)
    has_grasp[labels.vertices] = True
    edges = edges[has_grasp[edges].all(axis=1)]
    edges = edges[_alike(labels, edges)]
    count = len(mesh.vertices)
    links = coo_array((np.ones(len(edges)), (edges[:, 0], edges[:, 1])), shape=(count, count))
    _, kinds = connected_components(links, directed=False)
    numbers = np.full(count, -1, dtype=np.int64)
    _, numbers[has_grasp] = np.unique(kinds[has_grasp], return_inverse=True)
    return numbers[mesh.canonical]


def _alike(labels: SurfaceLabels, edges: Ints) -> Bools:
    """Whether the grasps at the ends of edges (e, 2) pass into each other, shape (e,)."""
    one, two = edges.T
    vertices, size = labels.mesh.vertices, labels.mesh.size
    lengths = np.linalg.norm(vertices[one] - vertices[two], axis=1)
    gaps = np.linalg.norm(labels.partners[one] - labels.partners[two], axis=2).max(axis=1)
    alike = gaps <= np.maximum(STRETCH * lengths, NEAR * size)
    if labels.reach is not None:
        alike &= _cosines(labels.reach.poses[:, :3, 2], one, two) >= math.cos(TURN)
    return np.asarray(alike)


def _cosines(directions: Floats, one: Ints, two: Ints) -> Floats:
    """Cosines between unit vectors; 1 where there is none, as for more than two fingers."""
    cosines = (directions[one] * directions[two]).sum(axis=1)
    return np.asarray(np.nan_to_num(cosines, nan=1.0))
