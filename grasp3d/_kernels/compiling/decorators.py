"""Decorators that compile the kernels with Numba."""

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numba
from numba.core import types
from numba.core.dispatcher import Dispatcher

from grasp3d._kernels.compiling.machine_code import KernelLocator, cache_folder

_config: Any = numba.config
_decorating = threading.Lock()

PARTS_TESTED = numba.version_info.short < (0, 69)
"""Whether parts are compiled into their callers only, which rests on internals of Numba that later
versions may change: there they are compiled like kernels, and the first run takes longer."""


@contextmanager
def _cached_by(locator: type) -> Iterator[None]:
    """Set Numba's cache locator for functions that are decorated meanwhile."""
    with _decorating:
        before = _config.CACHE_LOCATOR_CLASSES
        _config.CACHE_LOCATOR_CLASSES = f"{locator.__module__}.{locator.__qualname__}"
        try:
            yield
        finally:
            _config.CACHE_LOCATOR_CLASSES = before


_FLAGS: dict[str, Any] = {"nogil": True, "error_model": "numpy", "no_cfunc_wrapper": True}
"""Kernels run without the GIL and with IEEE semantics, so that a NaN reaches the caller. None is
passed to another one, nor to C: a wrapper for that would only be compiled."""


def _compiled(function: Callable[..., object], **flags: Any) -> Any:
    """Compile with the flags of all kernels."""
    return _without_literals(numba.njit(**_FLAGS, **flags)(function))


def _without_literals(compiled: Any) -> Any:
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


def _compiled_and_cached(function: Callable[..., object], **flags: Any) -> Any:
    if cache_folder() is None:
        return _compiled(function, **flags)
    with _cached_by(KernelLocator):
        return _compiled(function, cache=True, **flags)


def kernel(function: Callable[..., object]) -> Any:
    """Compile with Numba and cache the machine code."""
    return _compiled_and_cached(function)


def scratch_kernel(function: Callable[..., object]) -> Any:
    """Compile a kernel that works in the arrays it is given and allocates nothing.

    Numba then rejects allocations and omits reference counting, which costs more time than a small
    support function itself. It returns numbers: an array that it returned to a kernel would be
    released there.
    """
    return _compiled_and_cached(function, _nrt=False)


def inlined(function: Callable[..., object]) -> Any:
    """Inline a kernel into its callers: passing many arrays costs more than the work itself."""
    return _compiled(function, inline="always")


def part(function: Callable[..., object], **flags: Any) -> Any:
    """Compile a scratch kernel that only kernels call, into these."""
    if _config.DISABLE_JIT:
        return function
    return _without_literals(_part(function, **flags))


def part_for_constants(function: Callable[..., object]) -> Any:
    """As `part`, compiled again for each constant in a call, where that pays in the run time."""
    return function if _config.DISABLE_JIT else _part(function)


def _part(function: Callable[..., object], **flags: Any) -> Any:
    if not PARTS_TESTED:
        return _compiled_and_cached(function, _nrt=False, **flags)
    from grasp3d._kernels.compiling.parts import Part

    return Part(function, scratch_kernel, {**_FLAGS, "_nrt": False, **flags})


def merged(function: Callable[..., object]) -> Any:
    """Inline a part of a scratch kernel into the machine code of its callers (by LLVM)."""
    return part(function, forceinline=True)
