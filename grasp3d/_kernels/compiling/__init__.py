"""Compilation of kernels with Numba, and where their machine code is kept."""
