"""Outcomes of grasps: comparison with labels and scores, and simulation.

Simulations use MuJoCo, with objects divided into convex parts by CoACD.
"""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
