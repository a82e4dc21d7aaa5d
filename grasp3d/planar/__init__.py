"""Planar objects with one finger fixed and the second scanned along the outline.

Wan & Howe 2018, Sec. III-B: their circle and square, and any polygon. Fractions of the perimeter
come in closed form, also with uncertain friction, contact locations and further errors of normals,
which the paper names (Sec. III-A and IV-B); curves of epsilon come from planar wrench hulls.
"""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
