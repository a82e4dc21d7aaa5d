"""Whole grasps on a surface: evaluated, selected, read from files and written to files."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
