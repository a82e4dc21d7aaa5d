"""Numba kernels: arrays in, arrays out; arguments are not checked."""

from numba.core import event

from grasp3d._kernels.compiling.announcing import announcer
from grasp3d._kernels.compiling.collecting import CollectionPauses

event.register("numba:compile", announcer)
event.register("numba:compile", CollectionPauses())
