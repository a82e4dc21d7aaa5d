"""Mesh files to read, their formats and units, and the surfaces read from them."""

import re
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from grasp3d.arrays import Floats, Ints, short_repr
from grasp3d.errors import MeshError
from grasp3d.settings.units import Unit
from grasp3d.system.documents import is_folder, problem_of_file
from grasp3d.system.names import printable

SUFFIXES = (".3dxml", ".3mf", ".glb", ".gltf", ".obj", ".off", ".ply", ".stl", ".xaml")
"""Suffixes of mesh files that can be read."""

_SIGNATURES = (
    ("PLY", rb"ply\s"),
    ("GLB", rb"glTF"),
    ("a zip archive, such as 3MF", rb"PK\x03\x04"),
    ("OFF", rb"\s*(ST)?C?N?OFF\s"),
    ("STL", rb"(?i:\s*solid\b[^\x00]*\bfacet\s)"),
    ("glTF", rb"\s*\{[^\x00]*\"asset\""),
    ("HTML", rb"(?i:\s*<(!doctype html|html))"),
    ("XML", rb"(\xef\xbb\xbf)?\s*<[?!\w]"),
    ("STEP", rb"\s*ISO-10303-21"),
    ("OBJ", rb"(?s:(.*\n)?v[ \t]+[-+.\d][^\n]*\nv[ \t])"),
)

_UNIT_NAMES: dict[str, Unit] = {
    "m": "m", "meter": "m", "meters": "m", "metre": "m", "metres": "m",
    "cm": "cm", "centimeter": "cm", "centimeters": "cm",
    "mm": "mm", "millimeter": "mm", "millimeters": "mm",
    "in": "in", "inch": "in", "inches": "in",
}  # fmt: skip


@dataclass(frozen=True, eq=False)
class RawMesh:
    """The surface as stored in a mesh file, or given as an object of another library."""

    vertices: Floats
    """Positions, shape (V, 3), in the order and unit of the file; of an STL, each position once."""
    faces: Ints
    """Vertex numbers of the triangles, shape (F, 3)."""
    format: str
    """File suffix without its dot, in lower case; else the library, or 'arrays'."""
    unit: Unit | None
    """Unit that the file declares; None: it declares none."""
    unknown_unit: str = ""
    """Name of the declared unit if it is none of `Unit`."""
    name: str = "arrays"
    """Its name in reports: that of the file, the type, or 'arrays'."""
    path: Path | None = None
    """The file; None: it is not from a file."""

    __repr__ = short_repr

    @property
    def where(self) -> str:
        """Its name in errors."""
        return printable(str(self.path or self.name))


@dataclass(frozen=True)
class Source:
    """An existing file of a mesh, or of labels."""

    path: Path
    kind: str
    """Format: the file suffix without its dot, in lower case."""
    size: int
    """Size of the file [bytes]."""
    where: str
    """Printable path, for error messages."""

    def head(self, count: int = 4096) -> bytes:
        """Return the first bytes of the file."""
        with self.path.open("rb") as stream:
            return stream.read(count)

    def error(self, reason: str) -> MeshError:
        """The error that a file cannot be read for a reason, which begins with a verb."""
        return MeshError(f"{self.where}: {reason}")

    def damaged(self, reason: str) -> MeshError:
        """The same, of a file that its program has to write again."""
        return self.error(f"{reason}; export the mesh again")

    def incomplete(self, reason: str) -> MeshError:
        """The same, of a file whose end may be missing."""
        return self.error(f"{reason}; is the file complete?")

    def unexpected(self, reason: str) -> MeshError:
        """The same, of content that its suffix does not promise."""
        return self.error(f"{reason}; {self.hint}")

    @property
    def hint(self) -> str:
        """Question about the likely cause if the content does not match the suffix."""
        head = self.head()
        matches = (name for name, pattern in _SIGNATURES if re.match(pattern, head))
        kind = next(matches, None)
        if kind is None or kind.lower().endswith(self.kind):
            return "is the file complete, and is its suffix right?"
        return f"its content looks like {kind}: is its suffix right?"


def check_finite(vertices: Floats, where: str) -> None:
    """Reject positions that are not finite.

    Raises:
        MeshError: A coordinate is nan or infinite.
    """
    bad = np.flatnonzero(~np.isfinite(vertices).all(axis=1))
    if len(bad):
        raise MeshError(
            f"{where}: vertex {bad[0]} has a coordinate that is not a finite number "
            f"({len(bad)} such vertices); export the mesh again"
        )


def check_corners(faces: Ints, count: int, where: str, remedy: str = "") -> None:
    """Reject faces with vertices that do not exist.

    Args:
        faces: Vertex numbers of the corners, shape (F, 3).
        count: Number of vertices.
        where: Name of the mesh in errors.
        remedy: Last part of the message.

    Raises:
        MeshError: There is such a face.
    """
    outside = (faces < 0) | (faces >= count)
    if outside.any():
        face = int(np.flatnonzero(outside.any(axis=1))[0])
        raise MeshError(
            f"{where}: face {face} uses vertex {faces[face][outside[face]][0]}, but there are "
            f"{count} vertices{remedy}"
        )


def find_source(path: Path, suffixes: Iterable[str] = SUFFIXES) -> Source:
    """Return the file at a path, after checking that it exists and has a known suffix.

    Args:
        path: The file.
        suffixes: Those that can be read.

    Raises:
        MeshError: It does not exist, is not a file, is empty, or its suffix is unknown.
    """
    where = printable(str(path))
    if is_folder(path):
        raise MeshError(f"{where}: is a folder, not a mesh file; `grasp3d batch` takes folders")
    if problem := problem_of_file(path):
        raise MeshError(f"{where}: {problem}")
    suffix = path.suffix.lower()
    if not suffix:
        raise MeshError(f"{where}: its name has no suffix for its format, such as .stl")
    if suffix not in suffixes:
        formats = " ".join(sorted(suffixes))
        raise MeshError(f"{where}: unsupported format {suffix}: supported are {formats}")
    if not (size := path.stat().st_size):
        raise MeshError(f"{where}: the file is empty; export the mesh again")
    source = Source(path, suffix.removeprefix("."), size, where)
    try:
        source.head(1)
    except OSError as error:
        raise MeshError(f"{where}: cannot be opened ({error.strerror})") from error
    return source


def stated_unit(name: str | None) -> tuple[Unit | None, str]:
    """Return the unit of a name such as 'millimeters', and the name if there is no such unit.

    Args:
        name: As a file or another library states it, or None.
    """
    unit = _UNIT_NAMES.get(str(name or "").strip().lower())
    return unit, "" if unit or not name else str(name)
