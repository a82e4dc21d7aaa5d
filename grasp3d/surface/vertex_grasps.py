"""Grasps of vertices: one contact at the vertex, the others anywhere on the surface."""

from enum import IntEnum

import numpy as np

from grasp3d._kernels.search import antipodal_candidates
from grasp3d.arrays import Bools, Ints
from grasp3d.mesh import ObjectMesh
from grasp3d.mesh.surface_points import SurfacePoints
from grasp3d.surface.contacts import SurfaceContacts, vertex_surface_points


class Reason(IntEnum):
    """Why a vertex has no grasp."""

    FOUND = antipodal_candidates.FOUND
    """It has a grasp."""
    NO_PARTNER = antipodal_candidates.NO_PARTNER
    """No opposing contact was found within the search cone."""
    OPENING = antipodal_candidates.OPENING
    """All opposing contacts were outside the limits of opening or distances."""
    OFF_SURFACE = 3
    """The vertex belongs to no face."""
    SAME_POINT = 4
    """A fixed finger is at the vertex."""
    NOT_REACHED = 5
    """It has grasps, but the gripper reached none of those that were tested."""


def grasps_at(
    mesh: ObjectMesh, partner_points: SurfacePoints, vertices: Ints, number: int
) -> SurfaceContacts:
    """The grasps of chosen vertices as contacts on the surface.

    Args:
        mesh: The surface.
        partner_points: Opposing contacts of every vertex's two grasps, shape (V, 2, n - 1).
        vertices: Chosen vertices, shape (b,), which have both grasps.
        number: 0: the best grasp over the worst normals; 1: over the best normals.

    Returns:
        The grasps (b, n), the contacts at the vertices first.
    """
    first = vertex_surface_points(mesh, vertices)
    faces, weights = (
        partner_points.faces[vertices, number],
        partner_points.weights[vertices, number],
    )
    return SurfaceContacts(
        mesh,
        SurfacePoints(
            np.concatenate([first.faces[:, None], faces], axis=1),
            np.concatenate([first.weights[:, None], weights], axis=1),
        ),
    )


def grasps_differ(partner_points: SurfacePoints, vertices: Ints) -> Bools:
    """Whether the best grasps over the best and over the worst normals differ, shape (b,)."""
    faces, weights = partner_points.faces[vertices], partner_points.weights[vertices]
    same = (faces[:, 0] == faces[:, 1]) & (weights[:, 0] == weights[:, 1]).all(axis=-1)
    return np.asarray(~same.all(axis=-1))
