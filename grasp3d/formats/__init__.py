"""Files of grasps and of labelled surfaces; each format of poses has a module that registers it.

`Format` describes a format of poses; only the module of a format knows its name.
"""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
