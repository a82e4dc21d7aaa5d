"""Planar objects with one finger fixed and the second scanned along the outline.

Wan & Howe 2018, Sec. III-B: their circle and square, and any polygon. Fractions of the perimeter
come in closed form, also with uncertain friction, contact locations and further errors of normals,
which the paper names (Sec. III-A and IV-B); curves of epsilon come from planar wrench hulls.
"""

from grasp3d.planar.contacts import OutlineContacts
from grasp3d.planar.outlines import Circle, Outline, OutlineAngles, circle_fractions
from grasp3d.planar.planar_scan import PlanarScan, scan
from grasp3d.planar.polylines import Polyline, regular_polygon, square, square_fractions

__all__ = [
    "Circle",
    "Outline",
    "OutlineAngles",
    "OutlineContacts",
    "PlanarScan",
    "Polyline",
    "circle_fractions",
    "regular_polygon",
    "scan",
    "square",
    "square_fractions",
]
