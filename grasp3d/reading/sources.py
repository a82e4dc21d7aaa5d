"""What reading starts from and ends with: a file to be read, and the surface it holds."""

import re
import stat
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from grasp3d.arrays import Floats, Ints
from grasp3d.errors import MeshError
from grasp3d.settings import Unit
from grasp3d.system.names import printable

TRUSTED = ("stl", "ply", "obj", "off")
"""Formats whose size can be told from a header or from the file's own size; they are read here."""

SUSPECT = ("glb", "gltf", "3mf", "3dxml", "xaml")
"""Formats that can promise or unpack anything; they are read in a process with limits."""

_SIGNS = (
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


@dataclass(frozen=True, eq=False)
class RawMesh:
    """The surface as the file has it."""

    vertices: Floats
    """Shape (V, 3), in the file's own order and unit; of an STL, each place once."""
    faces: Ints
    """Shape (F, 3)."""
    format: str
    """Suffix of the file without its dot, lower case."""
    unit: Unit | None
    """The unit that the file itself declares, if it does."""


@dataclass(frozen=True)
class Source:
    """A mesh file that is there, and what reading it may take."""

    path: Path
    kind: str
    """Its format: the suffix without its dot, in small letters."""
    size: int
    """Bytes of the file."""
    max_memory: float
    """What reading it may take [GB]."""
    where: str
    """How errors call it, on one line."""

    def head(self, count: int = 4096) -> bytes:
        """Its first bytes."""
        with self.path.open("rb") as stream:
            return stream.read(count)

    @property
    def hint(self) -> str:
        """What may be wrong with a file that does not hold what its suffix says."""
        head = self.head()
        seen = next((name for name, sign in _SIGNS if re.match(sign, head)), None)
        if seen is None or seen.lower() == self.kind:
            return "is the file complete, and is its suffix right?"
        return f"its content looks like {seen}: is its suffix right?"


def check_finite(vertices: Floats, where: str) -> None:
    """Refuse positions that are no numbers.

    Raises:
        MeshError: A coordinate is nan or infinite.
    """
    bad = np.flatnonzero(~np.isfinite(vertices).all(axis=1))
    if len(bad):
        raise MeshError(
            f"{where}: vertex {bad[0]} has a coordinate that is not a finite number "
            f"({len(bad)} such vertices); export the mesh again"
        )


def mesh_suffixes() -> frozenset[str]:
    """Return the file suffixes that can be read, such as `.stl`."""
    return frozenset(f".{name}" for name in (*TRUSTED, *SUSPECT))


def find_source(path: Path, max_memory: float) -> Source:
    """Look whether there is a file, and what its suffix says.

    Args:
        path: The file.
        max_memory: What reading it may take [GB].

    Raises:
        MeshError: There is none, it is no file, it is empty, or its suffix is not known.
    """
    where = printable(str(path))
    try:
        status = path.stat()
    except FileNotFoundError as error:
        raise MeshError(f"{where}: there is no such file") from error
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else error
        raise MeshError(f"{where}: cannot be opened ({reason})") from error
    if stat.S_ISDIR(status.st_mode):
        raise MeshError(f"{where}: is a folder, not a mesh file; `grasp3d batch` takes folders")
    if not stat.S_ISREG(status.st_mode):
        raise MeshError(f"{where}: is not a file")
    suffix = path.suffix.lower()
    if not suffix:
        raise MeshError(f"{where}: its name has no suffix that tells the format, such as .stl")
    if suffix not in mesh_suffixes():
        known = " ".join(sorted(mesh_suffixes()))
        raise MeshError(f"{where}: files named *{suffix} are not read; known: {known}")
    if not status.st_size:
        raise MeshError(f"{where}: the file is empty; export the mesh again")
    source = Source(path, suffix.removeprefix("."), status.st_size, max_memory, where)
    try:
        source.head(1)
    except OSError as error:
        raise MeshError(f"{where}: cannot be opened ({error.strerror})") from error
    return source
