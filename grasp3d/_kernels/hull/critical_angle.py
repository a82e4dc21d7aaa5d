"""The critical friction angle of a grasp, between a separating motion and a closed hull.

A motion u of the object separates a grasp up to the friction angle at which some force of a cone
does work on it. With z_i the opposite of the velocity at contact i, and n_i its normal, none does
while

    q_i(u) = (z_i . n_i)^2 - t^2 |z_i - (z_i . n_i) n_i|^2 > 0 and z_i . n_i > 0,

t the friction coefficient: convex cones of u. The largest t is found by the method of centres
(Huard 1967; Boyd & Vandenberghe, Convex Optimization, 2004, section 11): Newton's steps toward the
minimum of -sum log q_i on a plane, the centre at t, and from near it steps along the path of the
centres as far as t can rise. How well that converges does not matter: what a motion separates is
computed from the motion.
"""

import math
from typing import NamedTuple

import numpy as np

from grasp3d._kernels.array_types import Floats1, Floats3
from grasp3d._kernels.compiling import merged, part
from grasp3d._kernels.surface.vectors import copy6, cross, dot, norm, triple

STEPS = 80
"""Most of Newton's steps; 20 are usual."""

CENTRED = 2.0
"""Newton's decrement, squared, from which on t rises."""

FAR, SHORTER, INSIDE = 4.0, 0.5, 0.1
"""Rises of t that are tried: the first one, relative to what the motion allows as it is, the factor
from one to the next, and how much more the motion must allow then, relative to the rise."""

FOUND = 0.1
"""Rise at which the largest t is found, and 0.01 of it that is as good as none, in widths of the
interval."""

SHORTEST = 1e-6
"""Shortest step."""

SURE = 0.9
"""How far beyond a separating motion closure is tried, in widths of the interval."""

STEP, TOTAL, TRIED, BEST, DRIFT = 6, 7, 8, 9, 10
"""Rows of the scratch after those of Newton's matrix."""


class Bracket(NamedTuple):
    """Intervals that contain the critical friction angles of grasps (b, ...), to be narrowed.

    Empty arrays: none is, and each grasp is evaluated once, with the cones that it has.
    """

    points: Floats3
    """Contact points, and inward unit normals there (b, n, 3) each."""
    normals: Floats3
    low: Floats1
    """Ends of the intervals [rad], (b,) each; written."""
    high: Floats1
    width: Floats1
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
def _friction_separated(points, normals, u):
    """Friction coefficient up to which a motion separates a grasp; below 0: it does not."""
    least = math.inf
    for i in range(points.shape[0]):
        z, n = _opposite_velocity(triple(points[i], 0), u), triple(normals[i], 0)
        along = dot(z, n)
        if not along > 0.0:
            return -1.0
        aside = norm(cross(z, n))
        if along < least * aside:
            least = along / aside
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
def _factor(matrix):
    """Replace a symmetric positive matrix (6, 6) by its Cholesky factor; False: it is none."""
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
    return True


@merged
def _solve(matrix, row):
    """Solve equations of a matrix by its Cholesky factor (6, 6); the row becomes the solution."""
    for k in range(6):
        for j in range(k):
            row[k] -= matrix[k, j] * row[j]
        row[k] /= matrix[k, k]
    for k in range(5, -1, -1):
        for j in range(k + 1, 6):
            row[k] -= matrix[j, k] * row[j]
        row[k] /= matrix[k, k]


@merged
def _add_drift(p, n, u, t, row):
    """Subtract the derivative by t of the gradient of -log q of a contact (6,)."""
    z, square = _opposite_velocity(p, u), t * t
    along, all_ = dot(z, n), dot(z, z)
    aside = all_ - along * along
    q = along * along - square * aside
    # 4 t (aside Q z / q - z_t) / q, of which Q z = (1 + t^2) (z . n) n - t^2 z.
    of_n = 4.0 * t * (aside * (1.0 + square) * along / q + along) / q
    of_z = -4.0 * t * (aside * square / q + 1.0) / q
    v = of_n * n[0] + of_z * z[0], of_n * n[1] + of_z * z[1], of_n * n[2] + of_z * z[2]
    torque = cross(p, v)
    for k in range(3):
        row[k] -= v[k]
        row[3 + k] -= torque[k]


@merged
def _six_dot(a, b):
    """Inner product of two vectors of six numbers."""
    value = 0.0
    for k in range(6):
        value += a[k] * b[k]
    return value


@part
def _directions(points, normals, u, t, scratch):
    """Write Newton's step toward the centre at t, and how the centre moves as t rises.

    Returns:
        Newton's decrement, squared; nan: rounding is as large as the step.
    """
    step, total, drift = scratch[STEP], scratch[TOTAL], scratch[DRIFT]
    for k in range(6):
        step[k] = total[k]
        drift[k] = 0.0
        for j in range(6):
            scratch[k, j] = 0.0
    for i in range(points.shape[0]):
        p, n = triple(points[i], 0), triple(normals[i], 0)
        _add_contact(p, n, u, t, scratch)
        _add_drift(p, n, u, t, drift)
    if not _factor(scratch):
        return math.nan
    _solve(scratch, step)
    _solve(scratch, drift)
    along, across = _six_dot(total, u), _six_dot(total, step)
    ratio, turn = along / across, _six_dot(total, drift) / across
    for k in range(6):
        drift[k] -= turn * step[k]
        step[k] = u[k] - ratio * step[k]
    return 2.0 * points.shape[0] - along * ratio


@part
def climb(points, normals, width, u, scratch):
    """Improve a motion that separates a grasp, so that it does up to nearly the critical angle.

    Args:
        points: Contact points, about 1 apart (n, 3).
        normals: Inward unit normals (n, 3).
        width: Accuracy that is wanted [rad].
        u: The motion; written (6,).
        scratch: At least (11, 6).

    Returns:
        The friction angle up to which it separates them [rad].
    """
    total, tried, best = scratch[TOTAL], scratch[TRIED], scratch[BEST]
    found = _friction_separated(points, normals, u)
    if not 0.0 < found < math.inf:
        return math.atan(found)
    for k in range(6):
        total[k] = 0.0
    for i in range(points.shape[0]):
        n = triple(normals[i], 0)
        arm = cross(points[i], n)
        for k in range(3):
            total[k] -= n[k]
            total[3 + k] -= arm[k]
    copy6(u, best)
    allowed, t = found, 0.5 * found
    for _ in range(STEPS):
        decrement = _directions(points, normals, u, t, scratch)
        if math.isnan(decrement):
            break
        length = min(4.0 / (1.0 + math.sqrt(max(decrement, 0.0))), 1.0)
        least = FOUND * width * (1.0 + t * t)
        rise, reached = (FAR * (allowed - t) if decrement < CENTRED else 0.0), 0.0
        while length > SHORTEST:
            for k in range(6):
                tried[k] = u[k] + length * scratch[STEP, k] + rise * scratch[DRIFT, k]
            reached = _friction_separated(points, normals, tried)
            if reached > t + (1.0 + INSIDE) * rise:
                break
            if rise > 0.0:
                rise = SHORTER * rise if rise > 0.01 * least else 0.0
            else:
                length *= 0.5
        if not length > SHORTEST:
            break
        largest = 0.0
        for k in range(6):
            largest = max(largest, abs(tried[k]))
        for k in range(6):
            u[k] = tried[k] / largest
        allowed, t = reached, t + rise
        if reached > found:
            found = reached
            copy6(u, best)
        if decrement < CENTRED and rise < least:
            break
    copy6(best, u)
    return math.atan(found)


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
