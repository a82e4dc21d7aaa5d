"""Texts about a grasp, a surface or an object: numbers in words, reasons and verdicts."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
