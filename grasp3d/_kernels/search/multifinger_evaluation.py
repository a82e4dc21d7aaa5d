"""Evaluation of one candidate grasp: force closure, and its critical friction angle.

Most candidates are rejected: they are not force-closed at the best critical angle found so far. A
grasp that is not force-closed has a separating direction, in which none of its wrenches has a
positive component. The latest separating directions are remembered and tried first, since the next
candidates share most of their contacts and are often separated by the same direction: that costs a
few products instead of a hull. Three contacts are evaluated in the plane through them (Ponce &
Faverjon 1995), without a hull.

On a crease or at a corner a contact may have any normal of a set, which a cap about its centre
contains: what the friction cone about the centre, narrower by the cap's radius, can do holds with
every normal of the set. A location error makes the cap wider by the turn of the contact.
"""

import math
from typing import NamedTuple

import numpy as np

from grasp3d._kernels.array_types import Floats1, Floats2, Floats3, Ints1
from grasp3d._kernels.compiling import merged, part
from grasp3d._kernels.hull.growing_hull import AROUND_ORIGIN, grow
from grasp3d._kernels.hull.polytope import Polytope, make_polytope
from grasp3d._kernels.hull.support_functions import SIX, TOTAL, WrenchSpace
from grasp3d._kernels.hull.wrench_problem import SIGN
from grasp3d._kernels.search.coplanar_contacts import (
    arc_sine,
    cones_force_closed,
    critical_of_normals,
    set_cones,
    set_contact_plane,
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
    normals: Floats2
    """Inward unit normals (n, 3), the centre of the set on creases."""
    radii: Floats1
    """Largest angle from it to a normal that the contact may have, its turn included [rad] (n,)."""


class HullScratch(NamedTuple):
    """Scratch arrays for the evaluation of more contacts."""

    sines: Floats1
    """Sine from which a direction separates each contact's forces (n,)."""
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


def make_candidate(contacts: int) -> Candidate:
    """Allocate a candidate of so many contacts."""
    return Candidate(
        points=np.zeros((contacts, 3)),
        normals=np.zeros((contacts, 3)),
        radii=np.zeros(contacts),
    )


def make_hull_scratch(contacts: int) -> HullScratch:
    """Allocate the arrays for so many contacts."""
    return HullScratch(
        sines=np.zeros(contacts),
        directions=np.zeros((MAX_DIRECTIONS, 6)),
        direction_use=np.zeros(2, dtype=np.int64),
        axes=np.zeros((contacts, 4, 6)),
        cones=np.zeros((contacts, 2)),
        metric=np.ones(6),
        polytope=make_polytope(MAX_FACETS),
    )


@merged
def _any_exceeds_elevation(candidate, angle):
    """Whether the normal of one of three contacts rises over their plane by its cone's half-angle.

    Balanced forces of three contacts lie in that plane, which such a friction cone does not reach.
    """
    points, radii, sine = candidate.points, candidate.radii, math.sin(angle)
    normal = cross(difference(points[1], points[0]), difference(points[2], points[0]))
    for i in range(3):
        if radii[i] >= angle:
            return True
        own = sine if radii[i] == 0.0 else math.sin(angle - radii[i])
        along = dot(candidate.normals[i], normal)
        if along * along >= own * own * dot(normal, normal):
            return True
    return False


@merged
def _evaluate_three(candidate, plane, threshold, tolerance):
    """Evaluate three contacts; see `evaluate`."""
    normals, radii = candidate.normals, candidate.radii
    # Most candidates are rejected by the elevation of their normals, which needs no projection.
    if _any_exceeds_elevation(candidate, threshold) or not (
        set_contact_plane(candidate.points, plane)
    ):
        return math.inf
    for i in range(3):
        set_normal(normals[i], radii[i], i, plane)
    if not (set_cones(threshold, plane) and cones_force_closed(plane)):
        return math.inf
    # Below the steepest elevation some cone does not intersect the plane.
    low = 0.0
    for i in range(3):
        low = max(low, arc_sine(abs(dot(plane.frame[2], normals[i]))) + radii[i])
    return critical_of_normals(plane, min(low, threshold), threshold, tolerance)


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
def _separates(candidate, i, u, sine):
    """Whether a direction separates a contact's forces, or has no force part there."""
    force = _force_part(candidate.points, i, u)
    size = norm(force)
    return not size > 0.0 or -dot(candidate.normals[i], force) >= sine * size


@merged
def _is_separated(candidate, hull, n):
    """Whether a remembered direction separates the candidate; that is moved to the front."""
    directions = hull.directions
    for d in range(hull.direction_use[0]):
        u, i = directions[d], 0
        while i < n and _separates(candidate, i, u, hull.sines[i]):
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
def _write_axes(candidate, n, all_axes):
    """Write the wrenches of the normals and tangents, moments about the first contact."""
    points, normals = candidate.points, candidate.normals
    for i in range(n):
        arm, normal = difference(points[i], points[0]), triple(normals[i], 0)
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
    """Closure test at a friction angle by a hull; remembers the separating direction."""
    axes, cones, polytope = hull.axes, hull.cones, hull.polytope
    _write_axes(candidate, n, axes)
    # Unit forces on the rim of circular cones.
    for i in range(n):
        own = angle - candidate.radii[i]
        cones[i, 0], cones[i, 1] = math.cos(own), math.sin(own)
    spherical, soft = True, False
    space = WrenchSpace(TOTAL, spherical, soft, axes[:n], cones[:n], 1)
    _, lower, _, _, facets = grow(space, SIX, hull.metric, None, AROUND_ORIGIN, SIGN, polytope)
    if facets > 0 and lower > ROUNDING:
        return True
    _store_direction(hull.directions, hull.direction_use, polytope.vectors[16])
    return False


@merged
def _proven_angle(candidate, direction, n):
    """Lower bound of the critical angle, from the last separating direction [rad]."""
    least = RIGHT_ANGLE
    for i in range(n):
        force = _force_part(candidate.points, i, direction)
        size = norm(force)
        if size > 0.0:
            sine = -dot(candidate.normals[i], force) / size
            least = min(least, max(arc_sine(sine), 0.0) + candidate.radii[i])
    return least


@merged
def _evaluate_by_hulls(candidate, hull, n, threshold, tolerance):
    """Evaluate more than three contacts; see `evaluate`.

    The first test and the bisection are one loop because every place that calls the growing hull
    takes as long to compile as the hull.
    """
    low, high, tested = 0.0, math.inf, threshold
    for i in range(n):
        low = max(low, candidate.radii[i])
        hull.sines[i] = math.sin(threshold - candidate.radii[i])
    if low >= threshold or _is_separated(candidate, hull, n):
        return math.inf
    while high - low > tolerance:
        if _hull_force_closed(candidate, hull, n, tested):
            high = tested
        elif high == math.inf:
            return math.inf
        else:  # the separating direction may raise the lower end beyond the middle
            low = max(tested, min(_proven_angle(candidate, hull.directions[0], n), high))
        tested = 0.5 * (low + high)
    return high


@part
def evaluate(candidate, plane, hull, n, threshold, tolerance):
    """Critical friction angle of a grasp over the worst of its normals, if below a threshold.

    Args:
        candidate: `Candidate`; no two contacts coincide.
        plane: `Plane`, for three contacts.
        hull: `HullScratch`; None: there are three contacts, for which no hull is compiled.
        n: Contacts, 3 or more.
        threshold: Friction angle at which the grasp must be force-closed [rad], at most pi / 2.
        tolerance: Width of the bracket whose upper end is returned [rad].

    Returns:
        The angle; inf where the grasp is not force-closed at the threshold, as three collinear
        contacts never are.
    """
    if hull is None:
        return _evaluate_three(candidate, plane, threshold, tolerance)
    return _evaluate_by_hulls(candidate, hull, n, threshold, tolerance)
