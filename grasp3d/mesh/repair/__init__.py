"""Mesh repair: welding, removal of degenerate faces, winding, hole filling, union of bodies."""

from grasp3d.mesh.repair.records import RepairedSurface, RepairStep, Solids
from grasp3d.mesh.repair.surface import repair_surface
from grasp3d.mesh.repair.work import MOST_ROUNDING

__all__ = ["MOST_ROUNDING", "RepairStep", "RepairedSurface", "Solids", "repair_surface"]
