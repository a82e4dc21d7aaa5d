"""The interactive viewer: one state and one scene, shown in a window, a page or a picture."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
