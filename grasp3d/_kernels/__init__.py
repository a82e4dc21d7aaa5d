"""Numba kernels: arrays in, arrays out; arguments are not checked."""

import logging

compilations = logging.getLogger("grasp3d.compiling")
"""Where it is said that kernels are compiled: Python writes that to standard error where no logging
is configured."""
