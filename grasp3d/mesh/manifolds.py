"""The Manifold library's verdict on a surface: whether it is a valid solid to that library."""

import manifold3d
import numpy as np

from grasp3d.arrays import Floats, Ints


def manifold_status(points: Floats, faces: Ints) -> str:
    """Name of Manifold's status for a surface: NoError, NotManifold, NonFiniteVertex, ...

    Args:
        points: Positions (V, 3).
        faces: Faces (F, 3).
    """
    used, rows = np.unique(faces, return_inverse=True)
    mesh = manifold3d.Mesh64(
        np.ascontiguousarray(points[used]), rows.reshape(-1, 3).astype(np.uint64)
    )
    return str(manifold3d.Manifold(mesh).status().name)
