"""Numba kernels: arrays in, arrays out; arguments are not checked."""

from grasp3d._kernels.compiling.machine_code import cache_folder
from grasp3d._kernels.compiling.numba_internals import listen
from grasp3d.system.compiling import compilations


def _begin(kernel: str) -> None:
    compilations.begin(kernel, stored=cache_folder() is not None)


listen(__name__, _begin, compilations.end)
