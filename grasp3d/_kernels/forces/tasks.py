"""Support functions of tasks: how far the wrenches that a grasp must resist reach.

A task is a sum of convex sets, its terms, each a row of numbers: kind, first and last row of its
points, size, direction (3), cosine and sine of an angle, and the radius of the ball in which the
centre of mass lies. Forces are in one unit; torques are about the nominal centre of mass, in that
unit times the contacts' unit of length.
"""

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from grasp3d._kernels.compiling.decorators import merged, part, scratch_kernel

ANY_DIRECTION, WITHIN, POINTS, ELLIPSOID = 0, 1, 2, 3
"""Kinds of terms: a force in any direction, or within an angle of a direction, at the centre of
mass; the convex hull of given wrenches; an ellipsoid, the image of the unit ball under the rows."""

TERM, SIZE, RADIUS = 10, 3, 9
"""Numbers of a term, and which are the size of a force and the radius of its centre's ball."""

NEGLIGIBLE = 1e-12
"""Reach relative to the task's extent along the coordinates below which it is a rounding error."""


class TaskInSpan(NamedTuple):
    """A task in the balanced coordinates of a grasp's span."""

    frame: npt.NDArray[np.float64]
    """Direction, for forces and torques in the contacts' units, of each coordinate (6, 6)."""
    rank: int
    """Number of coordinates."""
    extents: npt.NDArray[np.float64]
    """How far the task reaches along each coordinate, in either sense (6,)."""
    terms: npt.NDArray[np.float64]
    """Terms (t, TERM)."""
    points: npt.NDArray[np.float64]
    """Wrenches of the terms that have some (p, 6)."""


@merged
def _force_in_any_direction(term, fx, fy, fz, tx, ty, tz):
    """Sup of f . u_f + (c x f) . u_tau over forces of one size and centres c in a ball."""
    square, radius = (fx * fx + fy * fy) + fz * fz, term[RADIUS]
    turning = (tx * tx + ty * ty) + tz * tz
    if radius == 0.0 or turning == 0.0:
        return term[SIZE] * math.sqrt(square)
    # The centre moves u_f + u_tau x c over a disc across u_tau.
    along = (fx * tx + fy * ty) + fz * tz
    along *= along / turning
    across = math.sqrt(max(square - along, 0.0)) + radius * math.sqrt(turning)
    return term[SIZE] * math.sqrt(along + across * across)


@merged
def _force_within(term, fx, fy, fz, tx, ty, tz):
    """The same for forces within an angle of a direction.

    With an angle and a radius both above 0 the centre is taken at its worst for another of the
    forces, so the value may be too large, never too small.
    """
    gx, gy, gz, cosine, sine, radius = term[4], term[5], term[6], term[7], term[8], term[RADIUS]
    length = math.sqrt((fx * fx + fy * fy) + fz * fz)
    along = (fx * gx + fy * gy) + fz * gz
    if along >= length * cosine:
        reach = length
    else:
        reach = along * cosine + math.sqrt(max(length * length - along * along, 0.0)) * sine
    if radius > 0.0:
        turning = math.sqrt((tx * tx + ty * ty) + tz * tz)
        along = abs((tx * gx + ty * gy) + tz * gz)
        across = math.sqrt(max(turning * turning - along * along, 0.0))
        # Largest |f x u_tau| over the cone: all of it where some force is across u_tau.
        if along * cosine <= across * sine:
            reach += radius * turning
        else:
            reach += radius * (across * cosine + along * sine)
    return term[SIZE] * reach


@merged
def _row_product(points, i, fx, fy, fz, tx, ty, tz):
    return ((points[i, 0] * fx + points[i, 1] * fy) + (points[i, 2] * fz + points[i, 3] * tx)) + (
        points[i, 4] * ty + points[i, 5] * tz
    )


@scratch_kernel
def reach(terms, points, fx, fy, fz, tx, ty, tz):
    """Support function of a task in a direction (f, t), in the contacts' units."""
    total = 0.0
    for i in range(terms.shape[0]):
        term = terms[i]
        kind, first, last = int(term[0]), int(term[1]), int(term[2])
        if kind == ANY_DIRECTION:
            total += _force_in_any_direction(term, fx, fy, fz, tx, ty, tz)
        elif kind == WITHIN:
            total += _force_within(term, fx, fy, fz, tx, ty, tz)
        elif kind == POINTS:
            farthest = -math.inf
            for j in range(first, last):
                farthest = max(farthest, _row_product(points, j, fx, fy, fz, tx, ty, tz))
            total += farthest
        else:
            square = 0.0
            for j in range(first, last):
                value = _row_product(points, j, fx, fy, fz, tx, ty, tz)
                square += value * value
            total += math.sqrt(square)
    return total


@part
def task_reach(task, direction):
    """How far a task's opposite reaches along a direction in balanced coordinates; not below 0.

    The contacts must apply the opposite of each wrench of the task.

    Args:
        task: `TaskInSpan`.
        direction: At least as many numbers as its rank.
    """
    u0 = u1 = u2 = u3 = u4 = u5 = extent = 0.0
    for k in range(task.rank):
        n, row = direction[k], task.frame[k]
        u0 -= n * row[0]
        u1 -= n * row[1]
        u2 -= n * row[2]
        u3 -= n * row[3]
        u4 -= n * row[4]
        u5 -= n * row[5]
        extent += abs(n) * task.extents[k]
    value = reach(task.terms, task.points, u0, u1, u2, u3, u4, u5)
    return value if value > NEGLIGIBLE * extent else 0.0
