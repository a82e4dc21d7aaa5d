"""Object meshes: reading, repair, refinement and the contact normals of every surface point."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
