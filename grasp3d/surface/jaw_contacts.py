"""Contacts of closed jaws: points, or with the patches that the jaws touch."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from grasp3d.arrays import ArrayLike, Bools, Floats, Ints, locked
from grasp3d.contact.contacts import Contacts, evenly_pressed_radius, in_tangent_plane
from grasp3d.hand.closed_jaws import ClosedJaws
from grasp3d.mesh import ObjectMesh
from grasp3d.mesh.surface_points import SurfacePoints
from grasp3d.settings import GraspModel
from grasp3d.stability.located_angles import PairLines
from grasp3d.surface.contacts import NormalSets, SurfaceContacts


@dataclass(frozen=True, eq=False, repr=False)
class JawContacts(SurfaceContacts):
    """Contacts where jaws have closed on an object: patches with one normal each, on no one face.

    The faces of `surface_points` are -1.
    """

    jaws: ClosedJaws
    """Where the jaws touch; all of them close."""

    @classmethod
    def of(cls, mesh: ObjectMesh, jaws: ClosedJaws) -> "JawContacts":
        """The contacts where jaws close on an object, of those that do.

        Args:
            mesh: The object.
            jaws: Where the jaws touch.
        """
        closed = jaws.take(jaws.closed)
        shape = closed.points.shape
        faces, weights = np.full(shape[:2], -1), np.zeros(shape)
        return cls(mesh, SurfacePoints(locked(faces), locked(weights)), closed)

    @property
    def points(self) -> Floats:
        """Positions in the mesh's frame and unit, shape (b, n, 3)."""
        return self.jaws.points

    @cached_property
    def lines(self) -> PairLines:
        """Lines between the contacts of grasps of two, shape (b, 2)."""
        return PairLines.of_contacts(self.contacts(GraspModel()))

    def tilts(self, model: GraspModel) -> ArrayLike:
        """Largest angle between the normal of each contact and any that may be true [rad]."""
        return model.tilt_of_fingers

    def contacts(self, model: GraspModel) -> Contacts:
        """The contacts, relative to the mesh's centre of mass.

        A point has the torsion radius of the model. Otherwise it is that of the patch that is
        touched, evenly pressed, from its area and extents, unless the model has one; a contact with
        a patch also resists rolling, over half the patch's extents along y and z of the gripper,
        projected onto the tangent plane.

        Args:
            model: Friction, and what a contact is.
        """
        points, normals = self.jaws.points - self.mesh.center_mass, self.jaws.normals
        torsion, patch = np.asarray(model.torsion_radius), None
        half_extents = 0.5 * self.jaws.extents  # (b, n, 2)
        if model.contact != "point" and model.torsion_radius == 0.0:
            pressed = evenly_pressed_radius(half_extents, self.jaws.area)
            torsion = np.asarray(model.frictions) * pressed
        if model.contact == "patch":
            y_and_z = np.swapaxes(self.jaws.poses[:, :3, 1:3], 1, 2)  # (b, 2, 3)
            patch = in_tangent_plane(half_extents[..., None] * y_and_z[:, None], normals)
        return Contacts(points, normals, model.frictions, torsion, patch)

    def take(self, which: slice | Ints | Bools) -> "JawContacts":
        """The chosen grasps."""
        points = SurfacePoints(self.surface_points.faces[which], self.surface_points.weights[which])
        return JawContacts(self.mesh, points, self.jaws.take(which))

    @cached_property
    def _sets(self) -> NormalSets:
        normals = self.jaws.normals.reshape(-1, 3)
        count = len(normals)
        return NormalSets(np.arange(count + 1), normals, np.ones(count, dtype=np.int64), normals)
