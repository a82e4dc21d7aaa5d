"""Compiling all kernels before they are needed, in several processes.

`python -m grasp3d._kernels.ahead` compiles those that are not compiled yet, and prints the folder
of the package with their machine code; the build of the package runs it. Nothing else than NumPy,
Numba and what this package imports has to be installed for it. With names of kernels it compiles
these, in this process.
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
"""Each takes some 450 MB, and compiles again what kernels have in common."""


def warmup() -> None:
    """Compile all kernels that are not compiled yet, so that nothing later waits for it.

    An installation brings them compiled for the processor and the version of Numba with which it is
    made. Elsewhere kernels are compiled when they are first needed, once, on one processor; this
    function, and runs over many meshes, compile all of them before, on several. A line about it
    goes to the logger `grasp3d.compiling`: to standard error, where no logging is configured.

    Machine code is read from three folders: that of the package, that which NUMBA_CACHE_DIR names,
    and the user's cache. It is written to the first of them that can be written.

    Raises:
        OutputError: A process that compiles ended before it was done.
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
            # Then what others have left, from its end.
            dealt = own + [name for name in reversed(names) if name not in own]
            words = [sys.executable, "-m", "grasp3d._kernels.ahead", *dealt]
            children.append(subprocess.Popen(words, env=environment))  # noqa: S603, Python
        for child in children:
            if child.wait():
                raise OutputError("the kernels were not compiled: see the lines above")
    finally:  # after an interruption or a failure; else all have ended
        for child in children:
            child.kill()
            child.wait()


def compile_named(names: Sequence[str]) -> None:
    """Compile the kernels of such names that are not compiled meanwhile, without a word."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the process that began this one ends it
    _kernels.compilations.setLevel(logging.ERROR)
    for one, ways in map(kernels().__getitem__, names):
        if not is_compiled(one, ways):
            for way in ways:
                one.compile(way)


@cache
def kernels() -> dict[str, tuple[Any, list[tuple[types.Type, ...]]]]:
    """Kernels that Python calls, with the types of the arguments in every way that it does."""
    names: dict[str, Any] = {}
    for module in pkgutil.walk_packages(_kernels.__path__, f"{_kernels.__name__}."):
        names |= vars(import_module(module.name))
    return {
        name_of(one): (one, list(product(*map(_numba_types, eval(f"({text},)", names)))))  # noqa: S307
        for one, text in SIGNATURES.items()
        if text
    }


def _numba_types(annotation: Any) -> list[Any]:
    """Types of an argument in every way that it is annotated."""
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
    """Whether one of the folders has machine code of a kernel for all types of arguments."""
    one.targetctx.refresh()
    files, codegen = vars(one)["_cache"].files, one.targetctx.codegen()
    return all(any(file.exists() for file in files(way, codegen)) for way in ways)


if __name__ == "__main__":
    if sys.argv[1:]:
        compile_named(sys.argv[1:])
    else:
        warmup()
        print(code_folders()[0])  # noqa: T201
