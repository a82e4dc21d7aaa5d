"""Reading of mesh files: OBJ, OFF and PLY by `polygon_files`, all others by trimesh.

What trimesh leaves out without a word is found by comparing what it reads with what the file
declares.
"""

import re
from pathlib import Path

import numpy as np

from grasp3d.arrays import Floats, Ints, first_at_position
from grasp3d.errors import MeshError
from grasp3d.reading.gltf import read_gltf
from grasp3d.reading.polygon_files import read_obj, read_off, read_ply
from grasp3d.reading.scenes import flattened, load_scene
from grasp3d.reading.sources import (
    RawMesh,
    Source,
    check_corners,
    check_finite,
    find_source,
    stated_unit,
)
from grasp3d.reading.three_mf import triangles_of_3mf
from grasp3d.system.limited_reading import read_file
from grasp3d.system.names import reason_of

_POLYGONS = {"obj": read_obj, "off": read_off, "ply": read_ply}

_STL_HEADER, _STL_FACE = 84, 50
"""Size of the header, and of a face, of a binary STL [bytes]."""


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
        vertices, faces, unit = _surface(source)
        check_finite(vertices, source.where)
        check_corners(faces, len(vertices), source.where, "; export the mesh again")
    except (MeshError, MemoryError):
        raise
    except RecursionError as error:
        raise source.damaged("its parts are nested in a cycle or too deeply") from error
    except Exception as error:  # trimesh raises errors of any class
        reason = reason_of(error)
        if isinstance(error, LookupError | TypeError | AttributeError | AssertionError):
            reason = "its parts do not fit together"
        raise source.unexpected(f"cannot be read as {source.kind.upper()} ({reason})") from error
    if len(faces) == 0:
        raise source.error(
            f"holds no triangles; is it a complete {source.kind.upper()} file "
            "with a surface (not a point cloud, a drawing or another format renamed)?"
        )
    return RawMesh(vertices, faces, source.kind, *stated_unit(unit))


def _surface(source: Source) -> tuple[Floats, Ints, str | None]:
    """Vertices (V, 3), faces (F, 3) and unit of a file."""
    if source.kind in _POLYGONS:
        return *_POLYGONS[source.kind](source), None
    if source.kind == "stl":
        return *_of_stl(source), None
    if source.kind in {"glb", "gltf"}:
        return *read_gltf(source), "m"
    if source.kind != "3mf":
        scene = load_scene(source, source.path.read_bytes())
        return *flattened(scene, source.where), scene.units
    declared = triangles_of_3mf(source.path)
    if not declared:
        return np.empty((0, 3)), np.empty((0, 3), dtype=np.int64), None
    scene = load_scene(source, source.path.read_bytes(), postprocess=False)
    vertices, faces = flattened(scene, source.where)
    if len(faces) != declared:
        raise source.error(
            f"declares {declared:,} triangles, of which {len(faces):,} can be read; export it as "
            "one model without nested parts, or as STL"
        )
    return vertices, faces, scene.units


def _of_stl(source: Source) -> tuple[Floats, Ints]:
    """Vertices (V, 3), each position once, and faces (F, 3) of an STL."""
    data, head = source.path.read_bytes(), source.head(_STL_HEADER)
    declared = int.from_bytes(head[80:], "little")
    available = (source.size - _STL_HEADER) // _STL_FACE
    # Text begins with `solid`, but binary headers may do so as well.
    is_text = head.lstrip()[:5].lower() == b"solid" and b"facet" in source.head().lower()
    if 0 < declared <= available:
        data = data[: _STL_HEADER + declared * _STL_FACE]  # trimesh reads none with more
    elif is_text or not any(byte < 9 or 13 < byte < 32 for byte in head):
        data = data.lower() if b"\n" in data else data.lower().replace(b"\r", b"\n")
        data = re.sub(rb"solid[^\n]*", b"solid", data)  # names may be words of the format
        declared = data.count(b"endfacet")
    else:
        raise source.incomplete(f"declares {declared:,} faces, but contains {max(available, 0):,}")
    if not declared:
        raise source.unexpected("cannot be read as STL: it holds no triangles")
    corners, faces = flattened(load_scene(source, data), source.where)
    if len(faces) != declared:
        raise source.unexpected(
            f"cannot be read as STL: of {declared:,} triangles {len(faces):,} are complete"
        )
    first, numbers = np.unique(first_at_position(corners[faces.ravel()]), return_inverse=True)
    return corners[faces.ravel()][first], numbers.reshape(-1, 3)
