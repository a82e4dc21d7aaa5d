"""Evaluation of one candidate grasp: force closure, and its critical friction angle.

Most candidates are rejected: they are not force-closed at the best critical angle found so far. A
grasp that is not force-closed has a separating direction, in which none of its wrenches has a
positive component. The latest separating directions are remembered and tried first, since the next
candidates share most of their contacts and are often separated by the same direction: that costs a
few products instead of a hull. Three contacts are evaluated in the plane through them (Ponce &
Faverjon 1995), without a hull.
"""

import math
from typing import NamedTuple

import numpy as np

from grasp3d._kernels.array_types import Floats1, Floats2, Floats3, Ints1
from grasp3d._kernels.compiling import merged, part
from grasp3d._kernels.hull.growing_hull import AROUND_ORIGIN, grow
from grasp3d._kernels.hull.polytope import Polytope, make_polytope
from grasp3d._kernels.hull.support_functions import NO_TORSION, SIX, TOTAL, WrenchSpace
from grasp3d._kernels.hull.wrench_problem import SIGN
from grasp3d._kernels.search.coplanar_contacts import (
    cones_force_closed,
    critical_of_fans,
    critical_of_normals,
    fans_force_closed,
    set_cone,
    set_contact_plane,
    set_fan_normal,
    set_normal,
)
from grasp3d._kernels.surface.vectors import cross, difference, dot, norm, triple

MAX_DIRECTIONS = 24
"""Separating directions that are remembered."""

MAX_FACETS = (1 << 11) + 8
"""Most facets of a closure test's hull; a grasp that needs more counts as not force-closed."""

ROUNDING = 1e-11
"""Distance of the origin from a hull's facets below which rounding errors may have moved it inside.
Contacts are apart: there is no need for a proof by balanced forces."""

RIGHT_ANGLE = 0.5 * math.pi


class Candidate(NamedTuple):
    """A candidate grasp of up to n contacts."""

    points: Floats2
    """Contact points (n, 3), scaled so that grasps are about 1 wide."""
    normals: Floats3
    """Inward unit normals that each contact may have (n, k, 3)."""
    counts: Ints1
    """How many those are (n,)."""


class HullScratch(NamedTuple):
    """Scratch arrays for the evaluation of more contacts."""

    chosen: Ints1
    """Index of one normal of each contact: a combination of normals (n,)."""
    directions: Floats2
    """Separating directions of earlier candidates, moments about the first contact; the one that
    was successful last comes first (d, 6)."""
    direction_use: Ints1
    """Number of directions, and the row that is overwritten next (2,)."""
    axes: Floats3
    """As in `WrenchSpace` (n, 4, 6)."""
    cones: Floats2
    """As in `WrenchSpace` (n, 2)."""
    metric: Floats1
    """As in `grow` (6,)."""
    polytope: Polytope


def make_candidate(contacts: int, normals: int) -> Candidate:
    """Allocate a candidate of so many contacts with so many normals each."""
    return Candidate(
        points=np.zeros((contacts, 3)),
        normals=np.zeros((contacts, normals, 3)),
        counts=np.zeros(contacts, dtype=np.int64),
    )


def make_hull_scratch(contacts: int) -> HullScratch:
    """Allocate the arrays for so many contacts."""
    return HullScratch(
        chosen=np.zeros(contacts, dtype=np.int64),
        directions=np.zeros((MAX_DIRECTIONS, 6)),
        direction_use=np.zeros(2, dtype=np.int64),
        axes=np.zeros((contacts, 4, 6)),
        cones=np.zeros((contacts, 2)),
        metric=np.ones(6),
        polytope=make_polytope(MAX_FACETS),
    )


@merged
def _next_combination(chosen, counts, n):
    """Choose the next combination of normals; returns whether there is one."""
    for i in range(n - 1, -1, -1):
        chosen[i] += 1
        if chosen[i] < counts[i]:
            return True
        chosen[i] = 0
    return False


@merged
def _evaluate_smooth(candidate, plane, threshold, tolerance):
    """Evaluate three contacts with one normal each; see `evaluate`."""
    steepest, cosine, reaching = 0.0, math.cos(threshold), True
    for i in range(3):
        steepest = max(steepest, set_normal(candidate.normals[i, 0], i, plane))
        reaching = reaching and set_cone(i, cosine, plane)
    if not (reaching and cones_force_closed(plane)):
        return math.inf
    # Below the steepest elevation some cone does not intersect the plane.
    low = min(math.asin(min(steepest, 1.0)), threshold)
    return critical_of_normals(plane, low, threshold, tolerance)


@merged
def _evaluate_three(candidate, plane, threshold, tolerance, best_normals):
    """Evaluate three contacts; see `evaluate`."""
    counts, normals = candidate.counts, candidate.normals
    if not set_contact_plane(candidate.points, plane):
        return math.inf
    if counts[0] == 1 and counts[1] == 1 and counts[2] == 1:
        return _evaluate_smooth(candidate, plane, threshold, tolerance)
    for i in range(3):
        plane.counts[i] = counts[i]
        for k in range(counts[i]):
            set_fan_normal(normals[i, k], i, k, plane)
    if not fans_force_closed(threshold, best_normals, plane):
        return math.inf
    return critical_of_fans(0.0, threshold, tolerance, best_normals, plane)


@merged
def _force_part(points, i, u):
    """Force part at contact i of a direction: u_f + u_tau x p, with p from the first contact."""
    x, y, z = difference(points[i], points[0])
    return (
        u[0] + u[4] * z - u[5] * y,
        u[1] + u[5] * x - u[3] * z,
        u[2] + u[3] * y - u[4] * x,
    )


@merged
def _separation_sine(candidate, i, u, best_normals):
    """Sine of the largest friction angle for which a direction separates a contact's forces.

    The largest over the contact's normals, or with `best_normals` the smallest; 1 where the
    direction has no force part at the contact.
    """
    force = _force_part(candidate.points, i, u)
    size = norm(force)
    if not size > 0.0:
        return 1.0
    most, least = -1.0, 1.0
    for k in range(candidate.counts[i]):
        opposing = -dot(candidate.normals[i, k], force) / size
        most, least = max(most, opposing), min(least, opposing)
    return least if best_normals else most


@merged
def _is_separated(candidate, directions, count, n, sine, best_normals):
    """Whether a remembered direction separates the candidate at the friction angle of this sine.

    A successful direction is moved to the front.
    """
    for d in range(count):
        u, i = directions[d], 0
        while i < n and _separation_sine(candidate, i, u, best_normals) >= sine:
            i += 1
        if i == n:
            # Move to the front what was successful: the next candidates are similar.
            for k in range(6):
                last = directions[0, k]
                directions[0, k] = directions[d, k]
                directions[d, k] = last
            return True
    return False


@merged
def _write_axes(candidate, chosen, n, all_axes):
    """Write the wrenches of the chosen normals and tangents, moments about the first contact."""
    points, normals = candidate.points, candidate.normals
    for i in range(n):
        arm, normal = difference(points[i], points[0]), triple(normals[i, chosen[i]], 0)
        nx, ny, nz = normal
        # Tangents from the cross product with z, or with x where the normal is close to z.
        if abs(nz) < 0.9:
            size = 1.0 / math.sqrt(nx * nx + ny * ny)
            tangent = (-ny * size, nx * size, 0.0)
        else:
            size = 1.0 / math.sqrt(ny * ny + nz * nz)
            tangent = (0.0, -nz * size, ny * size)
        forces = (normal, tangent, cross(normal, tangent))
        for j in range(3):
            torque = cross(arm, forces[j])
            for k in range(3):
                all_axes[i, j, k], all_axes[i, j, 3 + k] = forces[j][k], torque[k]


@merged
def _store_direction(directions, use, u):
    """Remember a separating direction at the front, in place of the oldest one."""
    row = use[1]
    for k in range(6):
        directions[row, k] = directions[0, k]
        directions[0, k] = u[k]
    use[0] = max(use[0], row + 1)
    use[1] = row + 1 if row + 1 < MAX_DIRECTIONS else 1


@merged
def _hull_force_closed(candidate, hull, n, angle):
    """Closure test of the chosen normals by a hull; remembers the separating direction."""
    axes, cones, polytope = hull.axes, hull.cones, hull.polytope
    _write_axes(candidate, hull.chosen, n, axes)
    # Unit forces on the rim of a circular cone of half-angle `angle`.
    normal, tangential = math.cos(angle), math.sin(angle)
    for i in range(n):
        cones[i, 0], cones[i, 1] = normal, tangential
    spherical = True
    space = WrenchSpace(TOTAL, spherical, NO_TORSION, axes[:n], cones[:n], 1)
    _, lower, _, _, facets = grow(space, SIX, hull.metric, None, AROUND_ORIGIN, SIGN, polytope)
    if facets > 0 and lower > ROUNDING:
        return True
    _store_direction(hull.directions, hull.direction_use, polytope.vectors[16])
    return False


@merged
def _proven_angle(candidate, chosen, direction, n):
    """Lower bound of the chosen normals' critical angle, from the last separating direction."""
    least = 1.0
    for i in range(n):
        force = _force_part(candidate.points, i, direction)
        size = norm(force)
        if size > 0.0:
            least = min(least, -dot(candidate.normals[i, chosen[i]], force) / size)
    return math.asin(min(max(least, 0.0), 1.0))


@merged
def _critical_of_chosen(candidate, hull, n, low, high, tolerance):
    """Critical angle of the chosen normals between two angles, by bisection [rad].

    `high` is returned where nothing lower is force-closed. After a failed test the separating
    direction may raise the lower end beyond the middle.
    """
    while high - low > tolerance:
        middle = 0.5 * (low + high)
        if _hull_force_closed(candidate, hull, n, middle):
            high = middle
        else:
            proven = _proven_angle(candidate, hull.chosen, hull.directions[0], n)
            low = max(middle, min(proven, high))
    return high


@merged
def _evaluate_by_hulls(candidate, hull, n, threshold, tolerance, best_normals):
    """Evaluate more than three contacts; see `evaluate`.

    The closure test and the bisection are one function because every function that calls the
    growing hull takes as long to compile as the hull.
    """
    directions, counts, chosen = hull.directions, candidate.counts, hull.chosen
    sine, known = math.sin(threshold), hull.direction_use[0]
    if _is_separated(candidate, directions, known, n, sine, best_normals):
        return math.inf
    angle = math.inf if best_normals else 0.0
    # Over the worst normals: first test all combinations, then find the largest angle.
    testing = not best_normals
    for i in range(n):
        chosen[i] = 0
    while True:
        # Over the worst normals only a combination that fails at the largest angle so far can
        # raise it; over the best ones only one that succeeds below the smallest can lower it.
        if testing:
            tested = threshold
        elif best_normals:
            tested = min(threshold, angle - tolerance)
        else:
            tested = angle
        closed = tested > 0.0 and _hull_force_closed(candidate, hull, n, tested)
        if testing and not closed:
            return math.inf
        if not testing and closed == best_normals:
            low, high = (0.0, tested) if best_normals else (tested, threshold)
            angle = _critical_of_chosen(candidate, hull, n, low, high, tolerance)
        if not _next_combination(chosen, counts, n):  # all are 0 again
            if not testing:
                return angle
            testing = False


@part
def evaluate(candidate, plane, hull, n, threshold, limits):
    """Critical friction angle of a grasp over its worst or best normals, if below a threshold.

    Args:
        candidate: `Candidate`; no two contacts coincide.
        plane: `Plane`, for three contacts.
        hull: `HullScratch`; None: there are three contacts, for which no hull is compiled.
        n: Contacts, 3 or more.
        threshold: Friction angle at which the grasp must be force-closed [rad], at most pi / 2.
        limits: `SearchLimits`: the width of the bracket whose upper end is returned, and whether
            the angle is the smallest over all combinations of the contacts' normals, or the
            largest.

    Returns:
        The angle; inf where the grasp is not force-closed at the threshold, as three collinear
        contacts never are.
    """
    tolerance, best_normals = limits.tolerance, limits.best_normals
    if hull is None:
        return _evaluate_three(candidate, plane, threshold, tolerance, best_normals)
    return _evaluate_by_hulls(candidate, hull, n, threshold, tolerance, best_normals)
