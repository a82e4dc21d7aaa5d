"""Contacts of fingers with an object: positions, friction cones, and the sensor that feels them."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
