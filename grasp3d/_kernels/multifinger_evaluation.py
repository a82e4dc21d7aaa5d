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
import numpy.typing as npt

from grasp3d._kernels.compiling import inlined, scratch_kernel
from grasp3d._kernels.coplanar_contacts import (
    Fans,
    Plane,
    cones_force_closed,
    critical_of_fans,
    critical_of_normals,
    fans_force_closed,
    make_fans,
    make_plane,
    set_cone,
    set_contact_plane,
    set_fan_normal,
    set_normal,
)
from grasp3d._kernels.growing_hull import grow
from grasp3d._kernels.initial_simplex import AROUND_ORIGIN
from grasp3d._kernels.polytope import Polytope, make_polytope
from grasp3d._kernels.support_functions import NO_TORSION, TOTAL, WrenchSpace
from grasp3d._kernels.wrench_problem import SIGN, SIX

MAX_DIRECTIONS = 24
"""Separating directions that are remembered."""

MAX_FACETS = (1 << 11) + 8
"""Most facets of a closure test's hull; a grasp that needs more counts as not force-closed."""

ROUNDING = 1e-11
"""Distance of the origin from a hull's facets below which rounding errors may have moved it inside.
Contacts are apart: there is no need for a proof by balanced forces."""

RIGHT_ANGLE = 0.5 * math.pi


class Candidate(NamedTuple):
    """A candidate grasp of up to n contacts, and scratch arrays of its evaluation."""

    points: npt.NDArray[np.float64]
    """Contact points (n, 3), scaled so that grasps are about 1 wide."""
    normals: npt.NDArray[np.float64]
    """Inward unit normals that each contact may have (n, k, 3)."""
    counts: npt.NDArray[np.int64]
    """How many those are (n,)."""
    chosen: npt.NDArray[np.int64]
    """Index of one normal of each contact: a combination of normals (n,)."""
    directions: npt.NDArray[np.float64]
    """Separating directions of earlier candidates, moments about the first contact; the one that
    was successful last comes first (d, 6)."""
    direction_use: npt.NDArray[np.int64]
    """Number of directions, and the row that is overwritten next (2,)."""
    axes: npt.NDArray[np.float64]
    """As in `WrenchSpace` (n, 4, 6)."""
    cones: npt.NDArray[np.float64]
    """As in `WrenchSpace` (n, 2)."""
    rim: npt.NDArray[np.float64]
    """As in `WrenchSpace`: circular (0, 2)."""
    metric: npt.NDArray[np.float64]
    """As in `grow` (6,)."""
    plane: Plane
    fans: Fans
    polytope: Polytope


def make_candidate(contacts: int, normals: int) -> Candidate:
    """Allocate a candidate of so many contacts with so many normals each."""
    return Candidate(
        points=np.zeros((contacts, 3)),
        normals=np.zeros((contacts, normals, 3)),
        counts=np.zeros(contacts, dtype=np.int64),
        chosen=np.zeros(contacts, dtype=np.int64),
        directions=np.zeros((MAX_DIRECTIONS, 6)),
        direction_use=np.zeros(2, dtype=np.int64),
        axes=np.zeros((contacts, 4, 6)),
        cones=np.zeros((contacts, 2)),
        rim=np.zeros((0, 2)),
        metric=np.ones(6),
        plane=make_plane(),
        fans=make_fans(normals),
        polytope=make_polytope(MAX_FACETS),
    )


@inlined
def _first_combination(candidate, n):
    """Choose the first combination of normals."""
    for i in range(n):
        candidate.chosen[i] = 0


@inlined
def _next_combination(candidate, n):
    """Choose the next combination of normals; returns whether there is one."""
    for i in range(n - 1, -1, -1):
        candidate.chosen[i] += 1
        if candidate.chosen[i] < candidate.counts[i]:
            return True
        candidate.chosen[i] = 0
    return False


@inlined
def _set_fans(candidate):
    """Project three contacts with all their normals; returns False where they are collinear."""
    if not set_contact_plane(candidate.points, candidate.plane):
        return False
    for i in range(3):
        candidate.fans.counts[i] = candidate.counts[i]
        for k in range(candidate.counts[i]):
            set_fan_normal(candidate.normals[i, k], i, k, candidate.plane, candidate.fans)
    return True


@inlined
def _evaluate_smooth(candidate, threshold, tolerance):
    """Evaluate three contacts with one normal each; see `evaluate`."""
    if not set_contact_plane(candidate.points, candidate.plane):
        return math.inf
    steepest, cosine, reaching = 0.0, math.cos(threshold), True
    for i in range(3):
        steepest = max(steepest, set_normal(candidate.normals[i, 0], i, candidate.plane))
        reaching = reaching and set_cone(i, cosine, candidate.plane)
    if not (reaching and cones_force_closed(candidate.plane)):
        return math.inf
    # Below the steepest elevation some cone does not intersect the plane.
    low = min(math.asin(min(steepest, 1.0)), threshold)
    return critical_of_normals(candidate.plane, low, threshold, tolerance)


@inlined
def _evaluate_three(candidate, threshold, tolerance, best_normals):
    """Evaluate three contacts; see `evaluate`."""
    if candidate.counts[0] == 1 and candidate.counts[1] == 1 and candidate.counts[2] == 1:
        return _evaluate_smooth(candidate, threshold, tolerance)
    if not (
        _set_fans(candidate)
        and fans_force_closed(threshold, best_normals, candidate.plane, candidate.fans)
    ):
        return math.inf
    return critical_of_fans(
        0.0, threshold, tolerance, best_normals, candidate.plane, candidate.fans
    )


@inlined
def _force_part(candidate, i, u):
    """Force part at contact i of a direction: u_f + u_tau x p, with p from the first contact."""
    x, y, z = (
        candidate.points[i, 0] - candidate.points[0, 0],
        candidate.points[i, 1] - candidate.points[0, 1],
        candidate.points[i, 2] - candidate.points[0, 2],
    )
    return (
        u[0] + u[4] * z - u[5] * y,
        u[1] + u[5] * x - u[3] * z,
        u[2] + u[3] * y - u[4] * x,
    )


@inlined
def _separation_sine(candidate, i, u, best_normals):
    """Sine of the largest friction angle for which a direction separates a contact's forces.

    The largest over the contact's normals, or with `best_normals` the smallest; 1 where the
    direction has no force part at the contact.
    """
    gx, gy, gz = _force_part(candidate, i, u)
    size = math.sqrt(gx * gx + gy * gy + gz * gz)
    if not size > 0.0:
        return 1.0
    most, least = -1.0, 1.0
    for k in range(candidate.counts[i]):
        normal = candidate.normals[i, k]
        opposing = -(normal[0] * gx + normal[1] * gy + normal[2] * gz) / size
        most, least = max(most, opposing), min(least, opposing)
    return least if best_normals else most


@inlined
def _is_separated(candidate, n, sine, best_normals):
    """Whether a remembered direction separates the candidate at the friction angle of this sine.

    A successful direction is moved to the front.
    """
    for d in range(candidate.direction_use[0]):
        u, i = candidate.directions[d], 0
        while i < n and _separation_sine(candidate, i, u, best_normals) >= sine:
            i += 1
        if i == n:
            # Move to the front what was successful: the next candidates are similar.
            for k in range(6):
                last = candidate.directions[0, k]
                candidate.directions[0, k] = candidate.directions[d, k]
                candidate.directions[d, k] = last
            return True
    return False


@inlined
def _write_axes(candidate, n):
    """Write the wrenches of the chosen normals and tangents, moments about the first contact."""
    for i in range(n):
        x, y, z = (
            candidate.points[i, 0] - candidate.points[0, 0],
            candidate.points[i, 1] - candidate.points[0, 1],
            candidate.points[i, 2] - candidate.points[0, 2],
        )
        normal, axes = candidate.normals[i, candidate.chosen[i]], candidate.axes[i]
        nx, ny, nz = normal[0], normal[1], normal[2]
        # Tangents from the cross product with z, or with x where the normal is close to z.
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
def _store_direction(candidate, u):
    """Remember a separating direction at the front, in place of the oldest one."""
    use = candidate.direction_use
    row = use[1]
    for k in range(6):
        candidate.directions[row, k] = candidate.directions[0, k]
        candidate.directions[0, k] = u[k]
    use[0] = max(use[0], row + 1)
    use[1] = row + 1 if row + 1 < MAX_DIRECTIONS else 1


@inlined
def _hull_force_closed(candidate, n, angle):
    """Closure test of the chosen normals by a hull; remembers the separating direction."""
    _write_axes(candidate, n)
    # Unit forces on the rim of a circular cone of half-angle `angle`.
    normal, tangential = math.cos(angle), math.sin(angle)
    for i in range(n):
        candidate.cones[i, 0], candidate.cones[i, 1] = normal, tangential
    spherical, rolling = True, False
    space = WrenchSpace(
        TOTAL,
        spherical,
        NO_TORSION,
        candidate.axes[:n],
        candidate.cones[:n],
        candidate.rim,
        rolling,
    )
    _, lower, _, _, facets = grow(
        space, SIX, candidate.metric, None, AROUND_ORIGIN, SIGN, candidate.polytope
    )
    if facets > 0 and lower > ROUNDING:
        return True
    _store_direction(candidate, candidate.polytope.vectors[16])
    return False


@inlined
def _proven_angle(candidate, n):
    """Lower bound of the chosen normals' critical angle, from the last separating direction."""
    least = 1.0
    for i in range(n):
        gx, gy, gz = _force_part(candidate, i, candidate.directions[0])
        size = math.sqrt(gx * gx + gy * gy + gz * gz)
        normal = candidate.normals[i, candidate.chosen[i]]
        if size > 0.0:
            least = min(least, -(normal[0] * gx + normal[1] * gy + normal[2] * gz) / size)
    return math.asin(min(max(least, 0.0), 1.0))


@inlined
def _critical_of_chosen(candidate, n, low, high, tolerance):
    """Critical angle of the chosen normals between two angles, by bisection [rad].

    `high` is returned where nothing lower is force-closed. After a failed test the separating
    direction may raise the lower end beyond the middle.
    """
    while high - low > tolerance:
        middle = 0.5 * (low + high)
        if _hull_force_closed(candidate, n, middle):
            high = middle
        else:
            low = max(middle, min(_proven_angle(candidate, n), high))
    return high


@scratch_kernel
def evaluate(candidate, n, threshold, tolerance, best_normals):
    """Critical friction angle of a grasp over its worst or best normals, if below a threshold.

    The closure test and the bisection are one function because every function that calls the
    growing hull takes as long to compile as the hull.

    Args:
        candidate: `Candidate`; no two contacts coincide.
        n: Contacts, 3 or more.
        threshold: Friction angle at which the grasp must be force-closed [rad], at most pi / 2.
        tolerance: Width of the bracket [rad] whose upper end is returned.
        best_normals: The smallest over all combinations of the contacts' normals; else the largest.

    Returns:
        The angle; inf where the grasp is not force-closed at the threshold, as three collinear
        contacts never are.
    """
    if n == 3:
        return _evaluate_three(candidate, threshold, tolerance, best_normals)
    if _is_separated(candidate, n, math.sin(threshold), best_normals):
        return math.inf
    found = math.inf if best_normals else 0.0
    # Over the worst normals: first test all combinations, then find the largest angle.
    testing = not best_normals
    _first_combination(candidate, n)
    while True:
        # Over the worst normals only a combination that fails at the largest angle so far can
        # raise it; over the best ones only one that succeeds below the smallest can lower it.
        if testing:
            tested = threshold
        elif best_normals:
            tested = min(threshold, found - tolerance)
        else:
            tested = found
        closed = tested > 0.0 and _hull_force_closed(candidate, n, tested)
        if testing and not closed:
            return math.inf
        if not testing and closed == best_normals:
            low, high = (0.0, tested) if best_normals else (tested, threshold)
            found = _critical_of_chosen(candidate, n, low, high, tolerance)
        if not _next_combination(candidate, n):
            if not testing:
                return found
            testing = False
            _first_combination(candidate, n)
