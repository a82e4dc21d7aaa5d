"""What kernels use of Numba beside its documented functions, all of it.

**Parts** are functions that are compiled into the kernels that call them, and nothing else. Numba
optimises each function that a kernel calls, generates its machine code and a wrapper for Python,
and does so again for the caller, which contains it. For parts only the last of these is done: they
are typed and lowered, and optimised within the kernel that Python calls.
"""

import errno
import gc
import hashlib
import pickle
from collections.abc import Callable, Iterable
from contextlib import suppress
from functools import cached_property, partial
from pathlib import Path
from typing import Any

import numba
from numba.core import event, types
from numba.core.caching import CompileResultCacheImpl, FunctionCache, IndexDataCacheFile, NullCache
from numba.core.dispatcher import Dispatcher

from grasp3d._kernels.compiling.machine_code import code_folders, make_folder

PARTS_TESTED = numba.version_info.short < (0, 69)
"""Whether parts are compiled into their callers only, which later versions of Numba may not allow:
there they are compiled like kernels, and the first run takes longer."""

DIGEST = 32
"""Bytes of a checksum, at the start of each file of machine code."""

YOUNG_OBJECTS = 200_000
"""New objects before a garbage collection, while a kernel is compiled.

Compiling makes very many small objects, and Python collects garbage whenever about a thousand are
new. While the kernels of labels were compiled, collections took 4.6 s of 30 s of CPU time; with
this threshold 1.8 s, with 27 MB more memory (438 MB at the peak)."""


class KernelLocator:
    """Names a kernel's files in a folder for Numba; the interface is Numba's.

    Numba's own locators would separate copies of the same sources, such as an installed package and
    its checkout, by their paths. They also detect a change only in a kernel's own file, so a caller
    would keep the old machine code of kernels in other files.
    """

    def __init__(self, folder: Path, first_line: int = 0) -> None:
        self._folder, self._first_line = folder, first_line

    def from_function(self, function: Any, _file: str) -> "KernelLocator":
        """Locate a kernel."""
        return KernelLocator(self._folder, function.__code__.co_firstlineno)

    def get_cache_path(self) -> str:
        """Folder of the files."""
        return str(self._folder)

    def get_source_stamp(self) -> str:
        """The version of the sources, which the name of the folder contains."""
        return self._folder.name

    def get_disambiguator(self) -> str:
        """Part of the files' names that distinguishes kernels of equal names in a module."""
        return str(self._first_line)

    def ensure_cache_path(self) -> None:
        """Make the folder, which may have been removed while this process ran."""
        make_folder(self._folder)


class _StoredKernel(CompileResultCacheImpl):
    """How Numba writes a kernel's machine code to one folder."""

    def __init__(self, function: Any, folder: Path) -> None:
        vars(self)["_locator_classes"] = [KernelLocator(folder)]
        super().__init__(function)  # type: ignore[no-untyped-call]


class CheckedFiles(IndexDataCacheFile):
    """A kernel's files, each with a checksum: one that is empty, cut or altered is not there.

    Numba would unpickle it, and fail for ever.
    """

    def holds(self, key: Any) -> bool:
        """Whether there is sound machine code for a key."""
        with suppress(OSError):
            name = self._load_index().get(key)
            return name is not None and bool(_content(Path(self._data_path(name))))
        return False

    def _load_index(self) -> Any:
        with suppress(OSError):
            version, stamp, overloads = pickle.loads(_content(Path(self._index_path)))  # noqa: S301
            if (version, stamp) == (self._version, self._source_stamp):
                return overloads
        return {}

    def _save_index(self, overloads: Any) -> None:
        self._save(self._index_path, (self._version, self._source_stamp, overloads))

    def _load_data(self, name: str) -> Any:
        return pickle.loads(_content(Path(self._data_path(name))))  # noqa: S301, of this program

    def _save_data(self, name: str, data: Any) -> None:
        self._save(self._data_path(name), data)

    def _save(self, path: str, values: Any) -> None:
        content = self._dump(values)
        with self._open_for_write(path) as file:  # beside it, and renamed
            file.write(hashlib.sha256(content).digest() + content)


def _content(path: Path) -> bytes:
    """What a file has after its checksum. Raises OSError if that is of something else."""
    data = path.read_bytes()
    if data[:DIGEST] != hashlib.sha256(data[DIGEST:]).digest():
        raise OSError(errno.EIO, "is damaged", str(path))
    return data[DIGEST:]


class _Folder(FunctionCache):
    """A kernel's machine code in one folder."""

    def __init__(self, function: Any, folder: Path) -> None:
        vars(self)["_impl_class"] = partial(_StoredKernel, folder=folder)
        super().__init__(function)  # type: ignore[no-untyped-call]
        stored = vars(self)["_impl"]
        self._files = vars(self)["_cache_file"] = CheckedFiles(
            self.cache_path, stored.filename_base, stored.locator.get_source_stamp()
        )

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Load machine code for a signature; None: there is none that can be read."""
        with suppress(OSError):
            return super().load_overload(sig, target_context)  # type: ignore[no-untyped-call]
        return None

    def holds(self, sig: Any, target_context: Any) -> bool:
        """Whether there is machine code for a signature, which is not loaded."""
        target_context.refresh()
        return self._files.holds(self._index_key(sig, target_context.codegen()))


class KernelCache(NullCache):
    """A kernel's machine code: read where it is first found, written where it first can be."""

    def __init__(self, function: Any) -> None:
        self._folders = [_Folder(function, folder) for folder in code_folders()]

    @property
    def cache_path(self) -> str:
        """The folder that is read first."""
        return str(self._folders[0].cache_path)

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Load machine code for a signature; None: there is none."""
        found = (folder.load_overload(sig, target_context) for folder in self._folders)
        return next((one for one in found if one is not None), None)

    def save_overload(self, sig: Any, data: Any) -> None:
        """Save machine code for a signature, if any folder can be written."""
        for folder in self._folders:
            with suppress(OSError):
                folder.save_overload(sig, data)
                return

    def holds(self, sig: Any, target_context: Any) -> bool:
        """Whether there is machine code for a signature."""
        return any(folder.holds(sig, target_context) for folder in self._folders)


def stored(compiled: Any) -> Any:
    """Read the machine code of a kernel from the folders, and write there what is compiled."""
    if isinstance(compiled, Dispatcher):
        vars(compiled)["_cache"] = KernelCache(compiled.py_func)
    return compiled


def is_compiled(kernel: Any, signatures: Iterable[Any]) -> bool:
    """Whether one of the folders has machine code of a kernel for all signatures."""
    if not isinstance(kernel, Dispatcher):  # compilation is switched off
        return True
    cache, target = vars(kernel)["_cache"], kernel.targetctx
    return all(cache.holds(signature, target) for signature in signatures)


def without_literals(compiled: Any) -> Any:
    """Type a constant in a call like a variable.

    Numba would compile a kernel again for every constant that other kernels pass to it.
    """
    if not isinstance(compiled, Dispatcher):  # compilation is switched off
        return compiled
    resolve = compiled.get_call_template

    def get_call_template(args: Any, kws: Any) -> Any:
        plain = {name: types.unliteral(kind) for name, kind in kws.items()}
        return resolve(tuple(types.unliteral(kind) for kind in args), plain)

    vars(compiled)["get_call_template"] = get_call_template
    return compiled


class Listener(event.Listener):
    """Reports the kernels of a package that Python calls, when Numba compiles them.

    Python collects garbage less often meanwhile. Numba calls it for the functions of all programs
    in the process; those of others change nothing.
    """

    def __init__(self, package: str, begin: Callable[[str], None], end: Callable[[], None]) -> None:
        self._package, self._begin, self._end = package, begin, end
        self._depth = 0  # kernels compile those that they call; Numba holds its lock meanwhile
        self._before = gc.get_threshold()

    def on_start(self, event: Any) -> None:
        """Raise the threshold of collections, unless they are off or rarer already; report."""
        if not self._is_own(event):
            return
        self._depth += 1
        if self._depth > 1:
            return
        self._before = gc.get_threshold()
        if 0 < self._before[0] < YOUNG_OBJECTS:
            gc.set_threshold(YOUNG_OBJECTS, *self._before[1:])
        self._begin(_name_of(event))

    def on_end(self, event: Any) -> None:
        """Put the threshold back, also after a compilation that failed."""
        if not self._is_own(event):
            return
        self._depth -= 1
        if self._depth == 0:
            gc.set_threshold(*self._before)
            self._end()

    def _is_own(self, event: Any) -> bool:
        """Whether it is about a function in the package; one that exec makes is in no module."""
        module = event.data["dispatcher"].py_func.__module__
        return module is not None and f"{module}.".startswith(f"{self._package}.")


def _name_of(event: Any) -> str:
    """The kernel that an event is about, as MODULE.FUNCTION."""
    function = event.data["dispatcher"].py_func
    return f"{function.__module__.rpartition('.')[2]}.{function.__qualname__}"


def listen(package: str, begin: Callable[[str], None], end: Callable[[], None]) -> None:
    """Call functions when a kernel of a package begins to be compiled, and when that has ended.

    Args:
        package: Full name of the package.
        begin: Called with the kernel as MODULE.FUNCTION; an exception ends the compilation.
        end: Called without arguments.
    """
    event.register("numba:compile", Listener(package, begin, end))


if PARTS_TESTED:
    from numba.core.codegen import JITCodeLibrary
    from numba.core.compiler import Compiler
    from numba.core.registry import CPUDispatcher

    class _PartLibrary(JITCodeLibrary):
        """Code of a part for LLVM, to be linked into that of its callers."""

        def _optimize_final_module(self) -> None:
            """Leave it to the callers."""

        def _finalize_final_module(self) -> None:
            """Generate no machine code."""
            self._finalize_dynamic_globals()
            self._finalized = True

        def get_pointer_to_function(self, name: str) -> int:  # noqa: ARG002, Numba's interface
            """Address of the wrapper for Python, which does not exist."""
            self._ensure_finalized()
            return 0

        @property
        def codegen(self) -> "_PartLibrary":
            """Where Numba sets the addresses of Python objects that machine code uses."""
            return self

        def set_env(self, env_name: str, env: object) -> None:
            """Set no address: parts use no Python objects."""

    class _PartCompiler(Compiler):
        """Numba's compiler, but for its library."""

        def compile_extra(self, func: Callable[..., object]) -> Any:
            self.state.library = _PartLibrary(self.state.targetctx.codegen(), func.__qualname__)
            compile_extra: Callable[..., Any] = super().compile_extra
            return compile_extra(func)

    class Part(CPUDispatcher):
        """A function that kernels call; where Python calls it, as in tests, a kernel itself."""

        def __init__(
            self,
            function: Callable[..., object],
            as_kernel: Callable[[Callable[..., object]], Any],
            flags: dict[str, Any],
        ) -> None:
            options = {"nopython": True, "boundscheck": None, "no_cpython_wrapper": True, **flags}
            super().__init__(function, targetoptions=options, pipeline_class=_PartCompiler)
            self._as_kernel = as_kernel

        @cached_property
        def kernel(self) -> Any:
            """The same function with machine code of its own."""
            return self._as_kernel(self.py_func)

        def __call__(self, *args: Any, **kwargs: Any) -> Any:
            return self.kernel(*args, **kwargs)
