"""Compiling all kernels before they are needed, in several processes.

    python -m grasp3d._kernels.compiling.ahead

compiles those that are not compiled yet, and prints the files with the machine code of all of them
in the package's own folder. The build of the package runs it; nothing else than NumPy, Numba and
what this package imports has to be installed for it.
"""

import inspect
import json
import logging
import signal
import subprocess
import sys
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from typing import Any

from grasp3d._kernels.compiling.machine_code import can_be_stored, code_folders
from grasp3d._kernels.compiling.numba_internals import is_compiled
from grasp3d.errors import OutputError
from grasp3d.system.compiling import compilations, logger
from grasp3d.system.context import available_processors

MOST_PROCESSES = 8
"""Each takes some 450 MB, and compiles again what kernels have in common."""

_CHILD = """
import json, sys
sys.path = json.loads(sys.argv[1])
from grasp3d._kernels.compiling.ahead import serve
serve()
"""
"""Program of a process that compiles the kernels whose names it reads."""


def kernels() -> dict[str, Any]:
    """The kernels that Python calls, by their names, those first that take longest."""
    from grasp3d._kernels.signatures import SIGNATURES

    return {name_of(kernel): kernel for kernel in SIGNATURES}


def name_of(kernel: Any) -> str:
    """The name of a kernel as MODULE.FUNCTION."""
    function = inspect.unwrap(kernel)
    return f"{function.__module__.rpartition('.')[2]}.{function.__qualname__}"


def missing() -> list[str]:
    """Names of the kernels that are not compiled yet, for this processor and version of Numba."""
    from grasp3d._kernels.signatures import SIGNATURES

    return [name for name, one in kernels().items() if not is_compiled(one, SIGNATURES[one])]


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
        >>> from grasp3d._kernels.compiling.ahead import warmup
        >>> compiled = warmup()
        >>> warmup()
        ()
    """
    names = missing()
    if names:
        with compilations.several(names, stored=can_be_stored()) as begin:
            _share(names, begin)
    return tuple(names)


def _share(names: list[str], begin: Callable[[str], None]) -> None:
    """Compile kernels in several processes, each of which takes the next one when it is ready."""
    left, children = deque(names), list[subprocess.Popen[bytes]]()

    def work() -> None:
        words = [sys.executable, "-c", _CHILD, json.dumps(sys.path)]
        with subprocess.Popen(  # noqa: S603, this interpreter
            words, bufsize=0, stdin=subprocess.PIPE, stdout=subprocess.PIPE
        ) as child:
            assert child.stdin is not None
            assert child.stdout is not None
            children.append(child)
            while name := _next(left):
                begin(name)
                with suppress(BrokenPipeError):
                    child.stdin.write(f"{name}\n".encode())
                if not child.stdout.readline():
                    raise OutputError(
                        f"kernel {name} was not compiled: the process ended with code "
                        f"{child.wait()}; see its lines above"
                    )

    count = min(available_processors(), MOST_PROCESSES, len(names))
    with ThreadPoolExecutor(count) as threads:
        try:
            for done in [threads.submit(work) for _ in range(count)]:
                done.result()
        finally:  # after an interruption or a failure; else all have ended
            left.clear()
            for child in children:
                child.kill()


def _next(names: deque[str]) -> str | None:
    """Take the first name; None: there is none left."""
    try:
        return names.popleft()
    except IndexError:
        return None


def serve() -> None:
    """Compile the kernels whose names are read, and print each name when that is done."""
    from grasp3d._kernels.signatures import SIGNATURES

    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the process that began this one ends it
    logger.setLevel(logging.ERROR)
    by_name = kernels()
    for line in sys.stdin:
        kernel = by_name[line.strip()]
        for signature in SIGNATURES[kernel]:
            kernel.compile(signature)
        print(line, end="", flush=True)  # noqa: T201


def files() -> Iterator[str]:
    """Paths of the files with the machine code of all kernels in the package's own folder."""
    folder = code_folders()[0]
    for name, kernel in kernels().items():
        line = inspect.unwrap(kernel).__code__.co_firstlineno
        yield from map(str, sorted(folder.glob(f"{name}-{line}.*.nb?")))


if __name__ == "__main__":
    warmup()
    for file in files():
        print(file)  # noqa: T201
