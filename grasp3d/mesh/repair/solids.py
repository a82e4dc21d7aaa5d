"""Bodies as solids of the library Manifold, their faces offset."""

from dataclasses import dataclass

import manifold3d
import numpy as np

from grasp3d.arrays import Floats, Ints
from grasp3d.mesh.measures import Triangles

FARTHEST = 4.0
"""Largest displacement of a corner, in units of the offset of its faces."""


@dataclass(frozen=True, eq=False)
class Solid:
    """A closed body, with its cavities or without, its faces offset."""

    corners: Ints
    """Its vertices, shape (n,)."""
    points: Floats
    """Their displaced positions, shape (n, 3)."""
    mark: int
    """Identifier that Manifold keeps on its faces; later solids have larger ones."""
    manifold: manifold3d.Manifold

    @classmethod
    def of(cls, points: Floats, faces: Ints, distance: float = 0.0) -> "Solid":
        """Offset the faces of a body.

        Args:
            points: Positions (V, 3).
            faces: Faces (F, 3), counter-clockwise from outside.
            distance: Outward offset of the faces; negative if inward.
        """
        corners, rows = np.unique(faces, return_inverse=True)
        own, rows = points[corners], rows.reshape(-1, 3)
        if distance:
            own += distance * _unit_shifts(own, rows)
        mark = manifold3d.Manifold.reserve_ids(1)
        mesh = manifold3d.Mesh64(
            own,
            rows.astype(np.uint64),
            run_index=np.array([0, rows.size], dtype=np.uint64),
            run_original_id=np.array([mark], dtype=np.uint32),
        )
        return cls(corners, own, mark, manifold3d.Manifold(mesh))


def _unit_shifts(points: Floats, faces: Ints) -> Floats:
    """Least-squares displacements (V, 3) of the vertices that move all faces outward by 1."""
    surface = Triangles(points, faces)
    outward, weights = -surface.normals, surface.angles
    pull = np.zeros_like(points)
    spread = np.zeros((len(points), 3, 3))
    squares = outward[:, :, None] * outward[:, None, :]
    for k in range(3):
        np.add.at(pull, faces[:, k], weights[:, k, None] * outward)
        np.add.at(spread, faces[:, k], weights[:, k, None, None] * squares)
    inverse = np.linalg.pinv(spread, rcond=1e-3, hermitian=True)
    shift = np.einsum("vij,vj->vi", inverse, pull)
    length = np.linalg.norm(shift, axis=1, keepdims=True)
    return np.asarray(shift / np.maximum(length / FARTHEST, 1.0))
