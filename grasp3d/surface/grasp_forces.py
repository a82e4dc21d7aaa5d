"""Grip forces and payloads of grasps on a surface."""

import math
from dataclasses import replace

import numpy as np

from grasp3d.arrays import locked
from grasp3d.settings import GraspModel
from grasp3d.surface.contacts import SurfaceContacts
from grasp3d.surface.holding import Holding, holding_of
from grasp3d.surface.load_case import LoadCase
from grasp3d.system.progress import Progress


def surface_holding(
    grasps: SurfaceContacts,
    model: GraspModel,
    case: LoadCase,
    *,
    threads: int | None = None,
    progress: Progress | None = None,
) -> Holding:
    """Grip forces and payloads of grasps under a load, about the mesh's centre of mass.

    Args:
        grasps: The grasps (b,).
        model: Friction and resolution; the torsion radius is that of the load case.
        case: The load.
        threads: Threads; None: one per processor.
        progress: Called with the fraction of the work done, from 0 to 1.

    Returns:
        Rows (b,). Where the normals at a contact cancel out nothing is known of the forces: the
        label with force is M.
    """
    chosen = grasps.with_normals
    if not len(chosen):
        return _unknown_normals(Holding.none(case, grasps.size))
    known = grasps.take(chosen)
    found = holding_of(
        known.contacts(model), known.tilts(model), case, friction=model.friction_bounds,
        threads=threads, progress=progress,
    )  # fmt: skip
    if len(chosen) == grasps.size:
        return found
    return _unknown_normals(found.placed(chosen, grasps.size))


def _unknown_normals(found: Holding) -> Holding:
    """The forces of rows without numbers, whose normals cancel out: anything may be true."""
    unknown = np.isnan(found.grip_force)
    payload = np.where(unknown & found.has_payload, 0.0, found.payload)
    return replace(
        found,
        grip_force_least=locked(np.where(unknown, 0.0, found.grip_force_least)),
        grip_force_largest=locked(np.where(unknown, math.inf, found.grip_force_largest)),
        payload=locked(payload),
    )
