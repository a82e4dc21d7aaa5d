"""Proof that contacts cannot apply a wrench, however hard they press.

The wrench is projected onto a polyhedral cone that contains all that the contacts can apply; where
something remains, it is a direction along which no contact can push.
"""

import math
from functools import cache

import numpy as np
from scipy.optimize import nnls
from scipy.spatial import ConvexHull

from grasp3d.arrays import Floats
from grasp3d.contact.friction_cones import edge_angles, tangents

EDGES = 64
"""Edges of the circumscribed polygon of a friction cone."""

PATCH_CORNERS = 16
"""Corners of the circumscribed polygon of a patch."""

SPHERE_POINTS = 400
"""Vertices of the circumscribed polyhedron of the elliptic limit surface."""

ROUNDING = 1e-11
"""Rounding errors of unit wrenches along the direction."""

APART = 1e-9
"""Remainder, relative to the wrench, that is not a rounding error."""


def separating_direction(
    points: Floats,
    normals: Floats,
    friction: Floats,
    torsion: Floats,
    wrench: Floats,
    rolling: Floats | None = None,
) -> Floats | None:
    """A direction that proves that no contact forces apply a wrench; None: none was found.

    Args:
        points: Contact points of one grasp, of a size of about 1 (n, 3).
        normals: Inward unit normals (n, 3).
        friction: Coefficients (n,).
        torsion: Torsion radii in the unit of the points (n,).
        wrench: Shape (6,).
        rolling: As `Contacts.rolling_arms` in the unit of the points (n, 2, 3); None: points.

    Returns:
        Direction (6,) along which the wrench has a positive component and no contact pushes.
    """
    sections = _circumscribed_ball() if (torsion > 0.0).any() else _circumscribed_circle()
    forces = normals[:, None] + friction[:, None, None] * (
        sections[:, 0, None] * tangents(normals)[0][:, None]
        + sections[:, 1, None] * tangents(normals)[1][:, None]
    )  # (n, m, 3)
    moments = np.cross(points[:, None], forces)
    moments += (torsion[:, None] * sections[:, 2])[..., None] * normals[:, None]
    if rolling is not None:
        moments = moments[:, :, None] + (_circumscribed_patch() @ rolling)[:, None]  # (n, m, k, 3)
        forces = np.broadcast_to(forces[:, :, None], moments.shape)
    generators = np.concatenate([forces, moments], axis=-1).reshape(-1, 6)
    size = np.linalg.norm(wrench)
    weights, left = nnls(generators.T, wrench / size)
    if left <= APART:
        return None
    direction = wrench / size - weights @ generators
    lengths = np.linalg.norm(generators, axis=-1)
    separates = ((generators @ direction) <= ROUNDING * lengths).all()
    return np.asarray(direction) if separates else None


@cache
def _circumscribed_circle() -> Floats:
    """Vertices of a polygon around the unit circle, (m, 3), the last coordinate 0."""
    angles = edge_angles(EDGES)
    corners = np.stack([np.cos(angles), np.sin(angles), np.zeros(EDGES)], axis=-1)
    return np.asarray(corners / math.cos(math.pi / EDGES))


@cache
def _circumscribed_patch() -> Floats:
    """Vertices of a polygon around the unit circle, (k, 2)."""
    angles = edge_angles(PATCH_CORNERS)
    corners = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    return np.asarray(corners / math.cos(math.pi / PATCH_CORNERS))


@cache
def _circumscribed_ball() -> Floats:
    """Vertices of a polyhedron around the unit ball, evenly on a spiral, (m, 3)."""
    k = np.arange(SPHERE_POINTS) + 0.5
    height, turn = 1.0 - 2.0 * k / SPHERE_POINTS, math.pi * (1.0 + math.sqrt(5.0)) * k
    ring = np.sqrt(1.0 - height**2)
    points = np.stack([ring * np.cos(turn), ring * np.sin(turn), height], axis=-1)
    inside = -ConvexHull(points).equations[:, -1].max()
    return np.asarray(points / inside)
