"""Whole grasps on a surface: given or found, evaluated, ranked, read and written."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
