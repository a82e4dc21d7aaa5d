"""Sweeps: area fractions S, M and U over any two uncertainties, and the required resolution."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
