"""The critical friction angle: the smallest half-angle of the cones at which a grasp closes.

beta* = max over u of min_i phi_i(u) - pi / 2, where phi_i(u) is the angle between contact i's
normal and the force g_i = u_f + u_tau x p_i that does work in direction u. A grasp is in force
closure exactly when the friction angle exceeds it.
"""

import math

import numpy as np

from grasp3d._kernels.coplanar_contacts import critical_of_three, make_plane
from grasp3d._kernels.frictionless_closure import frictionless_depth, make_cells
from grasp3d._kernels.wrench_problem import SIGN
from grasp3d.arrays import Bools, Floats
from grasp3d.contact.contacts import Contacts, centred
from grasp3d.errors import SettingError
from grasp3d.quality.certificates import Status
from grasp3d.quality.wrench_problem import WrenchProblem
from grasp3d.quality.wrenches import span, wrench_axes

RIGHT = math.pi / 2.0

COARSE = 0.1
"""Width of the first search for a negative angle [rad]."""

MAX_CELLS = 1 << 22
"""Parts of the sphere of directions after which the search for a negative angle gives up."""


def angles_between(a: Floats, b: Floats) -> Floats:
    """Angles between vectors (..., 3) [rad], exact near 0 and pi."""
    angles: Floats = np.arctan2(np.linalg.norm(np.cross(a, b), axis=-1), (a * b).sum(axis=-1))
    return angles


def critical_friction_angle(
    contacts: Contacts, *, tolerance: float = 1e-4, threads: int | None = 1
) -> Floats:
    """Friction angle above which a grasp is in force closure.

    Two contacts have a closed form. For more the angle is bracketed: three can balance in the plane
    through them only, where six planar wrenches settle closure (Ponce & Faverjon 1995); for more a
    direction that separates the grasp at some angle proves a lower bound, forces that balance an
    upper one. Friction and torsion of the contacts play no part.

    Args:
        contacts: The contacts.
        tolerance: Three contacts and more: width of the bracket [rad]; its upper end is returned.
        threads: Threads for a batch; None: one per processor.

    Returns:
        Angles [rad], shape (...). Negative where the grasp closes without friction and withstands
        tilts of the normals by as much (7 contacts and more). For two contacts up to pi; for more,
        pi/2 where no friction closes the grasp. inf where no forces can balance: one contact.

    Raises:
        SettingError: A tolerance that is not above 0.
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
        angles = _of_triples(points, normals, tolerance, threads)
    else:
        angles = _bracketed(points, normals, tolerance, threads)
    angles = angles.reshape(contacts.batch)
    angles.flags.writeable = False
    return np.asarray(angles)[()]


def _of_pairs(points: Floats, normals: Floats) -> Floats:
    """Closed form of two contacts: the better of squeezing and expanding."""
    line = points[:, 1] - points[:, 0]
    squeeze = np.maximum(angles_between(normals[:, 0], line), angles_between(normals[:, 1], -line))
    expand = np.maximum(angles_between(normals[:, 0], -line), angles_between(normals[:, 1], line))
    # Contacts at one place push along any line; the best one lies midway.
    together = angles_between(normals[:, 0], -normals[:, 1]) / 2.0
    return np.where((line == 0.0).all(axis=1), together, np.minimum(squeeze, expand))


def _of_triples(points: Floats, normals: Floats, tolerance: float, threads: int | None) -> Floats:
    """Three contacts, in the plane through them; on one line they have none."""
    angles = np.empty(len(points))
    around, _, _ = centred(points)
    critical_of_three(around, np.ascontiguousarray(normals), tolerance, make_plane(), angles)
    on_line = np.flatnonzero(np.isnan(angles))
    angles[on_line] = _bracketed(points[on_line], normals[on_line], tolerance, threads)
    return angles


def _bracketed(points: Floats, normals: Floats, tolerance: float, threads: int | None) -> Floats:
    """Upper ends of brackets about the critical angles of three contacts or more."""
    points, _, _ = centred(points)
    low, high = np.zeros(len(points)), np.full(len(points), RIGHT)
    closes, _, _ = _test(points, normals, low, threads)
    without = np.flatnonzero(closes)
    high[without] = low[without] = _depths(points[without], normals[without], tolerance)
    while (open_ := np.flatnonzero(high - low > tolerance)).size:
        middle = 0.5 * (low[open_] + high[open_])
        closes, below, above = _test(points[open_], normals[open_], middle, threads)
        low[open_] = np.where(closes, low[open_], np.clip(below, middle, high[open_]))
        high[open_] = np.where(closes, np.clip(above, low[open_], middle), high[open_])
    return high


def _depths(points: Floats, normals: Floats, tolerance: float) -> Floats:
    """Critical angles, 0 or negative, of grasps that close without friction."""
    angles = np.zeros(len(points))
    cells = make_cells(points.shape[1])
    for g, axes in enumerate(wrench_axes(points, normals, np.zeros(points.shape[:2]), 1.0)):
        basis = span(axes[:, :3].reshape(-1, 6))
        inside = np.zeros((len(axes), 3, 6))
        inside[..., : len(basis)] = axes[:, :3] @ basis.T
        angles[g] = -math.asin(_depth(inside, len(basis), tolerance, cells))
    return angles


def _depth(axes: Floats, rank: int, tolerance: float, cells: tuple[Floats, Floats]) -> float:
    """Cosine of work to some contact's normal that every direction reaches.

    Searched ever finer: what a coarse search finds makes the next one quick.
    """
    found, sure, width = 1.0, 0.0, COARSE
    while found > 0.0:
        width = max(width, tolerance)
        found, reached = frictionless_depth(axes, rank, found, width, MAX_CELLS, *cells)
        sure = max(sure, reached)
        if width == tolerance:
            break
        width *= 0.25
    return sure


def _test(
    points: Floats, normals: Floats, angles: Floats, threads: int | None
) -> tuple[Bools, Floats, Floats]:
    """(closes, below, above): closure at given angles, and the bounds on beta* that it proves."""
    batch = Contacts(points, normals, friction=0.0)
    problem = WrenchProblem.of_contacts(batch, None, "total", torque_scale=1.0)
    answers = problem.at_angles(angles).solve(SIGN, threads=threads)
    u = answers.direction[:, None]
    work = u[..., :3] + np.cross(u[..., 3:], points)  # (b, n, 3)
    below = angles_between(work, normals).min(axis=1) - RIGHT
    across = np.hypot(answers.forces[..., 1], answers.forces[..., 2])
    above = np.arctan2(across, answers.forces[..., 0]).max(axis=1)
    below = np.where(answers.status == Status.UNDECIDED, angles, below)
    return answers.closed, below, np.where(np.isnan(above), angles, above)
