"""Numba kernels: arrays in, arrays out; arguments are not checked."""

from grasp3d._kernels.compiling.machine_code import can_be_stored
from grasp3d._kernels.compiling.numba_internals import listen
from grasp3d.system.compiling import compilations


def _begin(kernel: str) -> None:
    compilations.begin(kernel, stored=can_be_stored())


listen(__name__, _begin, compilations.end)
