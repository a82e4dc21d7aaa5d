"""Mesh repair: welding, removal of degenerate faces, winding, hole filling, union of bodies."""

from grasp3d.mesh.repair.records import RepairedSurface, RepairStep, Solids
from grasp3d.mesh.repair.work import MOST_ROUNDING, repair_surface

__all__ = ["MOST_ROUNDING", "RepairStep", "RepairedSurface", "Solids", "repair_surface"]
