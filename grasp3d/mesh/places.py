"""Places on a surface."""

from dataclasses import dataclass

import numpy as np
import trimesh

from grasp3d.arrays import Floats, Ints
from grasp3d.mesh.object_mesh import ObjectMesh


@dataclass(frozen=True, eq=False)
class SurfacePlaces:
    """Places anywhere on a surface."""

    faces: Ints
    """Face of each, shape (...); -1: nowhere."""
    weights: Floats
    """Barycentric coordinates on it, shape (..., 3)."""

    def positions(self, mesh: ObjectMesh) -> Floats:
        """Where they are, in the mesh's frame and unit, shape (..., 3)."""
        corners = mesh.vertices[mesh.faces[self.faces]]  # (..., 3, 3)
        return (self.weights[..., None, :] @ corners)[..., 0, :]


def nearest_place(mesh: ObjectMesh, point: Floats) -> tuple[Floats, int, Floats]:
    """Find the place of the surface that is nearest to a point.

    Args:
        mesh: The surface.
        point: Position in the normalised frame, shape (3,).

    Returns:
        The place (3,) in the normalised frame, its face, and its barycentric coordinates (3,).
    """
    points, faces = mesh.normalized, mesh.faces
    corners = points[faces]  # (F, 3, 3)
    middles = corners.mean(axis=1)
    reach = np.linalg.norm(corners - middles[:, None], axis=2).max(axis=1)
    distance = np.linalg.norm(middles - point, axis=1)
    near = np.flatnonzero(distance - reach <= (distance + reach).min())
    closest = trimesh.triangles.closest_point(corners[near], np.tile(point, (len(near), 1)))
    nearest = int(np.argmin(((closest - point) ** 2).sum(axis=1)))
    place, face = closest[nearest], int(near[nearest])
    weights = trimesh.triangles.points_to_barycentric(corners[face][None], place[None])[0]
    weights = np.clip(weights, 0.0, None) / np.clip(weights, 0.0, None).sum()
    return place, face, weights
