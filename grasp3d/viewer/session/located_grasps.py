"""Critical angles of single grasps with uncertain contact locations and different fingers."""

from dataclasses import replace

import numpy as np

from grasp3d.settings import GraspModel
from grasp3d.surface.contacts import SurfaceContacts
from grasp3d.surface.grasp_numbers import located_angles_of
from grasp3d.viewer.subjects.located import fits
from grasp3d.viewer.subjects.subject import LastContact


def located_grasp(
    grasp: SurfaceContacts, worst: float, best: float, model: GraspModel
) -> tuple[float, float]:
    """Angles that decide the label of one grasp, over the worst and the best normals [rad].

    Args:
        grasp: The grasp, shape (1, n).
        worst: Its critical angle over the worst normals [rad].
        best: The same over the best normals.
        model: Grasp model, with lengths in the mesh's unit.
    """
    model = replace(model, fingers=grasp.count)
    if model.is_uniform or not fits(model):
        return float(worst), float(best)
    angles = np.array([worst]), np.array([best])
    found = located_angles_of(grasp, angles, model, threads=1)
    return float(found[0][0]), float(found[1][0])


def last_angles(found: LastContact, model: GraspModel) -> tuple[float, float]:
    """The same for the best contact found for the last finger."""
    if found.grasp is None:
        return found.worst, found.best
    return located_grasp(found.grasp, found.worst, found.best, model)
