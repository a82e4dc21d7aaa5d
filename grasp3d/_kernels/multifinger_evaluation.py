"""One candidate grasp at a time: does it close, and from which friction angle on?

Most candidates are rejected. A grasp that fails leaves a direction in which no wrench lies, and the
next ones, which share some of its contacts, often fail in the same: that costs a few products
instead of a hull. Three contacts are settled in their plane.
"""

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from grasp3d._kernels.compiling import inlined, scratch_kernel
from grasp3d._kernels.coplanar_contacts import (
    Fans,
    Plane,
    cones_close,
    critical_of_fans,
    critical_of_pushes,
    fans_close,
    lay_cone,
    lay_in_fan,
    lay_plane,
    lay_push,
    make_fans,
    make_plane,
)
from grasp3d._kernels.growing_hull import grow
from grasp3d._kernels.polytope import Polytope, make_polytope
from grasp3d._kernels.support_functions import TOTAL, Body
from grasp3d._kernels.wrench_problem import SIGN, SIX

DIRECTIONS = 24
"""Directions of failed grasps that are kept."""

FACETS = 1 << 11
"""Room for the hull of a closure test; a grasp that needs more counts as open."""

RIGHT = 0.5 * math.pi


class Trial(NamedTuple):
    """A candidate grasp of up to n contacts, and scratch."""

    points: npt.NDArray[np.float64]
    """Contacts (n, 3), lengths such that the grasps in question are about 1 wide."""
    normals: npt.NDArray[np.float64]
    """Inward unit normals that each contact may have (n, k, 3)."""
    counts: npt.NDArray[np.int64]
    """How many those are (n,)."""
    chosen: npt.NDArray[np.int64]
    """One normal of each contact (n,)."""
    directions: npt.NDArray[np.float64]
    """Directions about the first contact in which earlier grasps failed, the last first (d, 6)."""
    used: npt.NDArray[np.int64]
    """How many directions there are, and which is given up next (2,)."""
    axes: npt.NDArray[np.float64]
    """As in `Body` (n, 4, 6)."""
    cones: npt.NDArray[np.float64]
    """As in `Body` (n, 2)."""
    rim: npt.NDArray[np.float64]
    """As in `Body`: circular (0, 2)."""
    metric: npt.NDArray[np.float64]
    """As in `grow` (6,)."""
    plane: Plane
    fans: Fans
    polytope: Polytope


def make_trial(contacts: int, normals: int) -> Trial:
    """Allocate a trial for so many contacts with so many normals each."""
    return Trial(
        points=np.zeros((contacts, 3)),
        normals=np.zeros((contacts, normals, 3)),
        counts=np.zeros(contacts, dtype=np.int64),
        chosen=np.zeros(contacts, dtype=np.int64),
        directions=np.zeros((DIRECTIONS, 6)),
        used=np.zeros(2, dtype=np.int64),
        axes=np.zeros((contacts, 4, 6)),
        cones=np.zeros((contacts, 2)),
        rim=np.zeros((0, 2)),
        metric=np.ones(6),
        plane=make_plane(),
        fans=make_fans(normals),
        polytope=make_polytope(FACETS),
    )


@inlined
def _first(trial, n):
    """Begin with the first combination of normals."""
    for i in range(n):
        trial.chosen[i] = 0


@inlined
def _next(trial, n):
    """Go on to the next combination of normals; returns whether there is one."""
    for i in range(n - 1, -1, -1):
        trial.chosen[i] += 1
        if trial.chosen[i] < trial.counts[i]:
            return True
        trial.chosen[i] = 0
    return False


@inlined
def _lay_fans(trial):
    """Lay three contacts with all their normals in their plane; returns whether they have one."""
    if not lay_plane(trial.points, trial.plane):
        return False
    for i in range(3):
        trial.fans.counts[i] = trial.counts[i]
        for k in range(trial.counts[i]):
            lay_in_fan(trial.normals[i, k], i, k, trial.plane, trial.fans)
    return True


@inlined
def _settle_plain(trial, bar, tolerance):
    """Settle three contacts with one normal each; see `settle`."""
    if not lay_plane(trial.points, trial.plane):
        return math.inf
    steepest, cosine, reaching = 0.0, math.cos(bar), True
    for i in range(3):
        steepest = max(steepest, lay_push(trial.normals[i, 0], i, trial.plane))
        reaching = reaching and lay_cone(i, cosine, trial.plane)
    if not (reaching and cones_close(trial.plane)):
        return math.inf
    low = min(math.asin(min(steepest, 1.0)), bar)
    return critical_of_pushes(trial.plane, low, bar, tolerance)


@inlined
def _settle_three(trial, bar, tolerance, helping):
    """Settle three contacts; see `settle`."""
    if trial.counts[0] == 1 and trial.counts[1] == 1 and trial.counts[2] == 1:
        return _settle_plain(trial, bar, tolerance)
    if not (_lay_fans(trial) and fans_close(bar, helping, trial.plane, trial.fans)):
        return math.inf
    return critical_of_fans(0.0, bar, tolerance, helping, trial.plane, trial.fans)


@inlined
def _work(trial, i, u):
    """Force whose work a direction asks of contact i."""
    x, y, z = (
        trial.points[i, 0] - trial.points[0, 0],
        trial.points[i, 1] - trial.points[0, 1],
        trial.points[i, 2] - trial.points[0, 2],
    )
    return (
        u[0] + u[4] * z - u[5] * y,
        u[1] + u[5] * x - u[3] * z,
        u[2] + u[3] * y - u[4] * x,
    )


@inlined
def _away(trial, i, u, helping):
    """Sine by which a contact's normal looks away from a direction's work.

    That of the worst normal, or of the best one; 1 where there is no work.
    """
    gx, gy, gz = _work(trial, i, u)
    size = math.sqrt(gx * gx + gy * gy + gz * gz)
    if not size > 0.0:
        return 1.0
    most, least = -1.0, 1.0
    for k in range(trial.counts[i]):
        normal = trial.normals[i, k]
        away = -(normal[0] * gx + normal[1] * gy + normal[2] * gz) / size
        most, least = max(most, away), min(least, away)
    return least if helping else most


@inlined
def _fails_again(trial, n, sine, helping):
    """Whether a direction in which an earlier grasp failed leaves out all of this one."""
    for d in range(trial.used[0]):
        u, i = trial.directions[d], 0
        while i < n and _away(trial, i, u, helping) >= sine:
            i += 1
        if i == n:
            for k in range(6):
                last = trial.directions[0, k]
                trial.directions[0, k] = trial.directions[d, k]
                trial.directions[d, k] = last
            return True
    return False


@inlined
def _lay_axes(trial, n):
    """Lay out wrenches of the chosen normals and their tangents, moments about the first."""
    for i in range(n):
        x, y, z = (
            trial.points[i, 0] - trial.points[0, 0],
            trial.points[i, 1] - trial.points[0, 1],
            trial.points[i, 2] - trial.points[0, 2],
        )
        normal, axes = trial.normals[i, trial.chosen[i]], trial.axes[i]
        nx, ny, nz = normal[0], normal[1], normal[2]
        if abs(nz) < 0.9:
            size = 1.0 / math.sqrt(nx * nx + ny * ny)
            tx, ty, tz = -ny * size, nx * size, 0.0
        else:
            size = 1.0 / math.sqrt(ny * ny + nz * nz)
            tx, ty, tz = 0.0, -nz * size, ny * size
        bx, by, bz = ny * tz - nz * ty, nz * tx - nx * tz, nx * ty - ny * tx
        axes[0, 0], axes[0, 1], axes[0, 2] = nx, ny, nz
        axes[1, 0], axes[1, 1], axes[1, 2] = tx, ty, tz
        axes[2, 0], axes[2, 1], axes[2, 2] = bx, by, bz
        for j in range(3):
            fx, fy, fz = axes[j, 0], axes[j, 1], axes[j, 2]
            axes[j, 3], axes[j, 4], axes[j, 5] = y * fz - z * fy, z * fx - x * fz, x * fy - y * fx


@inlined
def _keep_direction(trial, u):
    used = trial.used
    row = used[1]
    for k in range(6):
        trial.directions[row, k] = trial.directions[0, k]
        trial.directions[0, k] = u[k]
    used[0] = max(used[0], row + 1)
    used[1] = row + 1 if row + 1 < DIRECTIONS else 1


@inlined
def _hull_closes(trial, n, angle):
    """Closure test of the chosen normals; keeps the direction in which it fails."""
    _lay_axes(trial, n)
    normal, tangential = math.cos(angle), math.sin(angle)
    for i in range(n):
        trial.cones[i, 0], trial.cones[i, 1] = normal, tangential
    spherical, soft = True, False
    body = Body(TOTAL, spherical, soft, trial.axes[:n], trial.cones[:n], trial.rim)
    _, lower, _, _, used = grow(body, SIX, trial.metric, SIGN, trial.polytope)
    if used > 0 and lower > 0.0:
        return True
    _keep_direction(trial, trial.polytope.vectors[16])
    return False


@inlined
def _proven(trial, n):
    """Friction angle that the last direction proves not to be enough for the chosen normals."""
    least = 1.0
    for i in range(n):
        gx, gy, gz = _work(trial, i, trial.directions[0])
        size = math.sqrt(gx * gx + gy * gy + gz * gz)
        normal = trial.normals[i, trial.chosen[i]]
        if size > 0.0:
            least = min(least, -(normal[0] * gx + normal[1] * gy + normal[2] * gz) / size)
    return math.asin(min(max(least, 0.0), 1.0))


@inlined
def _chosen_critical(trial, n, low, high, tolerance):
    """Critical angle with the chosen normals, between two angles [rad].

    The upper one is enough for them, or is returned.
    """
    while high - low > tolerance:
        middle = 0.5 * (low + high)
        if _hull_closes(trial, n, middle):
            high = middle
        else:
            low = max(middle, min(_proven(trial, n), high))
    return high


@scratch_kernel
def settle(trial, n, bar, tolerance, helping):
    """Critical friction angle of a grasp over its worst, or its best, normals, if it is low enough.

    One function for the test and the measure, because each function above a growing hull takes as
    long to compile as the hull.

    Args:
        trial: `Trial`; all contacts apart.
        n: Contacts, 3 or more.
        bar: Angle at which the grasp must close [rad], at most pi / 2.
        tolerance: Width of the bracket [rad] whose upper end is returned.
        helping: The smallest over all combinations of the contacts' normals; else the largest.

    Returns:
        The angle; inf where the grasp does not close at the bar. Three contacts on one line do not.
    """
    if n == 3:
        return _settle_three(trial, bar, tolerance, helping)
    if _fails_again(trial, n, math.sin(bar), helping):
        return math.inf
    found = math.inf if helping else 0.0
    testing = not helping  # at first whether all combinations close
    _first(trial, n)
    while True:
        if testing:
            at = bar
        elif helping:
            at = min(bar, found - tolerance)
        else:
            at = found
        closed = at > 0.0 and _hull_closes(trial, n, at)
        if testing and not closed:
            return math.inf
        if not testing and closed == helping:
            low, high = (0.0, at) if helping else (at, bar)
            found = _chosen_critical(trial, n, low, high, tolerance)
        if not _next(trial, n):
            if not testing:
                return found
            testing = False
            _first(trial, n)
