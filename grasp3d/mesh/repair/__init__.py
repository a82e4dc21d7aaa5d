"""Mending a surface: weld, drop what is nothing, wind, turn, close, unite."""

from grasp3d.mesh.repair.records import RepairedSurface, RepairStep
from grasp3d.mesh.repair.surface import repair_surface
from grasp3d.mesh.repair.work import MOST_ROUNDING

__all__ = ["MOST_ROUNDING", "RepairStep", "RepairedSurface", "repair_surface"]
