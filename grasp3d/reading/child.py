"""The process that reads files which could take anything.

It answers each line of JSON on its standard input with the length of a text of JSON, that text,
and the arrays' bytes, and ends with its input.
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

with contextlib.suppress(ImportError):  # Windows knows no limits
    import resource

from grasp3d.errors import MeshError
from grasp3d.reading.parsing import parse
from grasp3d.reading.sources import Source

LENGTH = struct.Struct("<Q")
"""How the length of an answer is written."""


def main() -> None:
    """Answer requests until there are no more."""
    # Whatever readers print must not get into the answers.
    answers = os.fdopen(os.dup(1), "wb")
    quiet = os.open(os.devnull, os.O_WRONLY)
    os.dup2(quiet, 1)
    if hasattr(signal, "SIGALRM"):
        signal.signal(signal.SIGALRM, signal.SIG_DFL)  # the parent may ignore it
    gc.freeze()  # what is loaded by now need not be looked through after each file
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
        told = f"{where}: its parts go in circles, or too deep; export the mesh again"
        _write(answers, {"error": told})
        return
    except MemoryError:
        _write(answers, {"memory": True})
        return
    head = {"vertices": len(raw.vertices), "faces": len(raw.faces), "unit": raw.unit}
    _write(answers, head, *arrays)


def _write(answers: BinaryIO, head: Mapping[str, object], *arrays: bytes) -> None:
    _end_after(0.0)
    text = json.dumps(head).encode()
    answers.writelines([LENGTH.pack(len(text)), text, *arrays])
    answers.flush()


def _end_after(seconds: float) -> None:
    """End this process when the time is up, even if nobody is left to end it; 0: never."""
    if hasattr(signal, "alarm"):
        signal.alarm(math.ceil(seconds))


def _limit(memory: float) -> None:
    """Let this process take so much memory more than it has now [GB]."""
    with contextlib.suppress(NameError, OSError, ValueError):
        pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0])
        most = pages * os.sysconf("SC_PAGE_SIZE") + int(memory * 1e9)
        _, hard = resource.getrlimit(resource.RLIMIT_AS)
        resource.setrlimit(resource.RLIMIT_AS, (most, hard))
