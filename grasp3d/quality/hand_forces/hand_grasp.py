"""A grasp of a hand with joints: contacts, and the forces that the hand can press there."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from grasp3d.arrays import ArrayLike, Floats, locked, short_repr
from grasp3d.contact.contacts import Contacts, finite_numbers
from grasp3d.contact.friction_cones import tangents
from grasp3d.errors import ContactError
from grasp3d.quality.hand_forces.actuation import Actuation
from grasp3d.quality.wrenches import span, wrench_axes

STRUCTURE = 1e3
"""Largest length of a contact's force [N]: what is held by preload that no motor sets, between the
palm and rigid links, is limited by what these bear."""


@dataclass(frozen=True, eq=False, init=False)
class HandGrasp:
    """Hard point contacts of one grasp of a hand with joints."""

    contacts: Contacts
    jacobian: Floats
    """Velocities of the links' contact points per speed of the joints [m/rad], (n, 3, p); 0 at the
    palm."""
    actuation: Actuation
    most_force: float
    """Largest length of each contact's force [N]."""

    __repr__ = short_repr

    def __init__(
        self,
        contacts: Contacts,
        jacobian: ArrayLike,
        actuation: Actuation,
        *,
        most_force: float = STRUCTURE,
    ) -> None:
        """Check the shapes.

        Args:
            contacts: Of one grasp, hard points.
            jacobian: Of shape (n, 3, p).
            actuation: Of the p joints.
            most_force: What link and object bear [N], above 0.

        Raises:
            ContactError: Several grasps, soft contacts, or shapes that do not match.
        """
        if contacts.batch or contacts.torsion_radius.any() or contacts.groups is not None:
            raise ContactError(
                "joint torques are for hard contacts of one grasp: give the points of a patch as "
                "contacts of their own, without groups"
            )
        rows = finite_numbers("the Jacobian", jacobian)
        shape = (contacts.count, 3, actuation.joints)
        if rows.shape != shape:
            raise ContactError(f"the Jacobian must have shape {shape}; got {rows.shape}")
        if not 0.0 < most_force < np.inf:
            raise ContactError(
                f"the largest contact force must be above 0 and finite [N]; got {most_force}"
            )
        object.__setattr__(self, "contacts", contacts)
        object.__setattr__(self, "jacobian", locked(rows))
        object.__setattr__(self, "actuation", actuation)
        object.__setattr__(self, "most_force", float(most_force))

    @cached_property
    def scale(self) -> Floats:
        """Factors of a wrench's six numbers: 1, and for torques the size of the grasp."""
        length = float(np.linalg.norm(self.contacts.points, axis=1).max()) or 1.0
        return np.repeat([1.0, length], 3)

    @cached_property
    def torque(self) -> float:
        """Unit of torque [N m]: the largest finite limit of a motor."""
        limits = self.actuation.limits
        return float(limits[np.isfinite(limits)].max(initial=0.0)) or 1.0

    @cached_property
    def force(self) -> float:
        """Unit of force [N]: what the strongest motor exerts at the longest arm."""
        arm = float(np.linalg.norm(self.jacobian, axis=1).max(initial=0.0))
        return min(self.torque / arm, self.most_force) if arm > 0.0 else self.most_force

    @cached_property
    def wrenches(self) -> Floats:
        """Wrenches of unit forces along normals and tangents, torques by the size, (6, 3 n)."""
        contacts = self.contacts
        points = contacts.points / self.scale[-1]
        axes = wrench_axes(points, contacts.normals, np.zeros(contacts.count), 1.0)
        return np.ascontiguousarray(axes[:, :3].reshape(-1, 6).T)

    @cached_property
    def spanned(self) -> Floats:
        """Orthonormal rows that span those wrenches, shape (r, 6)."""
        return span(self.wrenches.T)

    @cached_property
    def joint_torques(self) -> Floats:
        """Torques J^T of unit forces along normals and tangents [m], shape (p, 3 n)."""
        normals = self.contacts.normals
        frames = np.stack([normals, *tangents(normals)], axis=1)
        shape = (3 * self.contacts.count, self.actuation.joints)
        return np.reshape(frames @ self.jacobian, shape).T
