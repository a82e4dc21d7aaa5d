"""Compile kernels with Numba, cache their machine code, and define the types of their arrays.

**Parts** are functions that are compiled only into the kernels that call them. For other functions
Numba optimises the code, generates machine code and a wrapper for Python, and then repeats this for
each caller, which contains the function. A part is only typed and lowered; it is optimised within
the kernel that Python calls.

The array types serve both as annotations and as the types that Numba compiles for.

The number at the end of a name is the number of dimensions; arrays are C-contiguous. Names that
begin with Fixed stand for read-only arrays, such as those of a mesh and of contacts, for which
Numba compiles a kernel separately.
"""

import hashlib
import os
import pickle
import shutil
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from functools import cache, cached_property
from pathlib import Path
from typing import Annotated, Any

import numba
import numpy as np
import numpy.typing as npt
from numba.core import types
from numba.core.caching import NullCache
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler, CompileResult
from numba.core.dispatcher import Dispatcher
from numba.core.registry import CPUDispatcher
from numba.core.serialize import dumps

from grasp3d._kernels import compilations
from grasp3d.arrays import Bools, Bytes, Floats, Ints
from grasp3d.errors import OutputError
from grasp3d.system.files import atomic_write

SIGNATURES: dict[Any, str] = {}
"""Kernels and the declared types of their arguments; empty if only kernels call them."""

_config: Any = numba.config
_HERE = Path(__file__).parent

MAX_AGE = 30 * 24 * 3600.0
"""Age at which the machine code of other versions of the sources is removed [s]."""

_FLAGS: dict[str, Any] = {"nogil": True, "error_model": "numpy", "no_cfunc_wrapper": True}
"""Kernels run without the GIL and with IEEE semantics, so that a NaN reaches the caller. They are
never passed to another kernel or to C, and need no wrapper for that."""

_SCRATCH: dict[str, Any] = {"_nrt": False}
"""Numba then rejects allocations and omits reference counting."""


@cache
def code_folders() -> tuple[Path, ...]:
    """Folders for machine code of these sources, in the order in which they are tried.

    The package's own folder comes first: an installation fills it. The one that NUMBA_CACHE_DIR
    names and the user's cache follow. `ahead.py` only compiles ahead and is not among the sources.
    """
    digest = hashlib.sha256()
    for source in sorted({*_HERE.rglob("*.py")} - {_HERE / "ahead.py"}):
        digest.update(source.relative_to(_HERE).as_posix().encode() + b"\0" + source.read_bytes())
    name = f"grasp3d-kernels-{digest.hexdigest()[:16]}"
    return tuple(root / name for root in _possible_roots())


def _possible_roots() -> Iterator[Path]:
    yield _HERE / "__pycache__"
    if _config.CACHE_DIR:
        yield Path(_config.CACHE_DIR)
    home = Path(os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache"))  # noqa: PTH111
    if home.is_absolute():  # without a home directory expanduser leaves the "~"
        yield home / "grasp3d"


def make_folder(folder: Path) -> None:
    """Make a folder for machine code and remove old folders of other versions."""
    folder.mkdir(parents=True, exist_ok=True)
    for other in folder.parent.glob("grasp3d-kernels-*"):
        with suppress(OSError):  # another process may be removing it
            if other != folder and time.time() - other.stat().st_mtime > MAX_AGE:
                shutil.rmtree(other)


class KernelCache(NullCache):
    """Machine code of a kernel, read where it is first found, written to the first writable folder.

    Numba's own cache would separate copies of the same sources, such as an installed package and
    its checkout, by their paths. It also detects a change only in a kernel's own file, so a caller
    would keep the old machine code of kernels in other files. Here each version of the sources as a
    whole has its own folder.
    """

    def __init__(self, function: Any) -> None:
        self._function = function

    @property
    def cache_path(self) -> str:
        """The folder that is tried first."""
        return str(code_folders()[0])

    def files(self, sig: Any, codegen: Any) -> list[Path]:
        """Files that may hold the machine code for a signature."""
        code = self._function.__code__
        key = (sig, codegen.magic_tuple(), numba.__version__, sys.version, code.co_firstlineno)
        digest = hashlib.sha256(f"{self._function.__module__} {key}".encode() + code.co_code)
        name = f"{name_of(self._function)}-{digest.hexdigest()[:16]}.nbc"
        return [folder / name for folder in code_folders()]

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Load the machine code for a signature; return None if there is none."""
        target_context.refresh()
        for file in self.files(sig, target_context.codegen()):
            # A damaged file counts as missing, whatever it raises.
            with suppress(Exception):
                parts = pickle.loads(file.read_bytes())  # noqa: S301, of this program
                return CompileResult._rebuild(target_context, *parts)  # noqa: SLF001
        announce()
        return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Save the machine code for a signature if any folder is writable."""
        content = dumps(data._reduce())  # noqa: SLF001
        for file in self.files(sig, data.codegen):
            with suppress(OSError, OutputError):
                make_folder(file.parent)
                with atomic_write(file) as written:
                    written.write_bytes(content)
                return
        _report_unsaved()


@cache
def _report_unsaved() -> None:
    """Report once that each process has to compile again."""
    compilations.warning(
        "grasp3d: compiled for this process only: no folder can be written (set NUMBA_CACHE_DIR)"
    )


@cache
def announce() -> None:
    """Report once that kernels are about to be compiled."""
    compilations.warning("grasp3d: compiling, once for this processor and version of Numba")


def name_of(function: Any) -> str:
    """The name of a kernel as MODULE.FUNCTION."""
    return f"{function.__module__.rpartition('.')[2]}.{function.__qualname__}"


def kernel(signature: str = "", **flags: Any) -> Callable[[Callable[..., object]], Any]:
    """Compile with Numba and cache the machine code, unless the function is a closure.

    Args:
        signature: Types of the arguments with which Python calls the kernel, separated by commas
            and written as annotations; used to compile it ahead. Empty if only kernels call it.
        flags: Options of `numba.njit`.
    """

    def decorate(function: Callable[..., object]) -> Any:
        compiling = _without_literals(numba.njit(**{**_FLAGS, **flags})(function))
        if isinstance(compiling, Dispatcher) and function.__closure__ is None:
            vars(compiling)["_cache"] = KernelCache(function)
            SIGNATURES[compiling] = signature
        return compiling

    return decorate


def scratch_kernel(signature: str = "") -> Callable[[Callable[..., object]], Any]:
    """Compile a kernel that works in the arrays it is given and allocates nothing.

    Reference counting would take longer than a small support function itself. Such a kernel
    returns only numbers: its caller would release an array that it returned.
    """
    return kernel(signature, **_SCRATCH)


def part(function: Callable[..., object], **flags: Any) -> Any:
    """Compile a scratch kernel into the kernels that call it; Python does not call it."""
    return _without_literals(part_for_constants(function, **flags))


def part_for_constants(function: Callable[..., object], **flags: Any) -> Any:
    """Like `part`, but compiled separately for each constant argument, which saves run time."""
    if _config.DISABLE_JIT:
        return function
    return Part(function, {**_FLAGS, **_SCRATCH, **flags})


def merged(function: Callable[..., object]) -> Any:
    """Compile a part that LLVM inlines into the machine code of its callers."""
    return part(function, forceinline=True)


def _without_literals(compiling: Any) -> Any:
    """Treat a constant in a call like a variable.

    Otherwise Numba would compile a kernel again for every constant that other kernels pass to it.
    """
    if not isinstance(compiling, Dispatcher):  # compilation is switched off
        return compiling
    resolve = compiling.get_call_template

    def get_call_template(args: Any, kws: Any) -> Any:
        plain = {name: types.unliteral(kind) for name, kind in kws.items()}
        return resolve(tuple(types.unliteral(kind) for kind in args), plain)

    vars(compiling)["get_call_template"] = get_call_template
    return compiling


class _PartLibrary(JITCodeLibrary):
    """LLVM code of a part, to be linked into the code of its callers."""

    def _optimize_final_module(self) -> None:
        """Leave optimisation to the callers."""

    def _finalize_final_module(self) -> None:
        """Generate no machine code."""
        self._finalize_dynamic_globals()
        self._finalized = True

    def get_pointer_to_function(self, name: str) -> int:  # noqa: ARG002, Numba's interface
        """Return 0: a part has no wrapper for Python."""
        self._ensure_finalized()
        return 0

    @property
    def codegen(self) -> "_PartLibrary":
        """The object on which Numba sets the addresses of Python objects used by machine code."""
        return self

    def set_env(self, env_name: str, env: object) -> None:
        """Set no address: parts use no Python objects."""


class _PartCompiler(Compiler):
    """Numba's compiler with the library of a part."""

    def compile_extra(self, func: Callable[..., object]) -> Any:
        self.state.library = _PartLibrary(self.state.targetctx.codegen(), func.__qualname__)
        compile_extra: Callable[..., Any] = super().compile_extra
        return compile_extra(func)


class Part(CPUDispatcher):
    """A function that kernels call; when called from Python, as in tests, it runs as a kernel."""

    def __init__(self, function: Callable[..., object], flags: dict[str, Any]) -> None:
        options = {"nopython": True, "boundscheck": None, "no_cpython_wrapper": True, **flags}
        super().__init__(function, targetoptions=options, pipeline_class=_PartCompiler)

    @cached_property
    def kernel(self) -> Any:
        """The same function, compiled on its own."""
        return scratch_kernel()(self.py_func)

    def __call__(self, *args: Any, **kwargs: Any) -> Any:
        return self.kernel(*args, **kwargs)


def _array(item: types.Type, ndim: int, *, fixed: bool = False) -> types.Array:
    return types.Array(item, ndim, "C", readonly=fixed)


Floats1 = Annotated[Floats, _array(types.float64, 1)]
Floats2 = Annotated[Floats, _array(types.float64, 2)]
Floats3 = Annotated[Floats, _array(types.float64, 3)]
Floats4 = Annotated[Floats, _array(types.float64, 4)]
FixedFloats1 = Annotated[Floats, _array(types.float64, 1, fixed=True)]
FixedFloats2 = Annotated[Floats, _array(types.float64, 2, fixed=True)]
FixedFloats3 = Annotated[Floats, _array(types.float64, 3, fixed=True)]
Ints1 = Annotated[Ints, _array(types.int64, 1)]
Ints2 = Annotated[Ints, _array(types.int64, 2)]
Ints3 = Annotated[Ints, _array(types.int64, 3)]
FixedInts1 = Annotated[Ints, _array(types.int64, 1, fixed=True)]
FixedInts2 = Annotated[Ints, _array(types.int64, 2, fixed=True)]
Bools1 = Annotated[Bools, _array(types.boolean, 1)]
Bools2 = Annotated[Bools, _array(types.boolean, 2)]
Bytes1 = Annotated[Bytes, _array(types.uint8, 1)]
Float32s1 = Annotated[npt.NDArray[np.float32], _array(types.float32, 1)]
Float32s2 = Annotated[npt.NDArray[np.float32], _array(types.float32, 2)]
Float32s3 = Annotated[npt.NDArray[np.float32], _array(types.float32, 3)]
Int8s1 = Annotated[npt.NDArray[np.int8], _array(types.int8, 1)]
Int32s1 = Annotated[npt.NDArray[np.int32], _array(types.int32, 1)]
Int32s3 = Annotated[npt.NDArray[np.int32], _array(types.int32, 3)]
UInt32s1 = Annotated[npt.NDArray[np.uint32], _array(types.uint32, 1)]
UInt32s2 = Annotated[npt.NDArray[np.uint32], _array(types.uint32, 2)]
UInt64s1 = Annotated[npt.NDArray[np.uint64], _array(types.uint64, 1)]
