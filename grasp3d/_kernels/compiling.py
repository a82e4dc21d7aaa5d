"""The decorators of the compiled loops."""

from collections.abc import Callable
from typing import Any

import numba


def kernel(function: Callable[..., object]) -> Any:
    """Compile with Numba: cached, without the GIL, IEEE semantics (a NaN reaches the caller).

    Kernels that call each other stand in one file: Numba's cache notices a change of a kernel's
    own file only.
    """
    try:
        return numba.njit(cache=True, nogil=True, error_model="numpy")(function)
    except RuntimeError:  # no folder that can hold a cache: a read-only installation
        return numba.njit(nogil=True, error_model="numpy")(function)


def inlined(function: Callable[..., object]) -> Any:
    """Write a kernel out where it is called: handing over many arrays costs more than the work."""
    return numba.njit(inline="always", nogil=True, error_model="numpy")(function)
