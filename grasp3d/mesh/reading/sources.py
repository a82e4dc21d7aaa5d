"""Mesh files to read, and the surfaces that are read from them or given."""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from grasp3d.arrays import Floats, Ints, short_repr
from grasp3d.errors import MeshError
from grasp3d.settings.units import METRES, Unit
from grasp3d.system.documents import problem_of_file
from grasp3d.system.names import printable, unsupported

SUFFIXES = (".3mf", ".glb", ".gltf", ".obj", ".off", ".ply", ".stl")
"""Suffixes of mesh files that can be read."""

LARGEST = 1e60
"""Largest coordinate, and reciprocal of the smallest size, whose powers stay finite."""

_UNIT_NAMES: dict[str, Unit] = {
    "m": "m", "meter": "m", "metre": "m", "cm": "cm", "centimeter": "cm", "mm": "mm",
    "millimeter": "mm", "in": "in", "inch": "in", "inche": "in",
}  # fmt: skip
"""Units by their names without an `s` at the end."""


@dataclass(frozen=True, eq=False)
class RawMesh:
    """The surface as stored in a mesh file, or given as an object of another library.

    Raises:
        MeshError: There are no faces, or vertices that do not exist; or coordinates cannot be
            computed with.
    """

    vertices: Floats
    """Positions, shape (V, 3), in the order and unit of the file; of an STL, each position once."""
    faces: Ints
    """Vertex numbers of the triangles, shape (F, 3)."""
    format: str
    """File suffix without its dot, in lower case; else the library, or 'arrays'."""
    unit: Unit | None
    """Unit that the file declares; None: it declares none."""
    name: str = "arrays"
    """Its name in reports: that of the file, the type, or 'arrays'."""
    path: Path | None = None
    """The file; None: it is not from a file."""

    __repr__ = short_repr

    def __post_init__(self) -> None:
        if not len(self.faces):
            raise MeshError(f"{self.where}: holds no triangles; points and lines alone are no mesh")
        check_finite(self.vertices, self.where)
        check_corners(self.faces, len(self.vertices), self.where)
        if 0.0 < self.extent < 1.0 / LARGEST:
            raise MeshError(f"{self.where}: its extent is only {self.extent:.3g}; scale the mesh")

    @property
    def where(self) -> str:
        """Its name in errors."""
        return printable(str(self.path or self.name))

    @property
    def extent(self) -> float:
        """Largest extent of the surface along an axis."""
        return float(np.ptp(self.vertices[self.faces].reshape(-1, 3), axis=0).max())


@dataclass(frozen=True)
class Source:
    """An existing file of a mesh, or of labels."""

    path: Path
    kind: str
    """Format: the file suffix without its dot, in lower case."""
    where: str
    """Printable path, for error messages."""

    def error(self, reason: str) -> MeshError:
        """The error that a file cannot be read for a reason, which begins with a verb."""
        return MeshError(f"{self.where}: {reason}")

    def unexpected(self, reason: str) -> MeshError:
        """The same, of content that its suffix does not promise."""
        return self.error(f"{reason}; is the file complete, and is its suffix right?")


def check_finite(vertices: Floats, where: str) -> None:
    """Reject positions that cannot be computed with.

    Raises:
        MeshError: A coordinate is nan, or larger than 1e60.
    """
    bad = np.flatnonzero(~(np.abs(vertices) <= LARGEST).all(axis=1))
    if len(bad):
        raise MeshError(
            f"{where}: vertex {bad[0]} has a coordinate that is not a finite number, or above "
            f"{LARGEST:g} ({len(bad)} such vertices); export the mesh again"
        )


def check_corners(faces: Ints, count: int, where: str) -> None:
    """Reject faces with vertices that do not exist.

    Args:
        faces: Vertex numbers of the corners, shape (F, 3).
        count: Number of vertices.
        where: Name of the mesh in errors.

    Raises:
        MeshError: There is such a face.
    """
    outside = (faces < 0) | (faces >= count)
    if outside.any():
        raise MeshError(
            f"{where}: face {np.flatnonzero(outside.any(axis=1))[0]} uses vertex "
            f"{faces[outside][0]}, but there are {count} vertices; export the mesh again"
        )


def find_source(path: Path, suffixes: Iterable[str] = SUFFIXES) -> Source:
    """Return the file at a path, after checking that it exists and has a known suffix.

    Args:
        path: The file.
        suffixes: Those that can be read.

    Raises:
        MeshError: It does not exist, is not a file, is empty, or its suffix is unknown.
    """
    where, suffix = printable(str(path)), path.suffix.lower()
    if problem := problem_of_file(path):
        raise MeshError(f"{where}: {problem}")
    if suffix not in suffixes:
        raise MeshError(unsupported(path, sorted(suffixes)))
    if not path.stat().st_size:
        raise MeshError(f"{where}: the file is empty; export the mesh again")
    return Source(path, suffix.removeprefix("."), where)


def unit_called(name: str | None, where: str) -> Unit | None:
    """Return the unit of a name such as 'millimeters'.

    Args:
        name: As a file or another library states it; None: it states none.
        where: Name of the mesh in errors.

    Raises:
        MeshError: It is none of the supported units.
    """
    unit = _UNIT_NAMES.get((name or "").strip().lower().removesuffix("s"))
    if name and unit is None:
        raise MeshError(
            f"{where}: states the unit {printable(name)!r}, which is none of {', '.join(METRES)}; "
            "scale the mesh to one of these"
        )
    return unit
