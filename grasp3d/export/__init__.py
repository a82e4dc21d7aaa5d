"""Files of labelled surfaces: PLY, NPZ, VTP and Parquet, and GLB for viewing.

`fields` declares what they hold of each vertex; each format has one module.
"""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
