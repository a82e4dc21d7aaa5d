"""Scenes of trimesh as one surface, and the units that they state."""

from typing import TYPE_CHECKING

import numpy as np

from grasp3d.arrays import Floats, Ints
from grasp3d.errors import MeshError
from grasp3d.reading.sources import check_finite
from grasp3d.settings.lengths import Unit

if TYPE_CHECKING:
    import trimesh

_UNIT_NAMES: dict[str, Unit] = {
    "m": "m", "meter": "m", "meters": "m", "metre": "m", "metres": "m",
    "cm": "cm", "centimeter": "cm", "centimeters": "cm",
    "mm": "mm", "millimeter": "mm", "millimeters": "mm",
    "in": "in", "inch": "in", "inches": "in",
}  # fmt: skip


def flattened(scene: "trimesh.Scene", where: str) -> tuple[Floats, Ints]:
    """Return vertices (V, 3) and faces (F, 3) of a scene, with the transforms of its parts applied.

    Points and lines are left out.

    Args:
        scene: The scene.
        where: Its name in errors.

    Raises:
        MeshError: A position is not finite, or a face uses a vertex that is not there.
    """
    for part in scene.geometry.values():
        _check_part(part, where)
    mesh = scene.to_mesh()
    vertices = np.asarray(mesh.vertices, dtype=np.float64).reshape(-1, 3)
    faces = np.asarray(mesh.faces, dtype=np.int64).reshape(-1, 3)
    check_finite(vertices, where)
    return vertices, faces


def stated_unit(name: str | None) -> tuple[Unit | None, str]:
    """Return the unit of a name such as 'millimeters', and the name if there is no such unit.

    Args:
        name: As a file or another library states it, or None.
    """
    known = _UNIT_NAMES.get(str(name or "").strip().lower())
    return known, "" if known or not name else str(name)


def _check_part(part: "trimesh.Trimesh | trimesh.PointCloud", where: str) -> None:
    """Reject invalid positions and vertex numbers, before parts are concatenated."""
    vertices = np.asarray(part.vertices, dtype=np.float64)
    check_finite(vertices, where)
    faces = np.asarray(getattr(part, "faces", ()), dtype=np.int64).reshape(-1, 3)
    bad = np.flatnonzero(((faces < 0) | (faces >= len(vertices))).any(axis=1))
    if len(bad):
        corner = faces[bad[0]][(faces[bad[0]] < 0) | (faces[bad[0]] >= len(vertices))][0]
        raise MeshError(
            f"{where}: face {bad[0]} uses vertex {corner}, but there are {len(vertices)} "
            "vertices; export the mesh again"
        )
