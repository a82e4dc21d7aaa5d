"""Mesh files to read, their formats and units, and the surfaces read from them.

Scenes of trimesh become one surface.
"""

import re
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from grasp3d.arrays import Floats, Ints, short_repr
from grasp3d.errors import MeshError
from grasp3d.settings.lengths import Unit
from grasp3d.system.documents import is_folder, problem_of_file
from grasp3d.system.names import printable

if TYPE_CHECKING:
    import trimesh

DIRECT_FORMATS = ("stl", "ply", "obj", "off")
"""Formats whose file size limits the size of the mesh; they are read in this process."""

ISOLATED_FORMATS = ("glb", "gltf", "3mf", "3dxml", "xaml")
"""Formats that a small file can expand without limit; they are read in a child process."""

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

FLAT = 1e-9
"""Smallest scale of a transform, as a fraction of its largest, that does not flatten a mesh."""

MOST_CORNERS = 1000
"""Largest number of corners of a face; round lids have a few hundred."""

LONGEST_HEADER = 65_536
"""Bytes in which a header must end."""

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
    """An existing mesh file, and the memory limit for reading it."""

    path: Path
    kind: str
    """Format: the file suffix without its dot, in lower case."""
    size: int
    """Size of the file [bytes]."""
    max_memory: float
    """Largest memory for reading it [GB]."""
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
        if kind is None or kind.lower() == self.kind:
            return "is the file complete, and is its suffix right?"
        return f"its content looks like {kind}: is its suffix right?"


def check_memory(source: Source, size: int, per_byte: float) -> None:
    """Reject a file that needs more memory to read than is allowed.

    Args:
        source: The file.
        size: Bytes to read.
        per_byte: Memory per byte.

    Raises:
        MeshError: It needs more.
    """
    needed = per_byte * size / 1e9
    if needed > source.max_memory:
        raise source.error(
            f"reading {size:,} bytes of {source.kind.upper()} takes about "
            f"{needed:.3g} GB of memory, and max_memory is {source.max_memory:g} GB; simplify the "
            "mesh, or raise max_memory (--max-memory)"
        )


def check_count(source: Source, what: str, count: int, min_bytes: int, available: int) -> None:
    """Reject a header that declares more items than the file can contain.

    Args:
        source: The file.
        what: Name of the items, in the plural.
        count: Declared number of items.
        min_bytes: Least size of an item [bytes].
        available: Bytes of the file for all items.

    Raises:
        MeshError: It declares too many, or a negative number.
    """
    if count < 0 or count * min_bytes > available:
        raise source.incomplete(f"declares {count:,} {what}, but has {available:,} bytes for them")


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


def as_triangles(source: Source, corners: Ints, counts: Ints) -> Ints:
    """Divide polygons into triangles that share the first corner of theirs, shape (F, 3).

    Args:
        source: The file.
        corners: The vertex numbers of the corners of one polygon after the other, shape (k,).
        counts: How many are those of each polygon, shape (n,).

    Raises:
        MeshError: A polygon has too few or too many corners.
    """
    bad = np.flatnonzero((counts < 3) | (counts > MOST_CORNERS))
    if len(bad):
        raise source.error(
            f"face {bad[0]} has {counts[bad[0]]:,} corners; 3 to {MOST_CORNERS:,} are allowed"
        )
    first = np.repeat(np.cumsum(counts) - counts, counts - 2)
    step = np.arange(len(first)) - np.repeat(np.cumsum(counts - 2) - (counts - 2), counts - 2)
    fans: Ints = corners[np.stack([first, first + step + 1, first + step + 2], axis=1)]
    return fans


def mesh_suffixes() -> frozenset[str]:
    """Return the file suffixes that can be read, such as `.stl`."""
    return frozenset(f".{name}" for name in (*DIRECT_FORMATS, *ISOLATED_FORMATS))


def find_source(path: Path, max_memory: float, suffixes: Iterable[str] | None = None) -> Source:
    """Return the mesh file at a path, after checking that it exists and has a known suffix.

    Args:
        path: The file.
        max_memory: Largest memory for reading it [GB].
        suffixes: Those that can be read; None: those of meshes.

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
    supported = mesh_suffixes() if suffixes is None else frozenset(suffixes)
    if suffix not in supported:
        formats = " ".join(sorted(supported))
        raise MeshError(f"{where}: unsupported format {suffix}: supported are {formats}")
    if not (size := path.stat().st_size):
        raise MeshError(f"{where}: the file is empty; export the mesh again")
    source = Source(path, suffix.removeprefix("."), size, max_memory, where)
    try:
        source.head(1)
    except OSError as error:
        raise MeshError(f"{where}: cannot be opened ({error.strerror})") from error
    return source


def flattened(scene: "trimesh.Scene", where: str) -> tuple[Floats, Ints]:
    """Return vertices (V, 3) and faces (F, 3) of a scene, with the transforms of its parts applied.

    Points and lines are left out.

    Args:
        scene: The scene.
        where: Its name in errors.

    Raises:
        MeshError: A position is not finite, or a face uses a vertex that is not there.
    """
    for part in scene.geometry.values():  # before they are concatenated
        positions = np.asarray(part.vertices, dtype=np.float64)
        check_finite(positions, where)
        corners = np.asarray(getattr(part, "faces", ()), dtype=np.int64).reshape(-1, 3)
        check_corners(corners, len(positions), where, "; export the mesh again")
    mesh = scene.to_mesh()
    vertices = np.asarray(mesh.vertices, dtype=np.float64).reshape(-1, 3)
    faces = np.asarray(mesh.faces, dtype=np.int64).reshape(-1, 3)
    check_finite(vertices, where)
    return vertices, faces


def flattens(world: Floats) -> bool:
    """Whether a transform, shape (4, 4), has a scale of 0 in some directions, but not in all."""
    scales = np.linalg.svd(world[:3, :3], compute_uv=False)
    return bool(scales[0] > 0.0 and scales[2] <= FLAT * scales[0])


def stated_unit(name: str | None) -> tuple[Unit | None, str]:
    """Return the unit of a name such as 'millimeters', and the name if there is no such unit.

    Args:
        name: As a file or another library states it, or None.
    """
    unit = _UNIT_NAMES.get(str(name or "").strip().lower())
    return unit, "" if unit or not name else str(name)
