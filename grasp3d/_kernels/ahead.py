"""Compile all kernels before they are needed, in several processes.

`python -m grasp3d._kernels.ahead` compiles the kernels that are not compiled yet and prints the
folder in the package that holds their machine code. The build of the package runs it. Only NumPy,
Numba and what this package imports have to be installed. With names of kernels as arguments, it
compiles those kernels in its own process.
"""

import logging
import os
import pkgutil
import signal
import subprocess
import sys
from collections.abc import Sequence
from functools import cache
from importlib import import_module
from itertools import product
from types import UnionType
from typing import Annotated, Any, Union, get_args, get_origin, get_type_hints

from numba.core import types
from numba.extending import as_numba_type

from grasp3d import _kernels
from grasp3d._kernels.compiling import SIGNATURES, announce, code_folders, name_of
from grasp3d.errors import OutputError
from grasp3d.system.context import available_processors

MOST_PROCESSES = 8
"""Each takes about 450 MB, and compiles its own copy of what several kernels call."""


def warmup() -> None:
    """Compile all kernels that are not compiled yet, so that nothing waits for compilation later.

    An installation includes kernels compiled for the processor and the version of Numba that built
    it. Elsewhere each kernel is compiled once, on one processor, when it is first needed. This
    function compiles all of them in advance, on several processors, as do runs over many meshes. It
    logs one line to `grasp3d.compiling`, which goes to standard error if no logging is configured.

    Machine code is read from three folders: that of the package, the one that NUMBA_CACHE_DIR
    names, and the user's cache. It is written to the first of them that is writable.

    Raises:
        OutputError: A compiling process failed.
    """
    names = [name for name, (one, ways) in kernels().items() if not is_compiled(one, ways)]
    if names:
        announce()
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    count = min(available_processors(), MOST_PROCESSES, len(names))
    children = []
    try:
        for start in range(count):
            own = names[start::count]
            # Then the kernels left by other processes, last ones first.
            dealt = own + [name for name in reversed(names) if name not in own]
            words = [sys.executable, "-m", "grasp3d._kernels.ahead", *dealt]
            children.append(subprocess.Popen(words, env=environment))  # noqa: S603, Python
        for child in children:
            if child.wait():
                raise OutputError("the kernels were not compiled: see the lines above")
    finally:  # stops them after an interruption or a failure; otherwise all have ended
        for child in children:
            child.kill()
            child.wait()


def compile_named(names: Sequence[str]) -> None:
    """Compile the named kernels that are still not compiled, without logging it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent process ends this one
    _kernels.compilations.setLevel(logging.ERROR)
    for one, ways in map(kernels().__getitem__, names):
        if not is_compiled(one, ways):
            for way in ways:
                one.compile(way)


@cache
def kernels() -> dict[str, tuple[Any, list[tuple[types.Type, ...]]]]:
    """Kernels that Python calls, each with every combination of argument types used there."""
    names: dict[str, Any] = {}
    for module in pkgutil.walk_packages(_kernels.__path__, f"{_kernels.__name__}."):
        names |= vars(import_module(module.name))
    return {
        name_of(one): (one, list(product(*map(_numba_types, eval(f"({text},)", names)))))  # noqa: S307
        for one, text in SIGNATURES.items()
        if text
    }


def _numba_types(annotation: Any) -> list[Any]:
    """Numba types of an argument, one for each member of an annotated union."""
    union = get_origin(annotation) in (Union, UnionType)
    return list(map(_numba_type, get_args(annotation) if union else [annotation]))


def _numba_type(annotation: Any) -> Any:
    if get_origin(annotation) is Annotated:  # an array
        return annotation.__metadata__[0]
    if hasattr(annotation, "_fields"):
        hints = get_type_hints(annotation, include_extras=True).values()
        return types.BaseTuple.from_types(list(map(_numba_type, hints)), annotation)
    if get_origin(annotation) is tuple:
        return types.BaseTuple.from_types(list(map(_numba_type, get_args(annotation))))
    return as_numba_type(annotation)


def is_compiled(one: Any, ways: Sequence[tuple[types.Type, ...]]) -> bool:
    """Whether one of the folders has machine code of a kernel for each combination of types."""
    one.targetctx.refresh()
    files, codegen = vars(one)["_cache"].files, one.targetctx.codegen()
    return all(any(file.exists() for file in files(way, codegen)) for way in ways)


if __name__ == "__main__":
    if sys.argv[1:]:
        compile_named(sys.argv[1:])
    else:
        warmup()
        print(code_folders()[0])  # noqa: T201
