"""Labels S, M and U of grasps, for a tactile sensor of given resolution."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
