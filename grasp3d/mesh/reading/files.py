"""Reading mesh files: any format of trimesh in, plain vertex and face arrays out."""

import io
import re
import stat
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import trimesh

from grasp3d.arrays import Floats, Ints
from grasp3d.errors import MeshError
from grasp3d.mesh.measures import first_at_place
from grasp3d.settings import MeshOptions, Unit

_UNIT_NAMES: dict[str, Unit] = {
    "m": "m", "meter": "m", "meters": "m", "metre": "m", "metres": "m",
    "cm": "cm", "centimeter": "cm", "centimeters": "cm",
    "mm": "mm", "millimeter": "mm", "millimeters": "mm",
    "in": "in", "inch": "in", "inches": "in",
}  # fmt: skip


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


def mesh_suffixes() -> frozenset[str]:
    """Return the file suffixes that can be read, such as `.stl`."""
    return frozenset(f".{name}" for name in trimesh.exchange.load.mesh_formats() - {"stl_ascii"})


def read_mesh(path: Path, *, max_memory: float = MeshOptions.max_memory) -> RawMesh:
    """Read a mesh file; a scene becomes one mesh, each part where its transform puts it.

    Args:
        path: A file in any format that trimesh reads.
        max_memory: What reading it may take [GB].

    Raises:
        MeshError: There is no such file, its format is not known, it is damaged, or it holds no
            triangles.
    """
    _ = max_memory
    kind = _checked_kind(path)
    try:
        data = path.read_bytes()
    except OSError as error:
        raise MeshError(f"{path}: cannot be opened ({error.strerror})") from error
    if not data:
        raise MeshError(f"{path}: the file is empty; export the mesh again")
    try:
        scene = _parsed(path, kind, data)
    except MemoryError:
        raise
    except Exception as error:  # every reader behind this door raises kinds of its own
        reason = " ".join(str(error).split()) or type(error).__name__
        raise MeshError(
            f"{path}: cannot be read as {kind.upper()} ({reason}); "
            "is the file complete, and is its suffix right?"
        ) from error
    return _flattened(path, kind, scene)


def _checked_kind(path: Path) -> str:
    try:
        mode = path.stat().st_mode
    except FileNotFoundError as error:
        raise MeshError(f"{path}: there is no such file") from error
    except OSError as error:
        raise MeshError(f"{path}: cannot be opened ({error.strerror})") from error
    if stat.S_ISDIR(mode):
        raise MeshError(f"{path}: is a folder, not a mesh file; `grasp3d batch` takes folders")
    if not stat.S_ISREG(mode):
        raise MeshError(f"{path}: is not a file")
    suffix = path.suffix.lower()
    if not suffix:
        raise MeshError(f"{path}: its name has no suffix that tells the format, such as .stl")
    if suffix not in mesh_suffixes():
        known = " ".join(sorted(mesh_suffixes()))
        raise MeshError(f"{path}: files named *{suffix} are not read; known: {known}")
    return suffix.removeprefix(".")


def _parsed(path: Path, kind: str, data: bytes) -> trimesh.Scene:
    if kind == "obj":
        data = _geometry_of_obj(data)
        return trimesh.load_scene(
            io.BytesIO(data),
            file_type=kind,
            process=False,
            maintain_order=True,
            skip_materials=True,
        )
    # A glTF's buffers lie beside it, so its reader needs the path; the others need bytes only.
    source = str(path) if kind == "gltf" else io.BytesIO(data)
    return trimesh.load_scene(source, file_type=kind, process=False)


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


def _flattened(path: Path, kind: str, scene: trimesh.Scene) -> RawMesh:
    for part in scene.geometry.values():
        check_finite(np.asarray(part.vertices, dtype=np.float64), str(path))
    try:
        mesh = scene.to_mesh()
        vertices = np.asarray(mesh.vertices, dtype=np.float64).reshape(-1, 3)
        faces = np.asarray(mesh.faces, dtype=np.int64).reshape(-1, 3)
    except (ValueError, IndexError) as error:
        raise MeshError(f"{path}: its parts cannot be joined to one mesh ({error})") from error
    if len(faces) == 0:
        raise MeshError(
            f"{path}: holds no triangles; is it a complete {kind.upper()} file with a surface "
            "(not a point cloud, a drawing or another format renamed)?"
        )
    if kind == "stl":  # every face brings its own three vertices: keep the first at each place
        first, faces = np.unique(first_at_place(vertices)[faces], return_inverse=True)
        vertices, faces = vertices[first], faces.reshape(-1, 3)
    declared = "m" if kind in {"glb", "gltf"} else str(scene.units or "").lower()
    return RawMesh(vertices, faces, kind, _UNIT_NAMES.get(declared))


def _geometry_of_obj(data: bytes) -> bytes:
    """Keep the positions and faces of an OBJ, so that its reader keeps the order of vertices.

    Texture coordinates and normals would make the reader split and reorder vertices; materials
    and groups would make it part the mesh and open other files.
    """
    data = re.sub(rb"\\\r?\n", b" ", data)
    kept: list[bytes] = []
    count = 0
    for line in data.splitlines():
        words = line.split()
        if not words:
            continue
        if words[0] == b"v":
            count += 1
            kept.append(b" ".join(words[:4]))
        elif words[0] == b"f":
            kept.append(b" ".join([b"f", *(_absolute(word, count) for word in words[1:])]))
    return b"\n".join(kept)


def _absolute(corner: bytes, count: int) -> bytes:
    """Position index of a face's corner `v/vt/vn`, counted from the file's start."""
    index = corner.split(b"/", 1)[0]
    return b"%d" % (count + 1 + int(index)) if index.startswith(b"-") else index
