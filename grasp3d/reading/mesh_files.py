"""Reading of mesh files: checks of the declared sizes, then of the content.

Some formats are read in a child process with limits on memory and time.
"""

import os
import threading
from dataclasses import replace
from pathlib import Path

from grasp3d.errors import MeshError, MeshUnreadError
from grasp3d.reading.archives import check_archive, check_declarations
from grasp3d.reading.obj_off_stl import check_declared_size
from grasp3d.reading.sources import DIRECT_FORMATS, RawMesh, Source, find_source
from grasp3d.settings import MeshOptions
from grasp3d.system.isolation import CallFailedError, CallFailure, call

_ARCHIVES = ("3mf", "3dxml")

SECONDS = 15.0
"""Time limit of an empty file, including the start of the process [s]."""

BYTES_PER_SECOND = 1e6
"""Speed of the slowest reader in unpacked bytes, with a safety factor of five [bytes/s]."""

_lock = threading.Lock()
"""One file at a time, since each may take all the memory that is allowed."""


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
    from grasp3d.reading.parsing import parse

    return parse(source)


def _reset_lock() -> None:
    """Create a new lock after a fork, since a thread of the parent may have held the old one."""
    global _lock  # noqa: PLW0603
    _lock = threading.Lock()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_reset_lock)


def _read_in_child(source: Source, unpacked: int) -> RawMesh:
    """Read a file in a child process with limits on memory and time.

    Args:
        source: The file.
        unpacked: Its unpacked size [bytes].

    Raises:
        MeshError: It is damaged, or reading it exceeded a limit.
    """
    from grasp3d.reading.parsing import parse_limited

    seconds = SECONDS + unpacked / BYTES_PER_SECOND
    absolute = replace(source, path=source.path.absolute())
    too_much = f"took more memory than max_memory, {source.max_memory:g} GB (--max-memory)"
    kind, reason = MeshError, f"{too_much}, or crashed the reader"
    try:
        with _lock:
            return call(parse_limited, absolute, seconds=seconds)
    except RecursionError as error:
        raise source.damaged("its parts are nested in a cycle or too deeply") from error
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
