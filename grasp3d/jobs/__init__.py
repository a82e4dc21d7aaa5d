"""Jobs: a function is called for each of many items, in watched processes or on a cluster."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
