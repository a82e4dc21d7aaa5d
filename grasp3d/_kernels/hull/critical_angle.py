"""The critical friction angle of a grasp, between a separating motion and a closed hull.

A motion u of the object separates a grasp up to the friction angle at which some force of a cone
does work on it. With z_i the opposite of the velocity at contact i, and n_i its normal, none does
while

    q_i(u) = (z_i . n_i)^2 - t^2 |z_i - (z_i . n_i) n_i|^2 > 0 and z_i . n_i > 0,

t the tangent of the angle: convex cones of u. The largest t is found by the method of centres
(Huard 1967; Boyd & Vandenberghe, Convex Optimization, 2004, section 11): Newton's steps toward the
minimum of -sum log q_i on the plane sum z_i . n_i = const, then t is raised halfway to what the
centre allows. How well it converges does not matter: what a motion separates is computed from it.
"""

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from grasp3d._kernels.compiling.decorators import merged, part
from grasp3d._kernels.surface.vectors import copy6, cross, dot, norm, triple

STEPS = 80
"""Most of Newton's steps; 45 are usual."""

CENTRED = 0.25
"""Newton's decrement, squared, from which on t is raised."""

NEAR = 0.03
"""Gain of the angle at which it is found, in widths of the interval."""

SHORTEST = 1e-6
"""Shortest step."""

SURE = 0.9
"""How far beyond a separating motion closure is tried, in widths of the interval."""

NEWTON, TOTAL, TRIED, BEST = 6, 7, 8, 9
"""Rows of the scratch after those of Newton's matrix."""


class Bracket(NamedTuple):
    """Intervals that contain the critical friction angles of grasps (b, ...), to be narrowed.

    Empty arrays: none is, and each grasp is evaluated once, with the cones that it has.
    """

    points: npt.NDArray[np.float64]
    """Contact points, and inward unit normals there (b, n, 3) each."""
    normals: npt.NDArray[np.float64]
    low: npt.NDArray[np.float64]
    """Ends of the intervals [rad], (b,) each; written."""
    high: npt.NDArray[np.float64]
    width: npt.NDArray[np.float64]
    """Width up to which they are narrowed [rad], (b,)."""


def no_bracket() -> Bracket:
    """An empty one."""
    return Bracket(*np.zeros((2, 0, 1, 3)), *np.zeros((3, 0)))


@merged
def _opposite_velocity(p, u):
    """The opposite of the velocity of a point."""
    turn = cross((u[3], u[4], u[5]), p)
    return -u[0] - turn[0], -u[1] - turn[1], -u[2] - turn[2]


@part
def _separated_up_to(points, normals, u):
    """Friction angle up to which a motion separates a grasp [rad], below 0: it does not."""
    least = math.pi
    for i in range(points.shape[0]):
        z, n = _opposite_velocity(triple(points[i], 0), u), triple(normals[i], 0)
        least = min(least, math.atan2(dot(z, n), norm(cross(z, n))))
    return least


@merged
def _add_outer(matrix, factor, a):
    """Add the product of a vector of six numbers with itself to a lower triangle."""
    for k in range(6):
        for j in range(k + 1):
            matrix[k, j] += factor * a[k] * a[j]


@merged
def _add_contact(p, n, u, t, matrix):
    """Add the second derivatives of -log q of a contact to a lower triangle (6, 6)."""
    z, square = _opposite_velocity(p, u), t * t
    along = dot(z, n)
    q = (1.0 + square) * along * along - square * dot(z, z)
    one, other = 2.0 * (1.0 + square) / q, 2.0 * square / q
    g0 = other * z[0] - one * along * n[0]
    g1 = other * z[1] - one * along * n[1]
    g2 = other * z[2] - one * along * n[2]
    torque, arm = cross(p, (g0, g1, g2)), cross(p, n)
    _add_outer(matrix, 1.0, (g0, g1, g2, torque[0], torque[1], torque[2]))
    _add_outer(matrix, -one, (n[0], n[1], n[2], arm[0], arm[1], arm[2]))
    for k in range(3):
        matrix[k, k] += other
        matrix[3 + k, 3 + k] += other * dot(p, p)
        for j in range(k + 1):
            matrix[3 + k, 3 + j] -= other * p[k] * p[j]
    x, y, w = other * p[0], other * p[1], other * p[2]
    matrix[4, 0] += w
    matrix[5, 0] -= y
    matrix[3, 1] -= w
    matrix[5, 1] += x
    matrix[3, 2] += y
    matrix[4, 2] -= x


@merged
def _solve(matrix, row):
    """Solve equations of a symmetric positive matrix (6, 6), by Cholesky; False: it is not."""
    for k in range(6):
        for i in range(k, 6):
            value = matrix[i, k]
            for j in range(k):
                value -= matrix[i, j] * matrix[k, j]
            if i == k:
                if not value > 0.0:
                    return False
                matrix[k, k] = math.sqrt(value)
            else:
                matrix[i, k] = value / matrix[k, k]
    for k in range(6):
        for j in range(k):
            row[k] -= matrix[k, j] * row[j]
        row[k] /= matrix[k, k]
    for k in range(5, -1, -1):
        for j in range(k + 1, 6):
            row[k] -= matrix[j, k] * row[j]
        row[k] /= matrix[k, k]
    return True


@merged
def _six_dot(a, b):
    """Inner product of two vectors of six numbers."""
    value = 0.0
    for k in range(6):
        value += a[k] * b[k]
    return value


@part
def climb(points, normals, width, u, scratch):
    """Improve a motion that separates a grasp, so that it does up to nearly the critical angle.

    Args:
        points: Contact points, about 1 apart (n, 3).
        normals: Inward unit normals (n, 3).
        width: Accuracy that is wanted [rad].
        u: The motion; written (6,).
        scratch: Rows of at least 6 numbers (10, 6).

    Returns:
        The friction angle up to which it separates them [rad].
    """
    count = points.shape[0]
    newton, total, tried, best = scratch[NEWTON], scratch[TOTAL], scratch[TRIED], scratch[BEST]
    found = angle = _separated_up_to(points, normals, u)
    if not found > 0.0:
        return found
    for k in range(6):
        total[k] = 0.0
    for i in range(count):
        p, n = triple(points[i], 0), triple(normals[i], 0)
        arm = cross(p, n)
        for k in range(3):
            total[k] -= n[k]
            total[3 + k] -= arm[k]
    copy6(u, best)
    t = 0.5 * math.tan(found)
    for _ in range(STEPS):
        for k in range(6):
            newton[k] = total[k]
            for j in range(6):
                scratch[k, j] = 0.0
        for i in range(count):
            _add_contact(triple(points[i], 0), triple(normals[i], 0), u, t, scratch)
        if not _solve(scratch, newton):
            break
        along = _six_dot(total, u)
        ratio = along / _six_dot(total, newton)
        decrement = 2.0 * count - along * ratio
        step, limit = min(4.0 / (1.0 + math.sqrt(max(decrement, 0.0))), 1.0), math.atan(t)
        while step > SHORTEST:
            for k in range(6):
                tried[k] = u[k] + step * (u[k] - ratio * newton[k])
            angle = _separated_up_to(points, normals, tried)
            if angle > limit:
                break
            step *= 0.5
        if not step > SHORTEST:
            break
        largest = 0.0
        for k in range(6):
            largest = max(largest, abs(tried[k]))
        for k in range(6):
            u[k] = tried[k] / largest
        if angle > found:
            found = angle
            copy6(u, best)
        if decrement < CENTRED:
            t = 0.5 * (t + math.tan(angle))
            if math.atan(t) - limit < NEAR * width:
                break
    copy6(best, u)
    return found


@merged
def _balanced_from(forces, slack, angle):
    """Friction angle from which forces that balance each other are inside all cones [rad].

    Exactly balanced forces are off by up to the slack times the sine of the angle to the cones.
    """
    upper = 0.0
    for i in range(forces.shape[0]):
        tangential = math.hypot(forces[i, 1], forces[i, 2])
        upper = max(upper, math.atan2(tangential, forces[i, 0]))
    return upper + 0.5 * math.pi * slack * (angle - upper)


@part
def narrow(bracket, g, angle, closed, forces, slack, u, scratch):
    """Narrow the interval of a grasp by its closure at an angle.

    Args:
        bracket: `Bracket`, written.
        g: The grasp.
        angle: The friction angle [rad].
        closed: Whether the grasp is force-closed there.
        forces: Balanced forces then, in the contacts' axes (n, 4).
        slack: As returned by `balance`.
        u: A motion that separates it otherwise; written (6,).
        scratch: As in `climb`.

    Returns:
        The angle to be tried next [rad]; 0: the interval is narrow.
    """
    low, high, width = bracket.low[g], bracket.high[g], bracket.width[g]
    # Closure just beyond a motion ends the search, unless the motion was not the best one.
    beyond, missed = False, angle - low <= width
    if closed:
        high = max(low, min(_balanced_from(forces, slack, angle), angle))
    else:
        found = climb(bracket.points[g], bracket.normals[g], width, u, scratch)
        low, beyond = max(angle, min(found, high)), not missed
    bracket.low[g], bracket.high[g] = low, high
    if high - low <= width:
        return 0.0
    if beyond and low + SURE * width < high:
        return low + SURE * width
    # The geometric mean: hands touch at so many points that grasps often need little friction.
    return min(math.sqrt(max(low, width) * high), 0.5 * (low + high))
