"""Numba kernels: arrays in, arrays out; arguments are not checked."""

import logging

compilations = logging.getLogger("grasp3d.compiling")
"""Logger that reports the compilation of kernels. Where no logging is configured, Python writes its
messages to standard error."""
