"""Reading of mesh files: glTF and 3MF by trimesh, whose parts are counted, all others here."""

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from grasp3d.arrays import Floats, Ints, first_at_position
from grasp3d.errors import MeshError
from grasp3d.mesh.reading.polygon_files import read_obj, read_off, read_ply
from grasp3d.mesh.reading.scenes import read_3mf, read_gltf
from grasp3d.mesh.reading.sources import RawMesh, Source, find_source
from grasp3d.system.limited_reading import read_file
from grasp3d.system.names import reason_of

_STL_HEADER = 84
"""Size of the header of a binary STL, which ends with the number of faces [bytes]."""

_STL_FACE = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])


def read_mesh(path: Path) -> RawMesh:
    """Read a mesh file; a scene becomes one mesh, with the transforms of its parts applied.

    Args:
        path: The file.

    Raises:
        MeshError: There is no such file, its format is unknown, it is damaged, or has no triangles.
        FileUnreadError: Reading is limited, and it exceeded a limit.
    """
    return read_file(_read, path)


def _read(path: Path) -> RawMesh:
    source = find_source(path)
    try:
        vertices, faces, *stated = READERS[source.kind](source)
    except (MeshError, MemoryError):
        raise
    except Exception as error:  # trimesh raises errors of any class
        is_obscure = isinstance(error, LookupError | TypeError | AttributeError | AssertionError)
        reason = "its parts do not fit together" if is_obscure else reason_of(error)
        raise source.unexpected(f"cannot be read as {source.kind.upper()} ({reason})") from error
    return RawMesh(vertices, faces, source.kind, next(iter(stated), None), path.name, path)


def _read_stl(source: Source) -> tuple[Floats, Ints]:
    """Vertices (V, 3), each position once, and faces (F, 3) of an STL."""
    data = source.path.read_bytes()
    count = int.from_bytes(data[_STL_HEADER - 4 : _STL_HEADER], "little")
    if 0 < count <= (len(data) - _STL_HEADER) // _STL_FACE.itemsize:
        corners = np.frombuffer(data, _STL_FACE, count, _STL_HEADER)["corners"].reshape(-1, 3)
    else:
        text, ends = re.subn(rb"(?m)^\s*endsolid.*", b"", data.lower().replace(b"\r", b"\n"))
        text = re.sub(rb"(?m)^\s*solid.*", b"", text)  # names may be words of the format
        words = re.findall(rb"vertex\s+(\S+)\s+(\S+)\s+(\S+)", text)
        corners, count = np.array(words, dtype=np.float64), text.count(b"endfacet")
        if not (ends and count) or len(words) != 3 * count:
            raise source.unexpected(
                "cannot be read as STL: its triangles are complete neither in binary nor as text"
            )
    first, faces = np.unique(first_at_position(corners), return_inverse=True)
    return corners[first].astype(np.float64), faces.reshape(-1, 3)


READERS: dict[str, Callable[[Source], tuple[Any, ...]]] = {
    "3mf": read_3mf,
    "glb": read_gltf,
    "gltf": read_gltf,
    "obj": read_obj,
    "off": read_off,
    "ply": read_ply,
    "stl": _read_stl,
}
