"""Critical friction angles of grasps on a surface: over the worst and the best normals.

On a crease or at a corner a contact may have any normal between those of the faces, so that a grasp
has two critical friction angles. S is decided by the one over the worst normals, U by the one over
the best normals.
"""

import math

import numpy as np

from grasp3d.arrays import locked
from grasp3d.quality.critical_angle import check_tolerance
from grasp3d.stability.normal_sets import WorstAndBest
from grasp3d.stability.uncertain_angles import uncertain_angles
from grasp3d.surface.contacts import SurfaceContacts
from grasp3d.system.context import report_progress

SAME_POINT = 1e-12
"""Distance up to which contacts are at the same point, in object sizes."""

CHUNK = 1 << 14
"""Grasps that are evaluated at once."""


def critical_angles(
    contacts: SurfaceContacts, *, location_error: float = 0.0, tolerance: float = 1e-4
) -> WorstAndBest:
    """Critical friction angles of grasps over the worst and over the best normals of the contacts.

    Two contacts have a closed form. Of more, none on a crease, both are the critical friction
    angle. A contact on a crease has the cap about its set of normals: the worst is never too small
    and the best never too large. Where the set spans every direction the grasp is neither surely
    stable nor surely unstable. Contacts that are all at one point are no grasp, but at an edge they
    may push against each other: their best angle is a lower bound.

    Args:
        contacts: Grasps on a surface.
        location_error: Largest distance between true and perceived contact points [m]: lines
            between them turn, and normals as the surface does nearby; see
            `stability.uncertain_angles`.
        tolerance: Three contacts and more: as in `critical_friction_angle` [rad].

    Returns:
        (worst, best) [rad], shape (b,) each. For two contacts up to pi; for more, pi/2 where the
        grasp is force-closed at no friction. The worst is inf where all contacts are at the same
        point.

    Raises:
        SettingError: A tolerance that is not above 0.
    """
    check_tolerance(tolerance)
    bounds = np.full((2, contacts.size), math.inf)
    smooth = ~contacts.on_crease.any(axis=1)
    for alike in (smooth, ~smooth):
        rows = np.flatnonzero(alike)
        for start in range(0, len(rows), CHUNK):
            chunk = rows[start : start + CHUNK]
            bounds[:, chunk] = _angles(contacts.take(chunk), location_error, tolerance)
            report_progress((start + len(chunk)) / contacts.size)
    distances = np.linalg.norm(contacts.points - contacts.points[:, :1], axis=2)
    bounds[0, (distances <= SAME_POINT * contacts.mesh.size).all(axis=1)] = math.inf
    return locked(bounds[0]), locked(bounds[1])


def _angles(contacts: SurfaceContacts, location_error: float, tolerance: float) -> WorstAndBest:
    location = turns = None
    if location_error > 0.0:
        location = np.full(contacts.points.shape[:2], location_error)
        turns = contacts.turns(location_error)
    return uncertain_angles(
        contacts.points, contacts.sets, location=location, turns=turns, tolerance=tolerance
    )
