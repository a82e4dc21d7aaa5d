"""The first grasps of three fingers through a vertex: pairs of candidate points."""

import math

from grasp3d._kernels.compiling.decorators import merged
from grasp3d._kernels.search.coplanar_contacts import set_contact_plane
from grasp3d._kernels.search.multifinger_contacts import distances_allowed, set_point_contact
from grasp3d._kernels.search.multifinger_evaluation import RIGHT_ANGLE, evaluate
from grasp3d._kernels.search.multifinger_grasps import STARTS

MAX_PAIRINGS = 128
"""Points following a candidate point with which it is paired: any consecutive ones are well spread,
and the work grows linearly with the number of points."""


@merged
def _exceeds_elevation(candidate, i, sine, mx, my, mz):
    """Whether a contact's only normal rises over the plane with normal m by an angle or more."""
    if candidate.counts[i] != 1:
        return False
    normal = candidate.normals[i, 0]
    along = normal[0] * mx + normal[1] * my + normal[2] * mz
    return along * along >= sine * sine * (mx * mx + my * my + mz * mz)


@merged
def _any_exceeds_elevation(candidate, sine):
    """Whether a normal of three contacts rises over their plane by an angle of this sine or more.

    Balanced forces of three contacts lie in that plane, which such a friction cone does not reach.
    """
    p, q, r = candidate.points[0], candidate.points[1], candidate.points[2]
    ax, ay, az = q[0] - p[0], q[1] - p[1], q[2] - p[2]
    bx, by, bz = r[0] - p[0], r[1] - p[1], r[2] - p[2]
    mx, my, mz = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
    return (
        _exceeds_elevation(candidate, 0, sine, mx, my, mz)
        or _exceeds_elevation(candidate, 1, sine, mx, my, mz)
        or _exceeds_elevation(candidate, 2, sine, mx, my, mz)
    )


@merged
def list_reachable(v, own, most, domain, candidate_points, limits, workspace):
    """List candidate points at allowed distances from a vertex, its own point first.

    Returns:
        Their number, at most `most` + 1.
    """
    count = 0
    points = domain.surface.points
    if own >= 0:
        workspace.reachable[0] = own
        count = 1
    for s in range(candidate_points.common_count):
        if count > most:
            break
        square = 0.0
        for c in range(3):
            d = candidate_points.points[s, c] - points[v, c]
            square += d * d
        if (
            limits.min_distance * limits.min_distance
            <= square
            <= limits.max_distance * limits.max_distance
        ):
            workspace.reachable[count] = s
            count += 1
    return count


@merged
def _keep_start(angle, one, two, workspace):
    """Insert a pair into the sorted list of the best starts, which have no point in common.

    A pair that shares a point with a start replaces it where it is better; starts that differ in
    both points lead the refinement to different optima.
    """
    angles, pairs = workspace.angles, workspace.start_points
    row = STARTS - 1
    for k in range(STARTS):
        shared = one in (pairs[k, 0], pairs[k, 1]) or two in (pairs[k, 0], pairs[k, 1])
        if angles[k] < math.inf and shared:
            if angle >= angles[k]:
                return
            row = k
            break
    if angle >= angles[row]:
        return
    while row > 0 and angle < angles[row - 1]:
        angles[row] = angles[row - 1]
        pairs[row, 0], pairs[row, 1] = pairs[row - 1, 0], pairs[row - 1, 1]
        row -= 1
    angles[row] = angle
    pairs[row, 0], pairs[row, 1] = one, two


@merged
def seed_pairs(count, domain, candidate_points, limits, workspace, planar, hull):
    """Evaluate pairs of reachable candidate points as second and third contacts of a vertex."""
    candidate = workspace.candidate
    for k in range(STARTS):
        workspace.angles[k] = math.inf
    for a in range(count):
        one = workspace.reachable[a]
        if not set_point_contact(1, one, domain, candidate_points, candidate):
            continue
        # The vertex's own point, its opposing contact of two fingers, is paired with all others.
        last = count if a == 0 else min(count, a + 1 + MAX_PAIRINGS)
        for b in range(a + 1, last):
            two = workspace.reachable[b]
            if not (
                set_point_contact(2, two, domain, candidate_points, candidate)
                and distances_allowed(candidate, 2, 2, limits)
            ):
                continue
            workspace.evaluated[0] += 1
            # Worse than the last start: most pairs are rejected by the elevation of their normals,
            # which needs no projection.
            threshold = min(workspace.angles[STARTS - 1] - limits.margin, limits.max_angle)
            if threshold > 0.0 and not _any_exceeds_elevation(candidate, math.sin(threshold)):
                angle = evaluate(
                    candidate, planar, hull, 3, threshold, limits.tolerance, limits.best_normals
                )
                if angle < math.inf:
                    _keep_start(angle, one, two, workspace)


@merged
def first_pair(count, domain, candidate_points, limits, workspace, plane):
    """Take the first allowed pair of candidate points, where any critical angle is accepted."""
    candidate = workspace.candidate
    for a in range(count):
        for b in range(a + 1, count):
            one, two = workspace.reachable[a], workspace.reachable[b]
            if workspace.angles[0] == math.inf and (
                set_point_contact(1, one, domain, candidate_points, candidate)
                and set_point_contact(2, two, domain, candidate_points, candidate)
                and distances_allowed(candidate, 2, 2, limits)
                and set_contact_plane(candidate.points, plane)
            ):
                workspace.angles[0] = RIGHT_ANGLE
                workspace.start_points[0, 0], workspace.start_points[0, 1] = one, two
