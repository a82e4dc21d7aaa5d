"""Compiling all kernels before they are needed, in several processes.

`python -m grasp3d._kernels.ahead` compiles those that are not compiled yet, and prints the folder
of the package with their machine code; the build of the package runs it. Nothing else than NumPy,
Numba and what this package imports has to be installed for it.
"""

import json
import logging
import subprocess
import sys
from collections.abc import Sequence

from grasp3d._kernels import compilations
from grasp3d._kernels.compiling import (
    announce,
    code_folders,
    compiled,
    is_compiled,
    name_of,
)
from grasp3d._kernels.signatures import SIGNATURES
from grasp3d.errors import OutputError
from grasp3d.system.context import available_processors
from grasp3d.system.counts import counted

MOST_PROCESSES = 8
"""Each takes some 450 MB, and compiles again what kernels have in common."""

_CHILD = """
import json, signal, sys
signal.signal(signal.SIGINT, signal.SIG_IGN)  # the process that began this one ends it
sys.path = json.loads(sys.argv[1])
from grasp3d._kernels.ahead import compile_named
compile_named(sys.argv[2:])
"""
"""Program of a process that compiles kernels."""


def warmup() -> tuple[str, ...]:
    """Compile all kernels that are not compiled yet, so that nothing later waits for it.

    An installation brings them compiled for the processor and the version of Numba with which it is
    made. Elsewhere kernels are compiled when they are first needed, once, on one processor; this
    function, and runs over many meshes, compile all of them before, on several. A line about it
    goes to the logger `grasp3d.compiling`: to standard error, where no logging is configured.

    Machine code is read from three folders: that of the package, that which NUMBA_CACHE_DIR names,
    and the user's cache. It is written to the first of them that can be written.

    Returns:
        The names of the kernels that were compiled, as 'MODULE.FUNCTION'; empty: all of them were
        compiled before.

    Raises:
        OutputError: A process that compiles ended before it was done.

    Example:
        >>> from grasp3d._kernels.ahead import warmup
        >>> names = warmup()
        >>> warmup()
        ()
    """
    names = [name_of(one) for one in SIGNATURES if not is_compiled(one, SIGNATURES[one])]
    if names:
        announce(counted(len(names), "kernels"))
        compiled.extend(names)
    count = min(available_processors(), MOST_PROCESSES, len(names))
    children = []
    try:
        for start in range(count):  # those that take longest come first: they are dealt to and fro
            dealt = names[start :: 2 * count] + names[2 * count - 1 - start :: 2 * count]
            words = [sys.executable, "-c", _CHILD, json.dumps(sys.path), *dealt]
            children.append(subprocess.Popen(words))  # noqa: S603, this interpreter
        for child in children:
            if child.wait():
                raise OutputError(
                    f"kernels were not compiled: a process ended with code {child.returncode}; see "
                    "its lines above"
                )
    finally:  # after an interruption or a failure; else all have ended
        for child in children:
            child.kill()
            child.wait()
    return tuple(names)


def compile_named(names: Sequence[str]) -> None:
    """Compile the kernels of such names, without a word."""
    compilations.setLevel(logging.ERROR)
    for one in SIGNATURES:
        if name_of(one) in names:
            for signature in SIGNATURES[one]:
                one.compile(signature)


if __name__ == "__main__":
    warmup()
    print(code_folders()[0])  # noqa: T201
