"""Scenes that trimesh reads of files, which become one surface."""

import io
import logging
import warnings
from typing import TYPE_CHECKING, Any

import numpy as np

from grasp3d.arrays import Floats, Ints
from grasp3d.errors import MeshError
from grasp3d.reading.sources import Source, check_corners, check_finite

if TYPE_CHECKING:
    import trimesh

# Without a handler, Python prints the messages of trimesh's logger to the terminal.
logging.getLogger("trimesh").addHandler(logging.NullHandler())

FLAT = 1e-9
"""Smallest scale of a transform, as a fraction of its largest, that does not flatten a mesh."""


def load_scene(source: Source, data: bytes, **options: Any) -> "trimesh.Scene":
    """What trimesh reads of a file.

    Args:
        source: The file.
        data: Its content.
        options: Of trimesh's reader.
    """
    import trimesh

    with warnings.catch_warnings():
        # These warnings mean damaged files: incomplete or invalid numbers. Other warnings are
        # about trimesh itself.
        warnings.filterwarnings("error", "string or file could not be read", DeprecationWarning)
        warnings.filterwarnings("error", category=RuntimeWarning, module="trimesh")
        return trimesh.load_scene(io.BytesIO(data), source.kind, process=False, **options)


def flattened(scene: "trimesh.Scene", where: str) -> tuple[Floats, Ints]:
    """Return vertices (V, 3) and faces (F, 3) of a scene, with the transforms of its parts applied.

    Points and lines are left out.

    Args:
        scene: The scene.
        where: Its name in errors.

    Raises:
        MeshError: A position is not finite, a face uses a vertex that is not there, or a transform
            flattens a part.
    """
    for part in scene.geometry.values():  # before they are concatenated
        positions = np.asarray(part.vertices, dtype=np.float64)
        check_finite(positions, where)
        corners = np.asarray(getattr(part, "faces", ()), dtype=np.int64).reshape(-1, 3)
        check_corners(corners, len(positions), where, "; export the mesh again")
    for node in scene.graph.nodes_geometry:
        if flattens(scene.graph[node][0]):
            raise MeshError(
                f"{where}: node {node!r} flattens its mesh: its transform, with those of the nodes "
                "above it, is singular (a scale of 0 in some directions); correct it, or delete "
                "the node"
            )
    mesh = scene.to_mesh()
    vertices = np.asarray(mesh.vertices, dtype=np.float64).reshape(-1, 3)
    faces = np.asarray(mesh.faces, dtype=np.int64).reshape(-1, 3)
    check_finite(vertices, where)
    return vertices, faces


def flattens(world: Floats) -> bool:
    """Whether a transform, shape (4, 4), has a scale of 0 in some directions, but not in all."""
    scales = np.linalg.svd(world[:3, :3], compute_uv=False)
    return bool(scales[0] > 0.0 and scales[2] <= FLAT * scales[0])
