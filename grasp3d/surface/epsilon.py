"""Epsilon of grasps on a surface: at the nominal normals, and over the tilts."""

import math

import numpy as np

from grasp3d.arrays import locked
from grasp3d.quality.epsilon_options import EpsilonOptions
from grasp3d.quality.ferrari_canny import epsilon_with
from grasp3d.quality.tilting import EpsilonRange, WrenchErrors, uncertain_epsilon_range
from grasp3d.settings import GraspModel
from grasp3d.surface.contacts import SurfaceContacts
from grasp3d.surface.extreme_normals import hull_epsilons
from grasp3d.surface.jaw_contacts import JawContacts
from grasp3d.system.progress import Progress

EPSILON_RTOL = 1e-2
"""Fraction of epsilon's upper bound that may lie between its bounds."""

BOUND_RTOL = 3e-2
"""The same for the largest epsilon, itself only a bound; saves most time for symmetric grasps."""


def surface_epsilons(
    grasps: SurfaceContacts,
    model: GraspModel,
    *,
    center_radius: float = 0.0,
    threads: int | None = None,
    progress: Progress | None = None,
) -> EpsilonRange:
    """Epsilon of grasps about the mesh's centre of mass, torques divided by its torque scale.

    Args:
        grasps: The grasps.
        model: Friction, resolution, edges, actuation and torsion. With method extremes the minimum
            and the maximum are those over the combinations of extreme normals, at the smallest and
            at the largest friction.
        center_radius: Radius of the ball in which the centre of mass lies, in the mesh's unit.
        threads: Threads; None: one per processor.
        progress: Called with the fraction of the work done, from 0 to 1.

    Returns:
        Shape (b,) each; nan where the normals at a contact cancel out.

    Raises:
        SettingError: A grasp has too many combinations of extreme normals.
    """
    values = np.full((3, grasps.size), math.nan)
    chosen = grasps.with_normals
    if not len(chosen):
        return EpsilonRange(*map(locked, values))
    chosen_grasps = grasps.take(chosen)
    contacts = chosen_grasps.contacts(model)
    options = EpsilonOptions.of_model(
        model, torque_scale=grasps.mesh.torque_scale, rtol=EPSILON_RTOL, threads=threads
    )
    if model.method == "extremes" and not isinstance(grasps, JawContacts):
        values[0, chosen] = epsilon_with(contacts, options).lower
        values[1:, chosen] = hull_epsilons(chosen_grasps, model, options, progress=progress)
    else:
        found = uncertain_epsilon_range(
            contacts, model.tilt_of_fingers, WrenchErrors.of_model(model, center_radius), options,
            bound_rtol=BOUND_RTOL, progress=progress,
        )  # fmt: skip
        values[:, chosen] = found.nominal, found.minimum, found.maximum
    return EpsilonRange(*map(locked, values))
