"""Grip forces and payloads of grasps on a surface."""

import math
from dataclasses import replace

import numpy as np

from grasp3d.arrays import RIGHT_ANGLE, Floats, angles_between, locked
from grasp3d.settings import GraspModel
from grasp3d.surface.contacts import SurfaceContacts
from grasp3d.surface.epsilon import grasps_with_normals
from grasp3d.surface.holding import Holding, holding_of
from grasp3d.surface.load_case import LoadCase
from grasp3d.surface.vertex_grasps import VertexGrasps, grasps_at, grasps_differ
from grasp3d.system.progress import Progress, ignore

WIDEST = RIGHT_ANGLE - 1e-9
"""Largest tilt that is evaluated [rad]: no force is the same for all normals of half a ball."""


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
    chosen = grasps_with_normals(grasps)
    if not len(chosen):
        return _unknown_normals(Holding.none(case, grasps.size))
    known = grasps.take(chosen)
    found = holding_of(
        known.contacts(model), tilts_of(known, model), case, friction=model.friction_bounds,
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


def vertex_holding(
    grasps: VertexGrasps,
    model: GraspModel,
    case: LoadCase,
    threads: int | None,
    progress: Progress,
) -> Holding:
    """Grip forces and payloads of every vertex's best grasp over the worst normals, rows (V,).

    At a few creases another grasp is best over the best normals: the least force is the smaller one
    of the two, as for labels.
    """
    canonical, vertices = grasps.mesh.canonical, grasps.vertices
    differing = vertices[grasps_differ(grasps.partner_points, vertices)]
    worst, best = (
        surface_holding(
            grasps_at(grasps.mesh, grasps.partner_points, rows, number),
            model, case, threads=threads, progress=report,
        ).placed(rows, len(canonical))
        for number, (rows, report) in enumerate(((vertices, progress), (differing, ignore)))
    )  # fmt: skip
    least = np.fmin(worst.grip_force_least, best.grip_force_least)
    return replace(worst, grip_force_least=locked(least)).take(canonical)


def tilts_of(grasps: SurfaceContacts, model: GraspModel) -> Floats:
    """Largest angle between the nominal normal of each contact and any that may be true (b, n).

    On creases the true normal is within the sensor's resolution of any normal of the set.

    Args:
        grasps: Grasps whose normals do not cancel out.
        model: The resolution.
    """
    counts = np.diff(grasps.set_start)
    middles = np.repeat(grasps.normals.reshape(-1, 3), counts, axis=0)
    angles = angles_between(middles, grasps.set_normals)
    spread = np.maximum.reduceat(angles, grasps.set_start[:-1]) if len(angles) else angles
    spread = np.where(grasps.on_crease, spread.reshape(grasps.size, grasps.count), 0.0)
    spread = np.where(grasps.any_normal, WIDEST, spread)
    return np.asarray(np.minimum(spread + np.asarray(model.tilt_of_fingers), WIDEST))
