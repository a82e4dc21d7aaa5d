"""Support functions of tasks: how far the wrenches that a grasp must resist reach.

A task is a sum of convex sets, its terms, each a row of numbers: kind, first and last row of its
points, size, direction (3), cosine and sine of an angle. Forces are in one unit; torques are about
the centre of mass, in that unit times the contacts' unit of length.
"""

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from grasp3d._kernels.compiling import merged, part

ANY_DIRECTION, WITHIN, POINTS = 0, 1, 2
"""Kinds of terms: a force in any direction, or within an angle of a direction, at the centre of
mass; the convex hull of given wrenches."""

TERM, SIZE = 9, 3
"""Numbers of a term, and which is the size of a force."""

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
def _force_within(term, fx, fy, fz):
    """Sup of f . u_f over forces of one size within an angle of a direction."""
    gx, gy, gz, cosine, sine = term[4], term[5], term[6], term[7], term[8]
    length = math.sqrt((fx * fx + fy * fy) + fz * fz)
    along = (fx * gx + fy * gy) + fz * gz
    if along >= length * cosine:
        reach = length
    else:
        reach = along * cosine + math.sqrt(max(length * length - along * along, 0.0)) * sine
    return term[SIZE] * reach


@merged
def _row_product(points, i, fx, fy, fz, tx, ty, tz):
    return ((points[i, 0] * fx + points[i, 1] * fy) + (points[i, 2] * fz + points[i, 3] * tx)) + (
        points[i, 4] * ty + points[i, 5] * tz
    )


@part
def reach(terms, points, fx, fy, fz, tx, ty, tz):
    """Support function of a task in a direction (f, t), in the contacts' units."""
    total = 0.0
    for i in range(terms.shape[0]):
        term = terms[i]
        kind, first, last = int(term[0]), int(term[1]), int(term[2])
        if kind == ANY_DIRECTION:
            total += term[SIZE] * math.sqrt((fx * fx + fy * fy) + fz * fz)
        elif kind == WITHIN:
            total += _force_within(term, fx, fy, fz)
        else:
            farthest = -math.inf
            for j in range(first, last):
                farthest = max(farthest, _row_product(points, j, fx, fy, fz, tx, ty, tz))
            total += farthest
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
