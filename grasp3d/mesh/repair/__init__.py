"""Mending a surface: weld, drop what is nothing, wind, turn, close, unite."""

from grasp3d.mesh.repair.surface import (
    MOST_ROUNDING,
    RepairedSurface,
    RepairStep,
    repair_surface,
)

__all__ = ["MOST_ROUNDING", "RepairStep", "RepairedSurface", "repair_surface"]
