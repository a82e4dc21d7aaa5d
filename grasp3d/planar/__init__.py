"""Planar objects with one finger fixed and the second scanned along the outline.

Wan & Howe 2018, Sec. IV: their circle and square, and any polygon. Fractions of the perimeter come
in closed form, curves of epsilon from planar wrench hulls.
"""

from grasp3d.planar.contacts import OutlineContacts
from grasp3d.planar.outlines import (
    Circle,
    Outline,
    Polyline,
    circle_fractions,
    regular_polygon,
    square,
    square_fractions,
)
from grasp3d.planar.scanning import PlanarScan, scan

__all__ = [
    "Circle",
    "Outline",
    "OutlineContacts",
    "PlanarScan",
    "Polyline",
    "circle_fractions",
    "regular_polygon",
    "scan",
    "square",
    "square_fractions",
]
