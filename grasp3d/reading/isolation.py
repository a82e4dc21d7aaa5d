"""A process that reads for this one, with limits on memory and time.

It is started with the first file that needs it, and again after one that it did not survive.
"""

import json
import os
import struct
import threading
from typing import Any

import numpy as np

from grasp3d.errors import MeshError, MeshUnreadError
from grasp3d.isolation.limits import Limits
from grasp3d.isolation.losses import Loss, Lost
from grasp3d.isolation.process import Child, Pool
from grasp3d.isolation.watching import ask
from grasp3d.reading.sources import RawMesh, Source

SECONDS = 15.0
"""Time for any file, the start of the process included."""

BYTES_PER_SECOND = 1e6
"""How slowly the slowest reader goes through what a file unpacks to, with a margin of five."""

_LENGTH = struct.Struct("<Q")

_readers = Pool("grasp3d.reading.child")
_lock = threading.Lock()
"""One file at a time: each may take all the memory that is allowed."""


def _renew() -> None:
    """Begin anew after a fork: another thread of the parent may have been reading."""
    global _lock  # noqa: PLW0603
    _lock = threading.Lock()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_renew)


def read_behind_limits(source: Source, unpacked: int) -> RawMesh:
    """Read a file in a process that may take no more than the limits.

    Args:
        source: The file.
        unpacked: Bytes that it unpacks to.

    Raises:
        MeshError: It is damaged, or reading it took more than the limits.
    """
    seconds = SECONDS + unpacked / BYTES_PER_SECOND
    try:
        with _lock:
            answer, data = _answer(source, seconds)
    except Lost as lost:
        if lost.kind is Loss.OUT_OF_TIME:
            raise MeshUnreadError(_told(source, f"took more than {seconds:.0f} s")) from lost
        if lost.kind is Loss.KILLED:
            raise MeshUnreadError(f"{source.where}: its reader {lost}; try again") from lost
        raise MeshError(_told(source, f"{_memory(source)}, or ended its reader")) from lost
    except OSError as error:
        raise MeshUnreadError(
            f"{source.where}: the process that reads it cannot be started ({error.strerror}); "
            "export the mesh as STL or PLY"
        ) from error
    if "memory" in answer:
        raise MeshError(_told(source, _memory(source)))
    if "error" in answer:
        raise MeshError(answer["error"])
    split = 24 * answer["vertices"]
    vertices = np.frombuffer(data, np.float64, offset=0, count=split // 8).reshape(-1, 3)
    faces = np.frombuffer(data, np.int64, offset=split).reshape(-1, 3)
    return RawMesh(vertices, faces, source.kind, answer["unit"])


def _answer(source: Source, seconds: float) -> tuple[dict[str, Any], bytearray]:
    """Ask a process, started if needed; whatever goes wrong, the next file gets a new one."""
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
    answer, data = ask(reader, line, _received, Limits(seconds=seconds))
    if "memory" in answer:
        reader.close()
    else:
        _readers.give_back(reader)
    return answer, data


def _received(reader: Child) -> tuple[dict[str, Any], bytearray]:
    (length,) = _LENGTH.unpack(reader.receive(_LENGTH.size))
    answer: dict[str, Any] = json.loads(reader.receive(length))
    return answer, reader.receive(24 * (answer.get("vertices", 0) + answer.get("faces", 0)))


def _memory(source: Source) -> str:
    return f"took more memory than max_memory, {source.max_memory:g} GB (--max-memory)"


def _told(source: Source, why: str) -> str:
    return f"{source.where}: reading it {why}; export the mesh again, as STL or PLY"
