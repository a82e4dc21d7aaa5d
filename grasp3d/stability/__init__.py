"""S, M or U: how reliable a grasp is for a sensor of known resolution."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
