"""Many meshes: plan the jobs, run them in worker processes, store one row per mesh."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
