"""A grasp of a hand with joints: contacts, and the forces that the hand can press there."""

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from grasp3d.arrays import ArrayLike, Floats, Ints, locked, short_repr
from grasp3d.contact.contacts import Contacts, tilts_of
from grasp3d.contact.friction_cones import tangents
from grasp3d.errors import ContactError
from grasp3d.quality.hand_forces.actuation import Actuation
from grasp3d.quality.wrenches import wrench_axes

STILL = 1e-13
"""Relative velocity, relative to the object's, that is a rounding error."""

POINTED = 1e-9
"""Half-angle of a friction cone [rad] up to which it is a ray."""


@dataclass(frozen=True, eq=False, init=False)
class HandGrasp:
    """Hard point contacts of one grasp of a hand with joints."""

    contacts: Contacts
    jacobian: Floats
    """Velocities of the links' contact points per speed of the joints [m/rad], (n, 3, p); 0 at the
    palm."""
    actuation: Actuation
    most_force: float
    """Largest length of each contact's force [N]; inf: no limit."""

    __repr__ = short_repr

    def __init__(
        self,
        contacts: Contacts,
        jacobian: ArrayLike,
        actuation: Actuation,
        *,
        most_force: float = np.inf,
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
        if contacts.batch or contacts.torsion_radius.any():
            raise ContactError(
                "joint torques are for hard contacts of one grasp: give the points of a patch as "
                "contacts of their own"
            )
        rows = np.asarray(jacobian, dtype=np.float64)
        shape = (contacts.count, 3, actuation.joints)
        if rows.shape != shape or not np.isfinite(rows).all():
            raise ContactError(f"the Jacobian must be finite, of shape {shape}; got {rows.shape}")
        if not most_force > 0.0:
            raise ContactError(f"the largest contact force must be above 0 [N]; got {most_force}")
        object.__setattr__(self, "contacts", contacts)
        object.__setattr__(self, "jacobian", locked(rows))
        object.__setattr__(self, "actuation", actuation)
        object.__setattr__(self, "most_force", float(most_force))

    def carrying_links(self, acceleration: Floats) -> "HandGrasp":
        """The same grasp with the weight of the links under an acceleration (3,) [m/s^2]."""
        drives = self.actuation.carrying_links(acceleration)
        return HandGrasp(self.contacts, self.jacobian, drives, most_force=self.most_force)

    def half_angles(self, tilt: ArrayLike = 0.0) -> Floats:
        """Half-angles of the cones that are in the friction cones at all normals within a tilt.

        Args:
            tilt: Largest angle between true and given normals [rad], one value or shape (n,).

        Returns:
            beta - a, shape (n,); below 0 where no force is safe.
        """
        return np.asarray(self.contacts.friction_angle - tilts_of(tilt, self.contacts)[0])

    @cached_property
    def length(self) -> float:
        """Unit of length for torques about the centre of mass [unit of the points]."""
        return float(np.linalg.norm(self.contacts.points, axis=1).max()) or 1.0

    @cached_property
    def scale(self) -> Floats:
        """Factors of a wrench's six numbers: 1, and `length` for torques."""
        return np.repeat([1.0, self.length], 3)

    @cached_property
    def torque(self) -> float:
        """Unit of torque for the drives [N m]: their largest finite limit."""
        limits = np.abs([self.actuation.lower, self.actuation.upper])
        return float(np.where(np.isfinite(limits), limits, 0.0).max(initial=0.0)) or 1.0

    @cached_property
    def force(self) -> float:
        """Unit of force [N]: what the strongest drive exerts at the longest arm."""
        arm = float(np.linalg.norm(self.jacobian, axis=1).max(initial=0.0))
        driven = self.torque / arm if arm > 0.0 and self.actuation.joints else np.inf
        force = min(driven, self.most_force)
        return force if np.isfinite(force) else 1.0

    @cached_property
    def frames(self) -> Floats:
        """Normal and tangents of each contact, as rows, shape (n, 3, 3)."""
        normals = self.contacts.normals
        return np.stack([normals, *tangents(normals)], axis=1)

    @cached_property
    def wrenches(self) -> Floats:
        """Wrenches of unit forces along the frames, torques divided by `length`, (6, 3 n)."""
        contacts = self.contacts
        axes = wrench_axes(
            contacts.points / self.length, contacts.normals, np.zeros(contacts.count), 1.0
        )
        return np.ascontiguousarray(axes[:, :3].reshape(-1, 6).T)

    @cached_property
    def joint_torques(self) -> Floats:
        """J^T in the frames, for forces and torques in `force` and `torque`, shape (p, 3 n)."""
        shape = (3 * self.contacts.count, self.actuation.joints)
        rows = np.reshape(self.frames @ self.jacobian, shape)
        return rows.T * (self.force / self.torque)

    def velocities(self, twist: Floats, motion: Floats) -> Floats:
        """Velocity of the object relative to the links, e = G^T u - J v, in the frames, (n, 3).

        Args:
            twist: Velocity and angular velocity of the object, (6,).
            motion: Speeds of the joints, (p,).
        """
        moving = (twist * self.scale) @ self.wrenches
        driven = motion @ self.joint_torques * (self.torque / self.force)
        return np.reshape(moving - driven, (-1, 3))

    def openings(self, twist: Floats, motion: Floats) -> Floats:
        """Largest half-angles of cones whose forces do no work on motions of object and hand, (n,).

        The angle between the relative velocity and the normal, less 90 degrees; inf where it is 0.
        """
        e = self.velocities(twist, motion)
        sideways = np.sqrt(e[:, 1] ** 2 + e[:, 2] ** 2)
        speed = np.abs(twist * self.scale).max()
        still = np.abs(e[:, 0]) + sideways <= STILL * speed
        return np.where(still, np.inf, np.arctan2(-e[:, 0], sideways))

    def balance(self, forces: Floats) -> Floats:
        """Wrench of contact forces (n, 3) about the centre of mass, (6,)."""
        moments = np.cross(self.contacts.points, forces)
        return np.concatenate([forces.sum(axis=0), moments.sum(axis=0)])

    def joint_loads(self, forces: Floats) -> Floats:
        """Torques J^T f that contact forces (n, 3) need [N m], shape (p,)."""
        return np.asarray(np.einsum("nip,ni->p", self.jacobian, forces))


class ConeRows(NamedTuple):
    """Rows of a cone program that keep forces, its first unknowns, in cones."""

    equations: Floats
    """Components that are 0, shape (e, 3 n)."""
    pressing: Floats
    """Components that are at least 0, shape (i, 3 n)."""
    cones: Floats
    """Components of second-order cones, shape (3 c, 3 n)."""
    round: Ints
    """Contacts with second-order cones, (c,)."""


def cone_rows(half_angles: Floats) -> ConeRows:
    """Rows for cones of half-angles (n,), at most pi / 2; below 0 no force is in the cone."""
    rows = np.eye(3 * len(half_angles)).reshape(-1, 3, 3 * len(half_angles))
    none, ray = half_angles < -POINTED, np.abs(half_angles) <= POINTED
    both = none | ray
    scaled = cone_factors(half_angles)[:, :, None] * rows
    return ConeRows(
        np.concatenate([rows[none, 0], rows[both][:, 1:].reshape(-1, rows.shape[2])]),
        rows[ray, 0],
        scaled[~both].reshape(-1, rows.shape[2]),
        np.flatnonzero(~both),
    )


def cone_factors(half_angles: Floats) -> Floats:
    """Factors of forces in frames that make them vectors of second-order cones, shape (n, 3)."""
    return np.stack([np.sin(half_angles), *[np.cos(half_angles)] * 2], axis=1)


def widened(rows: Floats, columns: int) -> Floats:
    """Rows with 0 for further unknowns, so many in all."""
    wide = np.zeros((len(rows), columns))
    wide[:, : rows.shape[1]] = rows
    return wide
