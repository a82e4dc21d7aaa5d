"""Decorators that declare kernels: how each is compiled, and whether its machine code is kept."""

from collections.abc import Callable
from typing import Any

import numba

from grasp3d._kernels.compiling import numba_internals

_config: Any = numba.config

_FLAGS: dict[str, Any] = {"nogil": True, "error_model": "numpy", "no_cfunc_wrapper": True}
"""Kernels run without the GIL and with IEEE semantics, so that a NaN reaches the caller. None is
passed to another one, nor to C: a wrapper for that would only be compiled."""

_SCRATCH: dict[str, Any] = {"_nrt": False}
"""Numba then rejects allocations and omits reference counting."""


def _compiled(function: Callable[..., object], **flags: Any) -> Any:
    return numba_internals.without_literals(numba.njit(**_FLAGS, **flags)(function))


def kernel(function: Callable[..., object], **flags: Any) -> Any:
    """Compile with Numba and cache the machine code."""
    return numba_internals.stored(_compiled(function, **flags))


def scratch_kernel(function: Callable[..., object]) -> Any:
    """Compile a kernel that works in the arrays it is given and allocates nothing.

    Reference counting would cost more time than a small support function itself. It returns
    numbers: an array that it returned to a kernel would be released there.
    """
    return kernel(function, **_SCRATCH)


def inlined(function: Callable[..., object]) -> Any:
    """Inline a kernel into its callers: passing many arrays costs more than the work itself."""
    return _compiled(function, inline="always")


def part(function: Callable[..., object], **flags: Any) -> Any:
    """Compile a scratch kernel that only kernels call, into these."""
    if _config.DISABLE_JIT:
        return function
    return numba_internals.without_literals(part_for_constants(function, **flags))


def part_for_constants(function: Callable[..., object], **flags: Any) -> Any:
    """As `part`, compiled again for each constant in a call, where that pays in the run time."""
    if _config.DISABLE_JIT:
        return function
    if not numba_internals.PARTS_TESTED:
        return kernel(function, **_SCRATCH, **flags)
    return numba_internals.Part(function, scratch_kernel, {**_FLAGS, **_SCRATCH, **flags})


def merged(function: Callable[..., object]) -> Any:
    """Inline a part of a scratch kernel into the machine code of its callers (by LLVM)."""
    return part(function, forceinline=True)
