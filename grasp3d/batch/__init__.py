"""Many meshes: plan the jobs, run them in processes, store one row for each."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
