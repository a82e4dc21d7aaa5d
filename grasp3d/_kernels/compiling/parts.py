"""Parts of kernels: functions that are compiled into the kernels that call them, and nothing else.

Numba optimises each function that a kernel calls, generates its machine code and a wrapper for
Python, and does so again for the caller, which contains it. For parts only the last of these is
done: they are typed and lowered, and optimised within the kernel that Python calls.
"""

from collections.abc import Callable
from functools import cached_property
from typing import Any

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
    """A function that kernels call; where Python calls it, as in tests, it is a kernel itself."""

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
