"""Main loop of the child process that reads files of formats without a size limit.

A request is a line of JSON on standard input; an answer is the length of a JSON text, that text,
and the bytes of the arrays. The process ends when its input ends.
"""

import contextlib
import gc
import json
import math
import os
import signal
import struct
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any, BinaryIO

with contextlib.suppress(ImportError):  # Windows has no resource limits
    import resource

from grasp3d.errors import MeshError
from grasp3d.reading.parsing import parse
from grasp3d.reading.sources import Source

LENGTH = struct.Struct("<Q")
"""Format of the length that precedes each answer."""


def main() -> None:
    """Answer requests until the input ends."""
    # Text printed by readers must not become part of the answers.
    answers = os.fdopen(os.dup(1), "wb")
    null = os.open(os.devnull, os.O_WRONLY)
    os.dup2(null, 1)
    if hasattr(signal, "SIGALRM"):
        signal.signal(signal.SIGALRM, signal.SIG_DFL)  # the parent may ignore the signal
    gc.freeze()  # later collections skip the modules loaded so far
    for line in sys.stdin.buffer:
        _answer(json.loads(line), answers)
        gc.collect()


def _answer(request: Mapping[str, Any], answers: BinaryIO) -> None:
    where = request["where"]
    source = Source(
        Path(request["path"]), request["kind"], request["size"], request["max_memory"], where
    )
    _limit(source.max_memory)
    _end_after(request["seconds"])
    try:
        raw = parse(source)
        arrays = (raw.vertices.tobytes(), raw.faces.tobytes())
    except (MeshError, OSError) as error:
        _write(answers, {"error": str(error)})
        return
    except RecursionError:
        message = f"{where}: its parts are nested in a cycle or too deeply; export the mesh again"
        _write(answers, {"error": message})
        return
    except MemoryError:
        _write(answers, {"memory": True})
        return
    head = {
        "vertices": len(raw.vertices),
        "faces": len(raw.faces),
        "unit": raw.unit,
        "unknown_unit": raw.unknown_unit,
    }
    _write(answers, head, *arrays)


def _write(answers: BinaryIO, head: Mapping[str, object], *arrays: bytes) -> None:
    _end_after(0.0)
    text = json.dumps(head).encode()
    answers.writelines([LENGTH.pack(len(text)), text, *arrays])
    answers.flush()


def _end_after(seconds: float) -> None:
    """End this process after a time, even if its parent is gone; 0: never."""
    if hasattr(signal, "alarm"):
        signal.alarm(math.ceil(seconds))


def _limit(memory: float) -> None:
    """Limit the memory of this process to an amount above its current memory [GB]."""
    with contextlib.suppress(NameError, OSError, ValueError):
        pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0])
        limit = pages * os.sysconf("SC_PAGE_SIZE") + int(memory * 1e9)
        _, hard = resource.getrlimit(resource.RLIMIT_AS)
        resource.setrlimit(resource.RLIMIT_AS, (limit, hard))
