"""The critical friction angle: the friction angle above which a grasp is force-closed.

beta* = max over u of min_i phi_i(u) - pi / 2, where u is an infinitesimal motion of the object,
g_i = u_f + u_tau x p_i its velocity at contact i, and phi_i(u) the angle between g_i and the
normal of contact i. A grasp is force-closed exactly when the friction angle exceeds beta*.
"""

import math
from dataclasses import dataclass

import numpy as np

from grasp3d._kernels.hull.critical_angle import Bracket
from grasp3d._kernels.hull.frictionless_closure import frictionless_depth, make_cells
from grasp3d._kernels.hull.wrench_problem import SIGN
from grasp3d._kernels.search.coplanar_contacts import critical_of_three, make_plane
from grasp3d.arrays import RIGHT_ANGLE, Bools, Floats, Ints, angles_between, shaped
from grasp3d.contact.contacts import Contacts, centred
from grasp3d.errors import SettingError
from grasp3d.quality.closure import Status
from grasp3d.quality.wrench_problem import WrenchProblem
from grasp3d.quality.wrenches import EpsilonOptions, span, wrench_axes

MAX_CELLS = 1 << 20
"""Cells of the sphere of directions after which the search for a negative angle ends."""

CHUNK = 4096
"""Grasps in memory at once."""

SHARPEST = 1e12
"""Last weight of tau against the barriers: tau is then within 1e-11 of the largest."""

SHARPER = 50.0
"""Factor between two weights."""

STEPS = 30
"""Most steps for one weight."""

CENTRED = 1e-3
"""Newton decrement, squared, at which the next weight follows."""

RIDGE = 1e-13
"""Part of the diagonal that keeps Newton's equations solvable in spite of rounding."""

BARRIERS = 9.0
"""Sum of the barriers' parameters: tau is at most this over the weight below the largest."""

NEAREST = 1e-4
"""Shortest line that counts, relative to the contacts' distance and their patches."""

DISCS = np.stack([np.diag([-1.0, -1, 0, 0, 1, 0]), np.diag([0, 0, -1.0, -1, 1, 0])])
"""Matrices of the constraints that keep the centres of pressure in the patches, (2, 6, 6)."""

FIRST = 0.01
"""Friction angle at which closure is tried first [rad]: most grasps need more."""

NOT_BELOW = 1e-5
"""Angle below 90 degrees within which no friction angle is found [rad]."""


def critical_friction_angle(contacts: Contacts, *, tolerance: float = 1e-4) -> Floats:
    """Friction angle above which a grasp is force-closed.

    Two contacts have a closed form. For more the angle is bracketed: three can be in equilibrium
    only in the plane through them, where six planar wrenches decide closure (Ponce & Faverjon
    1995); for more a direction that separates the grasp at some angle proves a lower bound, forces
    in equilibrium an upper one. Friction and torsion of the contacts do not matter.

    Two contacts with patches balance along any line from one patch to the other, through a centre
    of pressure in each: the angle is that of the best line.

    Args:
        contacts: The contacts; with patches only two.
        tolerance: Three contacts and more: width of the bracket [rad]; its upper end is returned.

    Returns:
        Angles [rad], shape (...). Negative where the grasp is force-closed without friction, and
        remains so for tilts of the normals by as much (7 contacts and more). For two contacts up to
        pi; for more, pi/2 where the grasp is force-closed at no friction. inf for one contact,
        where no forces are in equilibrium. For two contacts with patches at most 1e-5 too large,
        and pi/2 where they are not smaller.

    Raises:
        SettingError: A tolerance that is not above 0, or three contacts or more with patches.

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
    if contacts.patch is not None and contacts.count > 2:
        raise SettingError(
            f"the critical friction angle of {contacts.count} contacts is that of points, but "
            "these have patches: give contacts.without_patches()"
        )
    if contacts.count == 1:
        angles = np.full(len(points), math.inf)
    elif contacts.count == 2:
        angles = _of_pairs(points, normals)
        if contacts.patch is not None:
            patch = contacts.patch.reshape(-1, 2, 2, 3)
            of_patches = patch.any(axis=(1, 2, 3))  # others are points
            angles[of_patches] = least_friction_angles(
                points[of_patches], normals[of_patches], patch[of_patches], angles[of_patches]
            )
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


def least_friction_angles(points: Floats, normals: Floats, patch: Floats, known: Floats) -> Floats:
    """Least friction angles of two contacts whose pressure may be centred anywhere in patches.

    Args:
        points: Shape (b, 2, 3).
        normals: Inward unit normals, shape (b, 2, 3).
        patch: Semi-axes, shape (b, 2, 2, 3).
        known: The angles of point contacts [rad], which these do not exceed, shape (b,).

    Returns:
        Angles [rad], shape (b,), at most 1e-5 too large; pi/2 where they are not smaller.
    """
    line = points[:, 1] - points[:, 0]
    first, second = normals[:, 0], -normals[:, 1]
    middle = 0.5 * angles_between(first, second)
    arms = np.linalg.norm(patch, ord=2, axis=(-2, -1)).sum(axis=-1)  # of both patches
    length = np.linalg.norm(line, axis=-1)
    with np.errstate(divide="ignore", invalid="ignore"):
        turn = np.where(length > arms, np.arcsin(np.minimum(arms / length, 1.0)), math.pi)
    smallest = np.minimum(known, RIGHT_ANGLE)
    for sign in (1.0, -1.0):
        a, b = sign * first, sign * second
        nominal = np.maximum(angles_between(a, line), angles_between(b, line))
        # No line is nearer to both normals than their middle, nor turned by more than the patches.
        least = np.maximum(middle, nominal - turn)
        for rows in _chunks((least < smallest - NOT_BELOW) & (arms > 0.0)):
            angles = _Lines.of(line[rows], patch[rows], a[rows], b[rows]).least()
            smallest[rows] = np.minimum(smallest[rows], angles)
    return np.where(smallest < RIGHT_ANGLE - NOT_BELOW, smallest, RIGHT_ANGLE)


def _chunks(mask: Bools) -> list[Ints]:
    rows = np.flatnonzero(mask)
    return [rows[i : i + CHUNK] for i in range(0, len(rows), CHUNK)]


@dataclass(frozen=True, eq=False)
class _Lines:
    """The convex problem of each grasp of two contacts with patches.

    They balance each other by opposite forces along one line, through a centre of pressure in each
    patch. The least friction angle is the least over the lines d between the patches of the larger
    angle between d and a = n_1, or -n_2 = b; for fingers that push apart of -a and -b. Below 90
    degrees its cosine is the largest tau of a convex problem, with scaled lines u = s d + S y,

        a . u >= tau,  b . u >= tau,  |u| <= 1,  |(y_1, y_2)| <= s,  |(y_3, y_4)| <= s,

    d the line between the contacts and S the semi-axes of the patches. It is solved for many grasps
    at once by Newton's method with logarithmic barriers (Boyd & Vandenberghe, Convex Optimization,
    2004, ch. 11). The unknowns are x = (y_1 ... y_4, s, tau), shape (b, 6).
    """

    matrix: Floats
    """From x to u, shape (b, 3, 6)."""
    linear: Floats
    """Rows l of the constraints l . x + constant > 0, shape (b, 3, 6)."""
    a: Floats
    b: Floats

    @classmethod
    def of(cls, line: Floats, patch: Floats, a: Floats, b: Floats) -> "_Lines":
        """The problem in lengths relative to the line and the patches."""
        axes = patch * np.array([-1.0, 1.0])[:, None, None]
        vectors = np.concatenate([axes.reshape(-1, 4, 3), line[:, None]], axis=1)  # (b, 5, 3)
        size = np.linalg.norm(vectors, axis=-1).sum(axis=-1)
        matrix = np.zeros((len(line), 3, 6))
        matrix[..., :5] = np.swapaxes(vectors / size[:, None, None], 1, 2)
        linear = np.zeros((len(line), 3, 6))
        for row, normal in enumerate((a, b)):
            linear[:, row] = (normal[:, None] @ matrix)[:, 0]
            linear[:, row, 5] = -1.0
        linear[:, 2, 4] = -1.0
        return cls(matrix, linear, a, b)

    def least(self) -> Floats:
        """The larger angle of the best line with the normals [rad], shape (b,)."""
        x = np.zeros((len(self.matrix), 6))
        x[:, 4] = 0.5
        x[:, 5] = (self.linear[:, :2] @ x[..., None])[..., 0].min(axis=-1) - 1.0
        weight = 1.0
        while weight < SHARPEST:
            # Where tau cannot rise above 0 the lines shrink to nothing: these are left.
            rows = np.flatnonzero(x[:, 5] + BARRIERS / weight > NOT_BELOW)
            weight *= SHARPER
            x[rows] = self.take(rows).centred(x[rows], weight)
        lines = (self.matrix @ x[..., None])[..., 0]
        return np.maximum(angles_between(self.a, lines), angles_between(self.b, lines))

    def take(self, rows: Ints) -> "_Lines":
        """The problems of chosen grasps."""
        return _Lines(self.matrix[rows], self.linear[rows], self.a[rows], self.b[rows])

    def centred(self, x: Floats, weight: float) -> Floats:
        """The minimum of -weight tau and the barriers, from x inside them."""
        active = np.arange(len(x))
        for _ in range(STEPS):
            part = self.take(active)
            step, decrement = part.newton_step(x[active], weight)
            moving = np.isfinite(step).all(axis=-1) & (decrement > CENTRED)
            active, step = active[moving], step[moving]
            if not len(active):
                break
            part = self.take(active)
            # Half of the way to the nearest barrier at most; damped steps then converge.
            length = 1.0 / (1.0 + np.sqrt(decrement[moving]))
            length = np.where(decrement[moving] < 0.25, 1.0, length)
            for _ in range(STEPS):
                outside = ~part.inside(x[active] + length[:, None] * step)
                if not outside.any():
                    break
                length = np.where(outside, 0.5 * length, length)
            else:
                length = np.where(outside, 0.0, length)
            x[active] += length[:, None] * step
        return x

    def _constraints(self, x: Floats) -> tuple[Floats, Floats, Floats]:
        """Values (b, 6), gradients (b, 6, 6) and matrices (b, 3, 6, 6) of the quadratic ones."""
        squares = np.empty((len(x), 3, 6, 6))
        squares[:, 0] = -np.swapaxes(self.matrix, 1, 2) @ self.matrix
        squares[:, 1:] = DISCS
        products = (squares @ x[:, None, :, None])[..., 0]  # (b, 3, 6)
        linear = (self.linear @ x[..., None])[..., 0] + np.array([0.0, 0.0, 1.0 / NEAREST])
        quadratic = (products * x[:, None]).sum(axis=-1) + np.array([1.0, 0.0, 0.0])
        values = np.concatenate([linear, quadratic], axis=-1)
        return values, np.concatenate([self.linear, 2.0 * products], axis=1), squares

    def inside(self, x: Floats) -> Bools:
        """Whether x is inside all barriers, shape (b,)."""
        values, _, _ = self._constraints(x)
        return np.asarray((values > 0.0).all(axis=-1) & (x[:, 4] > 0.0))

    def newton_step(self, x: Floats, weight: float) -> tuple[Floats, Floats]:
        """Newton step (b, 6) and squared decrement (b,)."""
        values, gradients, squares = self._constraints(x)
        scaled = gradients / values[..., None]
        gradient = -scaled.sum(axis=1)
        gradient[:, 5] -= weight
        hessian = np.swapaxes(scaled, 1, 2) @ scaled
        hessian -= 2.0 * (squares / values[:, 3:, None, None]).sum(axis=1)
        # Scaled to a unit diagonal: the barriers differ by many orders of magnitude.
        scale = 1.0 / np.sqrt(np.einsum("bii->bi", hessian))
        unit = hessian * scale[:, :, None] * scale[:, None]
        unit += RIDGE * np.eye(6)
        step = -scale * np.linalg.solve(unit, (scale * gradient)[..., None])[..., 0]
        return step, -(gradient * step).sum(axis=-1)
