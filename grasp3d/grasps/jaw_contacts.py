"""Contacts of closed jaws: points, or with the patches that the jaws touch."""

import numpy as np

from grasp3d.arrays import Floats
from grasp3d.contact.contacts import Contacts
from grasp3d.contact.patch_shapes import evenly_pressed_radius, in_tangent_plane
from grasp3d.hand.closed_jaws import ClosedJaws
from grasp3d.settings import GraspModel


def jaw_contacts(jaws: ClosedJaws, center_mass: Floats, model: GraspModel) -> Contacts | None:
    """The contacts where jaws close on an object, relative to its centre of mass; None: nowhere.

    A point has the torsion radius of the model. Otherwise it is that of the patch that is touched,
    evenly pressed, from its area and extents, unless the model has one; a contact with a patch also
    resists rolling, over half the patch's extents along y and z of the gripper, projected onto the
    tangent plane.

    Args:
        jaws: Where the jaws touch.
        center_mass: Centre of mass, shape (3,).
        model: Friction, and what a contact is.
    """
    rows = jaws.closed
    if not rows.any():
        return None
    points, normals = jaws.points[rows] - center_mass, jaws.normals[rows]
    torsion, patch = np.asarray(model.torsion_radius), None
    half_extents = 0.5 * jaws.extents[rows]  # (b, 2, 2)
    if model.contact != "point" and model.torsion_radius == 0.0:
        pressed = evenly_pressed_radius(half_extents, jaws.area[rows])
        torsion = np.asarray(model.frictions) * pressed
    if model.contact == "patch":
        y_and_z = np.swapaxes(jaws.poses[rows, :3, 1:3], 1, 2)  # (b, 2, 3)
        patch = in_tangent_plane(half_extents[..., None] * y_and_z[:, None], normals)
    return Contacts(points, normals, model.frictions, torsion, patch)
