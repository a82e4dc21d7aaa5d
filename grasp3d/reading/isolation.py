"""A process that reads for this one, with limits on memory and time.

It is started with the first file that needs it, and again after one that it did not survive.
"""

import atexit
import contextlib
import json
import os
import struct
import subprocess
import sys
import threading
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np

import grasp3d
from grasp3d.errors import MeshError
from grasp3d.reading.sources import RawMesh, Source

if TYPE_CHECKING:
    import io

SECONDS = 15.0
"""Time for any file, the start of the process included."""

BYTES_PER_SECOND = 1e6
"""How slowly the slowest reader goes through what a file unpacks to, with a margin of five."""

_LENGTH = struct.Struct("<Q")
_START = """
import importlib, sys, typing
package, *paths = sys.argv[1:]
sys.path.insert(0, package)
import grasp3d
sys.path[:] = sys.path[1:] + [path for path in paths if path not in sys.path[1:]]
from grasp3d.reading.child import main
main()
"""
"""The package is this process's own; no other module may come from its folder, or from the one that
this process works in, before those of Python."""


class _Reader:
    """The process, and what it is asked."""

    def __init__(self) -> None:
        package = str(Path(grasp3d.__file__).parents[1])
        self.process = subprocess.Popen(  # noqa: S603, nothing of a file is in the command
            [sys.executable, *_flags(), "-c", _START, package, *_paths()],
            bufsize=0,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            start_new_session=True,  # Ctrl-C is for us alone
            cwd=package,
        )
        self.requests = cast("io.RawIOBase", self.process.stdin)
        self.answers = cast("io.RawIOBase", self.process.stdout)

    def close(self) -> None:
        """End it."""
        self.process.kill()
        self.leave()
        self.process.wait()

    def leave(self) -> None:
        """Let go of it, as a process must that was forked from the one that asks."""
        self.requests.close()
        self.answers.close()

    def ask(self, request: dict[str, Any], seconds: float) -> tuple[dict[str, Any], bytearray]:
        """Send a request; returns the answer, and the bytes that follow it.

        Raises:
            TimeoutError: It took too long, and was ended.
            EOFError: It ended without an answer.
        """
        late = threading.Event()

        def end() -> None:
            late.set()
            self.process.kill()

        watch = threading.Timer(seconds, end)
        watch.daemon = True
        watch.start()
        try:
            return self._exchanged(request)
        except (OSError, ValueError) as error:
            raise EOFError from error
        finally:
            watch.cancel()
            if late.is_set():
                raise TimeoutError

    def _exchanged(self, request: dict[str, Any]) -> tuple[dict[str, Any], bytearray]:
        left = memoryview(json.dumps(request).encode() + b"\n")
        while left:
            left = left[self.requests.write(left) :]
        (length,) = _LENGTH.unpack(self._received(_LENGTH.size))
        answer: dict[str, Any] = json.loads(self._received(length))
        size = 24 * (answer.get("vertices", 0) + answer.get("faces", 0))
        return answer, self._received(size)

    def _received(self, count: int) -> bytearray:
        data = bytearray(count)
        left = memoryview(data)
        while left:
            got = self.answers.readinto(left)
            if not got:
                raise EOFError
            left = left[got:]
        return data


def _flags() -> list[str]:
    return ["-I"] if sys.flags.isolated else ["-P"]


def _paths() -> list[str]:
    """Where this process finds modules, its working folder left out."""
    with contextlib.suppress(OSError):
        here = os.getcwd()  # noqa: PTH109, compared as text
        return [path for path in sys.path if Path(path).is_absolute() and path != here]
    return []


_lock = threading.Lock()
_reader: _Reader | None = None


def _end() -> None:
    """End the process together with this one."""
    global _reader
    reader, _reader = _reader, None
    if reader is not None:
        reader.close()


def _leave() -> None:
    """Leave the process to the parent after a fork, and begin anew."""
    global _lock, _reader  # noqa: PLW0603
    _lock = threading.Lock()
    if _reader is not None:
        _reader.leave()
        _reader.process.returncode = 0  # it is no child of this process, which must not wait for it
    _reader = None


atexit.register(_end)
if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_leave)


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
    except TimeoutError as error:
        raise _refusal(source, f"took more than {seconds:.0f} s") from error
    except EOFError as error:
        raise _refusal(source, f"{_memory(source)}, or ended its reader") from error
    except OSError as error:
        raise MeshError(
            f"{source.where}: the process that reads it cannot be started ({error.strerror}); "
            "export the mesh as STL or PLY"
        ) from error
    if "memory" in answer:
        raise _refusal(source, _memory(source))
    if "error" in answer:
        raise MeshError(answer["error"])
    split = 24 * answer["vertices"]
    vertices = np.frombuffer(data, np.float64, offset=0, count=split // 8).reshape(-1, 3)
    faces = np.frombuffer(data, np.int64, offset=split).reshape(-1, 3)
    return RawMesh(vertices, faces, source.kind, answer["unit"])


def _answer(source: Source, seconds: float) -> tuple[dict[str, Any], bytearray]:
    """Ask the process, started if needed; whatever goes wrong, the next file gets a new one."""
    global _reader  # noqa: PLW0603
    if _reader is None or _reader.process.poll() is not None:
        _end()
        _reader = _Reader()
    try:
        answer, data = _reader.ask(
            {
                "path": str(source.path.absolute()),
                "where": source.where,
                "kind": source.kind,
                "size": source.size,
                "max_memory": source.max_memory,
                "seconds": seconds + 1.0,
            },
            seconds,
        )
    except BaseException:  # Ctrl-C included: half an answer must not be taken for the next one
        _end()
        raise
    if "memory" in answer:
        _end()
    return answer, data


def _memory(source: Source) -> str:
    return f"took more memory than max_memory, {source.max_memory:g} GB (--max-memory)"


def _refusal(source: Source, why: str) -> MeshError:
    return MeshError(f"{source.where}: reading it {why}; export the mesh again, as STL or PLY")
