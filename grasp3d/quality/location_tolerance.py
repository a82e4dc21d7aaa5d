"""How far contacts may be from where they are perceived, and the grasp is still force-closed.

A contact that is d away from its perceived position applies the torque of its force there and up to
d times the force more. Its support function falls by at most d |u_tau|. So all grasps with contacts
within d_i of the perceived positions are force-closed if

    max over i of h_i(u) - d_i |u_tau| > 0 for all u,

that is if the convex hull of the contacts' wrenches, forces bounded by 1 / d_i, contains every
torque of length 1 in its interior: epsilon with another ruler, like the grip force. For equal d it
contains the ball of torques of radius d, which is smaller than the ball of wrenches that bounds d
by epsilon, and depends neither on the centre of mass nor on a torque scale.
"""

from dataclasses import replace

import numpy as np

from grasp3d.arrays import ArrayLike, Floats, angles_between
from grasp3d.contact.contacts import Contacts, per_contact
from grasp3d.errors import SettingError
from grasp3d.quality.force_problem import ForceProblem
from grasp3d.quality.tasks import Ellipsoid

TORQUES = Ellipsoid(np.eye(6)[3:])
"""Torques of length 1."""

LARGEST_RATIO = 1e3
"""Largest location error of a contact over that of another one; smaller errors count as larger."""


def location_tolerance(
    contacts: Contacts,
    *,
    relative_errors: ArrayLike = 1.0,
    cone_offset: ArrayLike = 0.0,
    rtol: float = 1e-2,
) -> Floats:
    """Largest location error of the contacts at which grasps are surely force-closed.

    Wan & Howe 2018 (Sec. III-A) name the uncertainty of contact locations. Normals do not change
    with the location. For two hard fingers the value is exact: the line between the contacts turns
    by asin(2 d / opening). For three and more it is safe: the grasp may tolerate more.

    Args:
        contacts: Point contacts; torsion does not matter.
        relative_errors: Location errors of the contacts relative to each other, at least 0, the
            largest 1: one value or shape (..., n).
        cone_offset: Angle added to the cones' half-angles [rad], one value or shape (..., n).
            Minus half the sensor resolution: for every normal within it.
        rtol: Three contacts and more: accuracy, as a fraction of the value.

    Returns:
        Lengths in the unit of the contacts' points, shape (...); 0 where the grasp is not
        force-closed at the perceived positions.

    Raises:
        SettingError: A setting outside its range, or contacts with patches.

    Example:
        Three fingers around a disc of radius 30 mm tolerate that much:

        >>> import numpy as np
        >>> import grasp3d
        >>> from grasp3d.quality import location_tolerance
        >>> angles = np.radians([0.0, 120.0, 240.0])
        >>> points = 30.0 * np.stack([np.cos(angles), np.sin(angles), 0.0 * angles], axis=1)
        >>> contacts = grasp3d.Contacts(points, -points, friction=0.5)
        >>> print(f"{location_tolerance(contacts):.1f} mm")
        8.3 mm
    """
    if contacts.patch is not None:
        raise SettingError(
            "the location tolerance is that of point contacts; give contacts.without_patches()"
        )
    relative = per_contact("relative errors", relative_errors, contacts)
    largest = relative.max(initial=0.0)
    if not ((relative >= 0.0).all() and abs(largest - 1.0) <= 1e-9):
        raise SettingError("relative errors must be at least 0, and the largest of them 1")
    if contacts.count == 2:
        return _of_pairs(contacts, relative, cone_offset)
    hard = Contacts(contacts.points, contacts.normals, contacts.friction)
    forces = ForceProblem.of_contacts(hard, bound="total", lengths=True, cone_offset=cone_offset)
    scale = 1.0 / np.maximum(relative, 1.0 / LARGEST_RATIO).reshape(-1, contacts.count)
    axes_of = forces.problem.wrenches_of
    scaled = replace(
        forces.problem, wrenches_of=lambda chunk: axes_of(chunk) * scale[chunk, :, None, None]
    )
    force = replace(forces, problem=scaled).of_task(TORQUES, rtol).upper
    usable = ~forces.problem.tilts_exceed_friction
    return np.asarray(np.where(usable, 1.0 / force, 0.0).reshape(contacts.batch))[()]


def _of_pairs(contacts: Contacts, relative: Floats, cone_offset: ArrayLike) -> Floats:
    """Two contacts: opening x sin(the angle by which their line may turn), exact."""
    half_angles = contacts.friction_angle + per_contact("cone offset", cone_offset, contacts)
    line = contacts.points[..., 1, :] - contacts.points[..., 0, :]
    left = [
        np.minimum(
            half_angles[..., 0] - angles_between(contacts.normals[..., 0, :], side * line),
            half_angles[..., 1] - angles_between(contacts.normals[..., 1, :], -side * line),
        )
        for side in (1.0, -1.0)
    ]
    turn = np.clip(np.maximum(*left), 0.0, np.pi / 2.0)
    opening = np.linalg.norm(line, axis=-1)
    return np.asarray(opening * np.sin(turn) / relative.sum(axis=-1))[()]
