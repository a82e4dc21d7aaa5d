"""Mesh repair: welding, removal of degenerate faces, winding, hole filling, union of bodies."""

from grasp3d.mesh.repair.bodies import Solids
from grasp3d.mesh.repair.work import MOST_ROUNDING, RepairedSurface, RepairStep, repair_surface

__all__ = ["MOST_ROUNDING", "RepairStep", "RepairedSurface", "Solids", "repair_surface"]
