"""A surface as it was given, checked before it is repaired."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from grasp3d.arrays import Floats, Ints, used_indices
from grasp3d.errors import MeshError
from grasp3d.mesh.work_bounds import cell_counts
from grasp3d.reading import RawMesh, check_finite
from grasp3d.settings.costs import check_cost
from grasp3d.system.names import printable

LARGEST = 1e60
"""Largest coordinate, and reciprocal of the smallest size, whose powers stay finite."""

APART = 1e-5
"""Distance above which vertices are not joined, as a fraction of the size."""

TINY = float(np.finfo(np.float64).tiny)


@dataclass(frozen=True, eq=False)
class GivenMesh:
    """The surface of a mesh source."""

    raw: RawMesh
    """The surface as it was given."""
    name: str
    """Its name in reports: that of the file, the type, or 'arrays'."""
    path: Path | None = None
    """The file; None: it is not from a file."""

    @property
    def where(self) -> str:
        """Its name in errors."""
        return printable(str(self.path or self.name))

    @property
    def file_bytes(self) -> int | None:
        """Size of the file; None: it is not from a file."""
        return self.path.stat().st_size if self.path else None

    def check(self, max_memory: float) -> None:
        """Refuse what is not a surface, or too large to be labelled.

        Args:
            max_memory: Largest memory for labelling [GB].

        Raises:
            MeshError: There are no faces, or vertices that do not exist; positions are not finite
                or beyond what can be computed with; or labelling would exceed the memory.
        """
        vertices, faces = self.raw.vertices, self.raw.faces
        check_finite(vertices, self.where)
        if len(faces) == 0:
            raise MeshError(f"{self.where}: holds no faces")
        outside = (faces < 0) | (faces >= len(vertices))
        if outside.any():
            face = int(np.flatnonzero(outside.any(axis=1))[0])
            raise MeshError(
                f"{self.where}: face {face} uses vertex {faces[face][outside[face]][0]}, "
                f"but there are {len(vertices)} vertices"
            )
        _check_magnitude(vertices[faces], self.where)
        fewest = _fewest_vertices(vertices, used_indices(faces), len(faces))
        check_cost(fewest, max_memory, self.where, "simplify the mesh")


def _check_magnitude(corners: Floats, where: str) -> None:
    largest = float(np.abs(corners).max())
    with np.errstate(over="ignore"):  # values that overflow are refused below
        spread = float(np.ptp(corners.reshape(-1, 3), axis=0).max())
    if largest > LARGEST or 0.0 < spread < 1.0 / LARGEST:
        raise MeshError(
            f"{where}: coordinates up to {largest:.3g} and a size of {spread:.3g} are beyond what "
            f"can be computed with ({1.0 / LARGEST:.0e} to {LARGEST:.0e}); scale the mesh"
        )


def _fewest_vertices(vertices: Floats, used: Ints, faces: int) -> int:
    """Estimate the least number of vertices after repair: those within rounding count once."""
    fewest = faces // 2
    if len(used) <= 2 * fewest:
        return fewest
    points = vertices[used]
    points = (points - points.min(axis=0)) / max(float(np.ptp(points, axis=0).max()), TINY)
    return max(fewest, len(cell_counts(points, APART)))
