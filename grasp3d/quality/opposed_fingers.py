"""Grip force of two opposed fingers against one wrench, in closed form.

Both normals lie on the line through the contacts. Balance then fixes the tangential forces of both
fingers, the difference of their normal forces N_1 - N_2 and the sum of their torsional moments; the
only freedom is how hard they press. With a_i the tangential forces divided by friction, e_i the
torsion radii and T the torque about the line, the smallest pressure satisfies (limit surface of
Howe & Cutkosky, IJRR 1996)

    e_1 sqrt(N_1^2 - a_1^2) + e_2 sqrt(N_2^2 - a_2^2) = |T|,    N_i >= a_i,

and for equal fingers with the weight across the line at its middle, a distance l off it,
N = 1/2 m g sqrt(1 / friction^2 + (l / e)^2): the makers' m g / (2 friction) where l = 0.
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize.elementwise import find_root

from grasp3d.arrays import Bools, Floats
from grasp3d.contact.contacts import Contacts

ALIGNED = 1e-12
"""Largest sine of the angle between the normals and the line."""

NO_TORQUE = 1e-9
"""Torque about the line, relative to the wrench, that is a rounding error."""


@dataclass(frozen=True, eq=False)
class OpposedForces:
    """The contact forces of two opposed fingers that press as little as possible."""

    normal: Floats
    """Normal forces, shape (b, 2); inf where no force suffices."""
    tangential: Floats
    """Tangential forces, shape (b, 2, 3)."""
    torsion: Floats
    """Torsional moments about the contacts' normals, shape (b, 2)."""

    def bounded(self, bound: str) -> Floats:
        """The smallest bound of the contact forces, of the kind that `grip_force` takes, (b,)."""
        if bound == "total":
            return np.asarray(self.normal.sum(axis=-1) + 0.0)
        if bound == "norm":
            sideways = np.linalg.norm(self.tangential, axis=-1)
            return np.asarray(np.hypot(self.normal, sideways).max(axis=-1))
        return np.asarray(self.normal.max(axis=-1) + 0.0)  # never -0

    def proofs(self, contacts: Contacts, bound: str) -> tuple[Floats, Bools]:
        """Directions (b, 6) that prove the bounds, and where both fingers twist, so that they do.

        At each contact the velocity is normal to the limit surface at the contact force. The
        velocity along the line is free; it is such that the forces of the bound alone count.

        Args:
            contacts: The grasps.
            bound: As `bounded` takes it; 'norm' has no directions.
        """
        line, length = _line(contacts)
        twisting = np.isfinite(self.normal) & (self.torsion != 0.0) & (bound != "norm")
        proven = np.asarray(twisting.all(axis=-1))
        normal, torsion = np.where(proven[:, None], (self.normal, self.torsion), 1.0)
        radius = np.where(proven[:, None], contacts.torsion_radius, 1.0)
        spin = np.sign(torsion[:, :1])
        scale = radius**2 / np.abs(torsion)  # of the velocities, for a spin of 1
        sliding = (scale / contacts.friction**2)[..., None] * self.tangential
        pressing = scale * normal  # support functions of the contacts at rest along the line
        if bound == "total":
            along = 0.5 * (pressing[:, 1] - pressing[:, 0])
        else:
            harder = normal[:, 0] > normal[:, 1]
            along = np.where(harder, pressing[:, 1], -pressing[:, 0])
        turning = spin * line + np.cross(line, sliding[:, 1] - sliding[:, 0]) / length[:, None]
        moving = sliding[:, 0] + along[:, None] * line - np.cross(turning, contacts.points[:, 0])
        return np.concatenate([moving, turning], axis=-1), proven

    def in_contact_frame(self, normals: Floats) -> Floats:
        """Forces along x, y, z and torsional moments, as of `ForceCertificate`, (b, 2, 4)."""
        normal = np.where(np.isfinite(self.normal), self.normal, math.nan)[..., None]
        forces = normal * normals + self.tangential
        return np.concatenate([forces, self.torsion[..., None]], axis=-1)


def are_opposed(contacts: Contacts) -> Bools:
    """Whether grasps of a flat batch are two points that push toward each other, (b,).

    Patches divide the torques across the line in many ways, for which there is no closed form.
    """
    if contacts.count != 2 or contacts.patch is not None:
        return np.zeros(len(contacts.points), dtype=np.bool_)
    line, length = _line(contacts)
    first, second = contacts.normals[:, 0], contacts.normals[:, 1]
    aligned = (np.linalg.norm(np.cross(first, line), axis=-1) <= ALIGNED) & (
        np.linalg.norm(np.cross(second, line), axis=-1) <= ALIGNED
    )
    toward = ((first * line).sum(axis=-1) > 0.0) & ((second * line).sum(axis=-1) < 0.0)
    friction = (contacts.friction > 0.0).all(axis=-1)
    return np.asarray(aligned & toward & friction & (length > 0.0))


def opposed_forces(contacts: Contacts, wrenches: Floats) -> OpposedForces:
    """Forces of two opposed fingers that resist wrenches.

    Args:
        contacts: Grasps for which `are_opposed` holds, a flat batch.
        wrenches: Wrenches that act on the object, shape (b, 6).
    """
    line, length = _line(contacts)
    force, torque = -wrenches[:, :3], -wrenches[:, 3:]
    about_first = torque - np.cross(contacts.points[:, 0], force)
    twist = (about_first * line).sum(axis=-1)
    across = about_first - twist[:, None] * line
    along = (force * line).sum(axis=-1)
    second = np.cross(across, line) / length[:, None]
    tangential = np.stack([force - along[:, None] * line - second, second], axis=1)
    least = np.linalg.norm(tangential, axis=-1) / contacts.friction  # (b, 2)
    size = np.linalg.norm(force, axis=-1) * (length + np.linalg.norm(contacts.points[:, 0], axis=1))
    size += np.linalg.norm(torque, axis=-1)
    twist = np.where(np.abs(twist) <= NO_TORQUE * size, 0.0, twist)
    pressing = _pressing(np.abs(twist), least, along, contacts.torsion_radius)
    normal = np.stack([pressing + along, pressing], axis=-1)
    return OpposedForces(normal, tangential, _torsion(normal, least, contacts, twist))


def _line(contacts: Contacts) -> tuple[Floats, Floats]:
    """Directions from the first contacts to the second ones (b, 3), and distances (b,)."""
    difference = contacts.points[:, 1] - contacts.points[:, 0]
    length = np.linalg.norm(difference, axis=-1)
    return difference / np.where(length > 0.0, length, 1.0)[:, None], length


def _capacity(
    normal: Floats, along: Floats, first: Floats, second: Floats, e1: Floats, e2: Floats
) -> Floats:
    """Torque about the line that both fingers resist when the second one presses so hard."""
    spare = np.maximum(normal + along - first, 0.0) * (normal + along + first)
    other = np.maximum(normal - second, 0.0) * (normal + second)
    return np.asarray(e1 * np.sqrt(spare) + e2 * np.sqrt(other))


def _missing(normal: Floats, *values: Any) -> Floats:
    """`_capacity` less the torque, the last of the values."""
    return np.asarray(_capacity(normal, *values[:-1]) - values[-1])


def _pressing(twist: Floats, least: Floats, along: Floats, radius: Floats) -> Floats:
    """Smallest normal force of the second finger, shape (b,)."""
    first, second = least.T
    lowest = np.maximum(np.maximum(second, first - along), np.maximum(0.0, -along))
    e1, e2 = radius.T
    pressing = np.where(twist > 0.0, math.inf, lowest)
    enough = _capacity(lowest, along, first, second, e1, e2) >= twist
    pressing = np.where(enough, lowest, pressing)
    searched = np.flatnonzero(~enough & (np.maximum(e1, e2) > 0.0))
    if searched.size:
        chosen = (along, first, second, e1, e2, twist)
        rest = tuple(values[searched] for values in chosen)
        # Pressing by this much more, either finger resists the torque by itself.
        more = twist / np.maximum(e1, e2) + np.maximum(first, second) + np.abs(along)
        found = find_root(
            _missing,
            (lowest[searched], (lowest + more)[searched]),
            args=rest,
            tolerances={"xrtol": 4e-16, "xatol": 0.0, "fatol": 0.0, "frtol": 0.0},
        )
        pressing[searched] = np.where(found.success, found.x, math.inf)
    return pressing


def _torsion(normal: Floats, least: Floats, contacts: Contacts, twist: Floats) -> Floats:
    """Torsional moments about the contacts' own normals that sum up to the torque, (b, 2)."""
    spare = np.maximum(normal - least, 0.0) * (normal + least)
    most = contacts.torsion_radius * np.sqrt(np.where(np.isfinite(spare), spare, 0.0))
    total = most.sum(axis=-1)
    part = np.where(total > 0.0, twist / np.where(total > 0.0, total, 1.0), 0.0)
    return np.asarray(most * part[:, None] * np.array([1.0, -1.0]))
