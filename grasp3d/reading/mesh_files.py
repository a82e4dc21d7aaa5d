"""Reading of mesh files: checks of the declared sizes, then of the content.

Some formats are read in a child process with limits on memory and time. It is started with the
first file that needs it, and again after it was ended.
"""

import json
import os
import struct
import threading
from pathlib import Path
from typing import Any

import numpy as np

from grasp3d.errors import MeshError, MeshUnreadError
from grasp3d.reading.archives import check_archive, check_declarations
from grasp3d.reading.obj_off_stl import check_declared_size
from grasp3d.reading.sources import DIRECT_FORMATS, RawMesh, Source, find_source
from grasp3d.settings import MeshOptions
from grasp3d.system.isolation.failures import CallFailedError, CallFailure
from grasp3d.system.isolation.limits import Limits
from grasp3d.system.isolation.monitoring import send_request
from grasp3d.system.isolation.process import ChildProcess, ProcessPool

_ARCHIVES = ("3mf", "3dxml")

SECONDS = 15.0
"""Time limit of an empty file, including the start of the process [s]."""

BYTES_PER_SECOND = 1e6
"""Speed of the slowest reader in unpacked bytes, with a safety factor of five [bytes/s]."""

_LENGTH = struct.Struct("<Q")

_readers = ProcessPool("grasp3d.reading.child")
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
    seconds = SECONDS + unpacked / BYTES_PER_SECOND
    try:
        with _lock:
            answer, data = _answer(source, seconds)
    except CallFailedError as failure:
        if failure.kind is CallFailure.OUT_OF_TIME:
            reason = f"took more than {seconds:.0f} s"
            raise MeshUnreadError(_message(source, reason)) from failure
        if failure.kind is CallFailure.KILLED:
            raise MeshUnreadError(
                f"{source.where}: the process that reads it {failure}; try again"
            ) from failure
        reason = f"{_over_memory(source)}, or crashed the reader"
        raise MeshError(_message(source, reason)) from failure
    except OSError as error:
        raise MeshUnreadError(
            f"{source.where}: the process that reads it cannot be started ({error.strerror}); "
            "export the mesh as STL or PLY"
        ) from error
    if "memory" in answer:
        raise MeshError(_message(source, _over_memory(source)))
    if "error" in answer:
        raise MeshError(answer["error"])
    split = 24 * answer["vertices"]
    vertices = np.frombuffer(data, np.float64, offset=0, count=split // 8).reshape(-1, 3)
    faces = np.frombuffer(data, np.int64, offset=split).reshape(-1, 3)
    return RawMesh(vertices, faces, source.kind, answer["unit"], answer["unknown_unit"])


def _answer(source: Source, seconds: float) -> tuple[dict[str, Any], bytearray]:
    """Send a request to the child process; after an error the next file gets a new process."""
    request = {
        "path": str(source.path.absolute()),
        "where": source.where,
        "kind": source.kind,
        "size": source.size,
        "max_memory": source.max_memory,
        "seconds": seconds + 1.0,
    }
    reader = _readers.take()
    line = json.dumps(request).encode() + b"\n"
    answer, data = send_request(reader, line, _read_answer, Limits(seconds=seconds))
    if "memory" in answer:
        reader.close()
    else:
        _readers.give_back(reader)
    return answer, data


def _read_answer(reader: ChildProcess) -> tuple[dict[str, Any], bytearray]:
    (length,) = _LENGTH.unpack(reader.receive(_LENGTH.size))
    answer: dict[str, Any] = json.loads(reader.receive(length))
    return answer, reader.receive(24 * (answer.get("vertices", 0) + answer.get("faces", 0)))


def _over_memory(source: Source) -> str:
    return f"took more memory than max_memory, {source.max_memory:g} GB (--max-memory)"


def _message(source: Source, reason: str) -> str:
    return f"{source.where}: reading it {reason}; export the mesh again, as STL or PLY"
