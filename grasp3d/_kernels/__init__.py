"""Numba kernels: arrays in, arrays out; arguments are not checked."""
