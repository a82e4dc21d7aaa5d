"""Epsilon of grasps on a surface: at the nominal normals, and over the tilts."""

import math
from typing import Any

import numpy as np

from grasp3d.arrays import Ints, locked
from grasp3d.quality.ferrari_canny import epsilon
from grasp3d.quality.tilting import EpsilonRange, epsilon_range
from grasp3d.settings import GraspModel
from grasp3d.surface.contacts import SurfaceContacts
from grasp3d.surface.extreme_normals import hull_epsilons
from grasp3d.system.progress import Progress

EPSILON_RTOL = 1e-2
"""How much of epsilon's upper bound may lie between its bounds."""

BOUND_RTOL = 3e-2
"""The same for the largest epsilon, which is a bound in any case; symmetric grasps gain most."""


def surface_epsilons(
    grasps: SurfaceContacts,
    model: GraspModel,
    *,
    threads: int | None = None,
    progress: Progress | None = None,
) -> EpsilonRange:
    """Epsilon of grasps about the mesh's centre of mass, torques divided by its torque scale.

    Args:
        grasps: The grasps.
        model: Friction, resolution, edges, actuation and torsion. With method extremes the minimum
            and the maximum are those over the combinations of extreme normals.
        threads: Threads; None: one per processor.
        progress: Called with the share of the work done, from 0 to 1.

    Returns:
        Shape (b,) each; nan where the normals at a contact cancel out.

    Raises:
        SettingError: A grasp has too many combinations of extreme normals.
    """
    values = np.full((3, grasps.size), math.nan)
    pushing = pushing_grasps(grasps)
    if not len(pushing):
        return EpsilonRange(*map(locked, values))
    held = grasps.take(pushing)
    contacts = held.contacts(model)
    common: dict[str, Any] = {
        "edges": model.edges,
        "actuation": model.actuation,
        "torque_scale": grasps.mesh.torque_scale,
        "rtol": EPSILON_RTOL,
        "threads": threads,
    }
    if model.method == "extremes":
        values[0, pushing] = epsilon(contacts, **common).lower
        values[1:, pushing] = hull_epsilons(
            held, model, rtol=EPSILON_RTOL, threads=threads, progress=progress
        )
    else:
        found = epsilon_range(
            contacts, model.tilt, bound_rtol=BOUND_RTOL, progress=progress, **common
        )
        values[:, pushing] = found.nominal, found.minimum, found.maximum
    return EpsilonRange(*map(locked, values))


def pushing_grasps(grasps: SurfaceContacts) -> Ints:
    """Numbers of the grasps of which no contact's normals cancel out."""
    return np.flatnonzero((grasps.normals != 0.0).any(axis=2).all(axis=1))
