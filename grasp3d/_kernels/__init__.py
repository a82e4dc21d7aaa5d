"""Numba kernels: arrays in, arrays out; arguments are not checked."""

from numba.core import event

from grasp3d._kernels.announcing import announcer

event.register("numba:compile", announcer)
