"""What uncertain contact locations, and cones that differ, make of critical friction angles.

A contact is anywhere within its location error d of the perceived point; normals do not change with
the location. Labels remain thresholds: S if the worst angle is below beta - alpha/2, U if the best
one is at least beta + alpha/2.

Two contacts: the line between them turns by up to eta = asin((d1 + d2) / opening), in every
direction. The worst angle is beta* + eta, which is exact; the best is at least beta* - eta.

Three and more: a contact that is d away applies the torque of its force there and up to d times the
force more. Its support function falls by at most d |u_tau|, and epsilon by at most d / rho, rho the
torque scale. So the worst angle is the smallest one at which epsilon exceeds d / rho. The larger
rho is, the less of a wrench is force, and the less is given away. The best angle is 0: every S is
correct, and no grasp is U.
"""

import math

import numpy as np

from grasp3d._kernels.search.pair_angles import pair_angles
from grasp3d.arrays import RIGHT_ANGLE, Bools, Floats
from grasp3d.contact.contacts import Contacts
from grasp3d.quality.closure import force_closure
from grasp3d.quality.ferrari_canny import epsilon_with
from grasp3d.quality.wrenches import EpsilonOptions
from grasp3d.stability.normal_sets import Creases

TOLERANCE = 1e-3
"""Three contacts and more: accuracy of the angles [rad]."""

TORQUE_SCALE = 10.0
"""Torque scale of the epsilon that bounds location errors, in extents of the contacts."""

EPSILON_RTOL = 1e-2
"""Accuracy of that epsilon."""

ALL_WRENCHES = 6
"""Dimension of the wrenches that a grasp must resist whose contacts may be beside a line."""


def line_turns(points: Floats, location: Floats | float) -> Floats:
    """Largest angles by which the lines between two contacts turn [rad], shape (b,).

    Args:
        points: Their perceived positions, shape (b, 2, 3).
        location: Sum of both location errors, shape (b,) or one for all.
    """
    openings = np.linalg.norm(points[:, 1] - points[:, 0], axis=1)
    sines = np.ones(len(openings))
    np.divide(location, openings, out=sines, where=openings > location)
    return np.where(np.asarray(location) > 0.0, np.arcsin(sines), 0.0)


def angles_to_line(contacts: Contacts, creases: Creases) -> tuple[Floats, Floats]:
    """Angles between the normals of two contacts and the line from the first to the second.

    Of the second contact those to the reversed line.

    Args:
        contacts: The contacts, shape (b, 2).
        creases: Normals of contacts on creases.

    Returns:
        (largest, smallest) over the normals of each contact [rad], shape (b, 2) each; inf where
        both are at one point.
    """
    sets = [creases.get(i, contacts.normals[:, i, None]) for i in range(2)]
    widths = np.array([rows.shape[1] for rows in sets])
    # The last corner of a set may be repeated.
    counts = np.stack([(rows == rows[:, -1:]).all(axis=2).argmax(axis=1) + 1 for rows in sets], 1)
    start = np.arange(len(contacts.points))[:, None] * widths.sum() + np.array([0, widths[0]])
    normals = np.concatenate(sets, axis=1).reshape(-1, 3)
    largest, smallest = np.empty((2, len(contacts.points), 2))
    pair_angles(
        # Copies: read-only arrays would be compiled for once more.
        np.array(contacts.points), start.ravel(), counts.ravel(), normals, largest, smallest,
    )  # fmt: skip
    return largest, smallest


def spare_of_pairs(largest: Floats, smallest: Floats, cones: Floats, turn: Floats) -> Floats:
    """Angle by which both cones contain the line between two contacts, squeezing or expanding.

    Args:
        largest: Largest angles to the line [rad], as from `angles_to_line`, shape (b, 2).
        smallest: The smallest ones, shape (b, 2).
        cones: Half-angles of the cones [rad], shape (b, 2).
        turn: What is added to each angle [rad], shape (b,).

    Returns:
        Shape (b,): over all normals where the largest are given first, over the best of them where
        the smallest are; -inf where both contacts are at one point.
    """
    turn = turn[:, None]
    squeezing, expanding = cones - (largest + turn), cones - (math.pi - smallest + turn)
    spare = np.maximum(squeezing.min(axis=1), expanding.min(axis=1))
    return np.where(np.isinf(largest).any(axis=1), -math.inf, spare)


def surely_closed_from(
    contacts: Contacts, critical: Floats, wider: Floats, location: Floats
) -> Floats:
    """Friction angles from which grasps of three contacts and more are surely force-closed [rad].

    By bisection, up to a right angle, shape (b,).

    Args:
        contacts: The contacts, shape (b, n).
        critical: Their critical friction angles [rad], shape (b,).
        wider: Angle by which the cone of each contact exceeds that angle, at least 0 [rad], shape
            (b, n) or (1, n).
        location: Location error of each contact, in the unit of the points, likewise.
    """
    if not (wider.any() or location.any()):
        return critical
    low = np.clip(critical - wider.max(axis=1), 0.0, RIGHT_ANGLE)
    high = np.full(len(critical), RIGHT_ANGLE)
    points = contacts.points - contacts.points.mean(axis=1, keepdims=True)
    extents = np.maximum(np.linalg.norm(points, axis=2).max(axis=1), np.finfo(np.float64).tiny)
    scaled = Contacts(points / extents[:, None, None], contacts.normals, friction=0.0)
    allowed = np.broadcast_to(location.max(axis=1) / (TORQUE_SCALE * extents), low.shape)
    wider = np.broadcast_to(wider, points.shape[:2])
    while (active := np.flatnonzero(high - low > TOLERANCE)).size:
        middle = 0.5 * (low[active] + high[active])
        cones = np.minimum(middle[:, None] + wider[active], RIGHT_ANGLE - TOLERANCE)
        sure = _closed(scaled.take(active), cones, allowed[active])
        high[active] = np.where(sure, middle, high[active])
        low[active] = np.where(sure, low[active], middle)
    return high


def _closed(contacts: Contacts, cones: Floats, allowed: Floats) -> Bools:
    """Whether grasps with cones (b, n) are force-closed, with epsilon beyond a bound (b,)."""
    if not allowed.any():
        return np.asarray(force_closure(contacts, cone_offset=cones).closed)
    options = EpsilonOptions(torque_scale=TORQUE_SCALE, rtol=EPSILON_RTOL)
    found = epsilon_with(contacts, options, cone_offset=cones)
    return np.asarray((found.lower > allowed) & (found.rank == ALL_WRENCHES))
