"""What became of grasps: outcomes held against labels and scores, and outcomes in simulation.

Simulated in MuJoCo, with objects of convex parts from CoACD.
"""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
