"""Reading of mesh files: checks of the declared sizes, then of the content.

Some formats are read in a child process with limits on memory and time, where trimesh parses what
passed the checks.
"""

import io
import logging
import os
import threading
import warnings
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from grasp3d.errors import MeshError, MeshUnreadError
from grasp3d.reading.archives import check_archive, check_declarations, count_parts
from grasp3d.reading.gltf import read_gltf
from grasp3d.reading.obj_off_stl import check_declared_size, read_obj, read_off, read_stl
from grasp3d.reading.ply import read_ply
from grasp3d.reading.sources import (
    DIRECT_FORMATS,
    RawMesh,
    Source,
    check_corners,
    check_finite,
    find_source,
    flattened,
    stated_unit,
)
from grasp3d.settings import MeshOptions
from grasp3d.system.isolation import CallFailedError, CallFailure, call

if TYPE_CHECKING:
    import trimesh

# Without a handler, Python prints the messages of trimesh's logger to the terminal.
logging.getLogger("trimesh").addHandler(logging.NullHandler())

_ARCHIVES = ("3mf", "3dxml")

SECONDS = 15.0
"""Time limit of an empty file, including the start of the process [s]."""

BYTES_PER_SECOND = 1e6
"""Speed of the slowest reader in unpacked bytes, with a safety factor of five [bytes/s]."""

_child_lock = threading.Lock()
"""One file at a time in a child process, since each may take all the memory that is allowed."""


def _reset_lock() -> None:
    """Create a new lock after a fork, since a thread of the parent may have held the old one."""
    global _child_lock  # noqa: PLW0603
    _child_lock = threading.Lock()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_reset_lock)


def read_mesh(path: Path, *, max_memory: float = MeshOptions.max_memory) -> RawMesh:
    """Read a mesh file; a scene becomes one mesh, with the transforms of its parts applied.

    STL, PLY, OBJ and OFF are read in this process, since the file size limits the memory and time
    that they need. Other formats are read in a child process with limits on memory and time.

    Args:
        path: The file.
        max_memory: Largest memory for reading it [GB].

    Raises:
        MeshError: There is no such file, its format is unknown, it is damaged, it exceeds a limit,
            it refers to files outside its folder, or it has no triangles.
    """
    source = find_source(path, max_memory)
    try:
        check_declared_size(source)
        return _read(source)
    except MemoryError as error:
        raise source.error(
            "reading it needs more memory than is available; simplify the mesh"
        ) from error


def _read(source: Source) -> RawMesh:
    if source.kind in _ARCHIVES:
        return _read_in_child(source, check_archive(source))
    if source.kind == "xaml":
        with source.path.open("rb") as stream:
            check_declarations(source, stream)
    if source.kind not in DIRECT_FORMATS:
        return _read_in_child(source, source.size)
    return parse(source)


def _read_in_child(source: Source, unpacked: int) -> RawMesh:
    """Read a file in a child process with limits on memory and time.

    The process is no boundary of security: what it answers is unpickled.

    Args:
        source: The file.
        unpacked: Its unpacked size [bytes].

    Raises:
        MeshError: It is damaged, or reading it exceeded a limit.
    """
    seconds = SECONDS + unpacked / BYTES_PER_SECOND
    absolute = replace(source, path=source.path.absolute())
    too_much = f"took more memory than max_memory, {source.max_memory:g} GB (--max-memory)"
    kind, reason = MeshError, f"{too_much}, or crashed the reader"
    try:
        with _child_lock:
            return call(parse, absolute, memory=source.max_memory, seconds=seconds)
    except RecursionError as error:
        raise source.damaged("its parts are nested in a cycle or too deeply") from error
    except MeshError as error:
        raise type(error)(str(error)) from None  # without the traceback of the child
    except CallFailedError as failure:
        if failure.kind is CallFailure.KILLED:
            raise MeshUnreadError(
                f"{source.where}: the process that reads it {failure}; try again, or export the "
                "mesh as STL or PLY"
            ) from failure
        if failure.kind is CallFailure.OUT_OF_TIME:
            kind, reason = MeshUnreadError, f"took more than {seconds:.0f} s"
        elif failure.kind is CallFailure.OUT_OF_MEMORY:
            reason = too_much
        raise kind(
            f"{source.where}: reading it {reason}; export the mesh again, as STL or PLY"
        ) from failure


def parse(source: Source) -> RawMesh:
    """Read a file of a known format; a scene becomes one mesh, with transforms applied.

    Raises:
        MeshError: It is damaged, or has no triangles.
    """
    try:
        if read := _READERS.get(source.kind):
            vertices, faces = read(source)
            declared = "m" if read is read_gltf else None
            check_finite(vertices, source.where)
            check_corners(faces, len(vertices), source.where, "; export the mesh again")
        else:
            scene = _parsed(source)
            vertices, faces = flattened(scene, source.where)
            declared = scene.units
    except (MeshError, MemoryError, RecursionError):
        raise
    except Exception as error:  # each reader raises its own classes of errors
        if source.kind in {"glb", "gltf"}:
            raise source.damaged("its nodes, meshes and buffers do not fit together") from error
        reason = " ".join(str(error).split()) or "its content is not as expected"
        if isinstance(error, KeyError):
            reason += " is missing"
        raise source.unexpected(
            f"cannot be read as {source.kind.upper()} ({reason[:200]})"
        ) from error
    if len(faces) == 0:
        raise source.error(
            f"holds no triangles; is it a complete {source.kind.upper()} file "
            "with a surface (not a point cloud, a drawing or another format renamed)?"
        )
    return RawMesh(vertices, faces, source.kind, *stated_unit(declared))


_READERS = {
    "stl": read_stl, "ply": read_ply, "obj": read_obj, "off": read_off, "gltf": read_gltf,
    "glb": read_gltf,
}  # fmt: skip
"""Readers of their own; trimesh reads the other formats."""


def _parsed(source: Source) -> "trimesh.Scene":
    """What trimesh reads of a file."""
    with warnings.catch_warnings():
        # These warnings mean damaged files: incomplete or invalid numbers. Other warnings are
        # about trimesh itself.
        warnings.filterwarnings("error", "string or file could not be read", DeprecationWarning)
        warnings.filterwarnings("error", category=RuntimeWarning, module="trimesh")
        if source.kind == "3mf":
            return _parsed_3mf(source)
        return _scene(source, source.path.read_bytes())


def _parsed_3mf(source: Source) -> "trimesh.Scene":
    declared = count_parts(source)
    if not declared:
        import trimesh

        return trimesh.Scene()
    scene = _scene(source, source.path.read_bytes(), postprocess=False)
    count = len(scene.graph.nodes_geometry)
    if count != declared:
        raise source.error(
            f"contains {declared:,} copies of its parts, of which {count:,} can be "
            "read; export it without nested parts, or as STL"
        )
    return scene


def _scene(source: Source, data: bytes, **options: Any) -> "trimesh.Scene":
    import trimesh  # not where a child process reads

    return trimesh.load_scene(io.BytesIO(data), file_type=source.kind, process=False, **options)
