"""Files of grasps and of labelled surfaces: a module for each format, which registers it.

`Format` states what a format of poses is; nothing but its module knows its name.
"""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
