"""The critical friction angle: the friction angle above which a grasp is force-closed.

beta* = max over u of min_i phi_i(u) - pi / 2, where u is an infinitesimal motion of the object,
g_i = u_f + u_tau x p_i its velocity at contact i, and phi_i(u) the angle between g_i and the
normal of contact i. A grasp is force-closed exactly when the friction angle exceeds beta*.
"""

import math

import numpy as np

from grasp3d._kernels.hull.critical_angle import Bracket
from grasp3d._kernels.hull.frictionless_closure import frictionless_depth, make_cells
from grasp3d._kernels.hull.wrench_problem import SIGN
from grasp3d._kernels.search.coplanar_contacts import critical_of_three, make_plane
from grasp3d.arrays import RIGHT_ANGLE, Bools, Floats, angles_between, shaped
from grasp3d.contact.contacts import Contacts, centred
from grasp3d.errors import SettingError
from grasp3d.quality.closure import Status
from grasp3d.quality.wrench_problem import WrenchProblem
from grasp3d.quality.wrenches import EpsilonOptions, span, wrench_axes

MAX_CELLS = 1 << 20
"""Cells of the sphere of directions after which the search for a negative angle ends."""

FIRST = 0.01
"""Friction angle at which closure is tried first [rad]: most grasps need more."""


def critical_friction_angle(contacts: Contacts, *, tolerance: float = 1e-4) -> Floats:
    """Friction angle above which a grasp is force-closed.

    Two contacts have a closed form. For more the angle is bracketed: three can be in equilibrium
    only in the plane through them, where six planar wrenches decide closure (Ponce & Faverjon
    1995); for more a direction that separates the grasp at some angle proves a lower bound, forces
    in equilibrium an upper one. Friction and torsion of the contacts do not matter.

    Args:
        contacts: The contacts.
        tolerance: Three contacts and more: width of the bracket [rad]; its upper end is returned.

    Returns:
        Angles [rad], shape (...). Negative where the grasp is force-closed without friction, and
        remains so for tilts of the normals by as much (7 contacts and more). For two contacts up to
        pi; for more, pi/2 where the grasp is force-closed at no friction. inf for one contact,
        where no forces are in equilibrium.

    Raises:
        SettingError: A tolerance that is not above 0.

    Example:
        The second of two opposing fingers is beside the line of the first:

        >>> import numpy as np
        >>> import grasp3d
        >>> contacts = grasp3d.Contacts([[-1, 0, 0], [1, 0.6, 0]], [[1, 0, 0], [-1, 0, 0]])
        >>> print(f"{np.degrees(grasp3d.critical_friction_angle(contacts)):.1f} degrees")
        16.7 degrees
    """
    if not tolerance > 0.0:
        raise SettingError(f"tolerance must be above 0; got {tolerance}")
    points = contacts.points.reshape(-1, contacts.count, 3)
    normals = contacts.normals.reshape(points.shape)
    if contacts.count == 1:
        angles = np.full(len(points), math.inf)
    elif contacts.count == 2:
        angles = _of_pairs(points, normals)
    elif contacts.count == 3:
        angles = _of_triples(points, normals, tolerance)
    else:
        angles = _bracketed(points, normals, tolerance)
    critical: Floats = shaped(angles, contacts.batch)
    return critical


def _of_pairs(points: Floats, normals: Floats) -> Floats:
    """Closed form of two contacts: the better of squeezing and expanding."""
    line = points[:, 1] - points[:, 0]
    squeeze = np.maximum(angles_between(normals[:, 0], line), angles_between(normals[:, 1], -line))
    expand = np.maximum(angles_between(normals[:, 0], -line), angles_between(normals[:, 1], line))
    # Contacts at the same point push along any line; the best one lies midway.
    coincident = angles_between(normals[:, 0], -normals[:, 1]) / 2.0
    return np.where((line == 0.0).all(axis=1), coincident, np.minimum(squeeze, expand))


def _of_triples(points: Floats, normals: Floats, tolerance: float) -> Floats:
    """Three contacts, in the plane through them; contacts on one line are bracketed."""
    angles = np.empty(len(points))
    # Scaled by powers of 2, which keeps the differences of nearby points exact.
    _, _, size = centred(points)
    scaled = np.ldexp(points, -np.frexp(size)[1])
    critical_of_three(scaled, np.ascontiguousarray(normals), tolerance, make_plane(), angles)
    on_line = np.flatnonzero(np.isnan(angles))
    angles[on_line] = _bracketed(points[on_line], normals[on_line], tolerance)
    return angles


def _bracketed(points: Floats, normals: Floats, tolerance: float) -> Floats:
    """Upper ends of intervals that contain the critical angles of three contacts or more."""
    points, _, _ = centred(points)
    problem = WrenchProblem.of_contacts(Contacts(points, normals, friction=0.0), EpsilonOptions())
    low, high = np.zeros(len(points)), np.full(len(points), RIGHT_ANGLE)
    closed, _, _ = _closure_at(problem, points, normals, low)
    frictionless = np.flatnonzero(closed)
    negative = _negative_angles(points[frictionless], normals[frictionless], tolerance)
    high[frictionless] = low[frictionless] = negative
    active = np.flatnonzero(high - low > tolerance)
    width = np.full(len(active), tolerance)
    bracket = Bracket(points[active], normals[active], low[active], high[active], width)
    problem.take(active).at_angles(np.full(len(active), FIRST)).narrow(bracket)
    low[active], high[active] = bracket.low, bracket.high
    while (active := np.flatnonzero(high - low > tolerance)).size:  # where closure has no proof
        angles = 0.5 * (low[active] + high[active])
        closed, lower, upper = _closure_at(
            problem.take(active), points[active], normals[active], angles
        )
        low[active] = np.where(closed, low[active], np.clip(lower, angles, high[active]))
        high[active] = np.where(closed, np.clip(upper, low[active], angles), high[active])
    return high


def _negative_angles(points: Floats, normals: Floats, tolerance: float) -> Floats:
    """Critical angles, 0 or negative, of grasps that are force-closed without friction."""
    angles = np.zeros(len(points))
    cells = make_cells(points.shape[1])
    for g, axes in enumerate(wrench_axes(points, normals, np.zeros(points.shape[:2]), 1.0)):
        basis = span(axes[:, :3].reshape(-1, 6))
        in_span = np.zeros((len(axes), 3, 6))
        in_span[..., : len(basis)] = axes[:, :3] @ basis.T
        _, depth = frictionless_depth(in_span, len(basis), tolerance, MAX_CELLS, cells)
        angles[g] = -math.asin(depth)
    return angles


def _closure_at(
    problem: WrenchProblem, points: Floats, normals: Floats, angles: Floats
) -> tuple[Bools, Floats, Floats]:
    """(closed, lower, upper): closure at given angles, and the bounds on beta* that follow."""
    results = problem.at_angles(angles).solve(SIGN)
    u = results.direction[:, None]
    velocities = u[..., :3] + np.cross(u[..., 3:], points)  # (b, n, 3)
    lower = angles_between(velocities, normals).min(axis=1) - RIGHT_ANGLE
    tangential = np.hypot(results.forces[..., 1], results.forces[..., 2])
    upper = np.arctan2(tangential, results.forces[..., 0]).max(axis=1)
    # Exactly balanced forces are off by up to `slack` times the sine of the angle to the cone.
    upper += 0.5 * math.pi * results.slack * (angles - upper)
    lower = np.where(results.status == Status.UNDECIDED, angles, lower)
    return results.closed, lower, np.where(np.isnan(upper), angles, upper)
