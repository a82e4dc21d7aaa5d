"""Labels of noisy copies of a scan, and the errors to enter for it."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
