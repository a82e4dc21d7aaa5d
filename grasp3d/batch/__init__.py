"""Libraries of meshes: labelled by many processes, stored in chunks, and read again."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
