"""The growing hull: epsilon without the convex hull.

Ferrari & Canny 1992 take the distance from the origin to the nearest facet of the grasp wrench
space. A polytope inside that space is grown only where its boundary is nearest to the origin, until
its nearest facet is a facet of the space itself.

Every plane through a ridge of the horizon lies in the pencil of the two facets that meet there: for
a new vertex at height s above the one and -t below the other, the new facet's plane is s times the
other's plus t times the one's. No elimination, and nothing that a degenerate facet could break.
"""

import math

import numpy as np

from grasp3d._kernels.compiling import merged, scratch_kernel
from grasp3d._kernels.initial_simplex import STANDS, first_simplex
from grasp3d._kernels.polytope import TOLERANCE, height_above, set_plane
from grasp3d._kernels.support_functions import support
from grasp3d._kernels.vectors import dot6, leave

CONVERGED, UNDECIDED, STALLED, EXHAUSTED = 0, 1, 2, 3
"""How the growth of a hull ended; see `grasp3d.quality.ferrari_canny.Status`."""

FLAT = 1e-4
"""Share of two planes that may cancel in a pencil before the facet is laid through its vertices."""

FEW = 1024
"""Facets up to which all are tested against a new vertex; beyond, those around the nearest."""

BEYOND = np.uint32(1 << 31)
"""Mark of a neighbour that is a new facet beyond the horizon."""

UNSET = np.uint32((1 << 32) - 1)
"""Mark of a neighbour that is not known yet."""

THREE = np.uint32(3)
SEVEN = np.uint32(7)


@merged
def _nearest(polytope, size, limit, sign):
    """Drop what is no candidate any more, and take out the nearest facet; -1: none is left."""
    near, planes = polytope.near, polytope.planes
    kept, place, key = 0, -1, limit
    for i in range(size):
        f = near[i]
        near[kept] = f
        value = planes[6, f] - sign * planes[7, f]  # nan where the facet is gone
        if value < key:
            key, place = value, kept
        kept += value < limit
    if place < 0:
        return 0, -1, key
    f = near[place]
    near[place] = near[kept - 1]
    return kept - 1, np.int64(f), key


@merged
def _link(polytope, dim, ridges):
    """Find the neighbours of the facets made last, by walking about the faces that they share."""
    corners, across, horizon = polytope.corners, polytope.across, polytope.horizon
    for r in range(ridges):
        v, k = horizon[r] >> THREE, horizon[r] & SEVEN
        new = across[v, k] & ~BEYOND
        for b in range(dim):
            if across[new, b] != UNSET:
                continue
            # The face is v without its corners k and b. Go around it through what was seen.
            at, leaving, staying = v, np.uint32(b), k
            while True:
                link = across[at, leaving]
                if link & BEYOND:
                    break
                corner = corners[at, staying]
                at, staying = link >> THREE, link & SEVEN
                leaving = np.uint32(0)
                for c in range(dim):
                    if corners[at, c] == corner:
                        leaving = np.uint32(c)
            twin = link & ~BEYOND
            across[new, b] = 8 * twin + staying
            across[twin, staying] = 8 * new + b


@merged
def _test_all(polytope, dim, used, point):
    """Find the facets that a point sees, and the ridges of their horizon, among all."""
    planes, across, marks = polytope.planes, polytope.across, polytope.marks
    heights, seen, horizon = polytope.heights, polytope.seen, polytope.horizon
    count = ridges = 0
    for f in range(used):
        heights[f] = height_above(planes, f, point)
    for f in range(used):
        seen[count] = f
        marks[f] = heights[f] > planes[7, f]
        count += marks[f]
    for i in range(count):
        v = seen[i]
        for k in range(dim):
            horizon[ridges] = 8 * v + k
            ridges += 1 - marks[across[v, k] >> THREE]
    return count, ridges


@merged
def _test_around(polytope, dim, first, stamp, point):
    """The same from one facet on, through its neighbours."""
    planes, across, marks = polytope.planes, polytope.across, polytope.marks
    heights, seen, horizon = polytope.heights, polytope.seen, polytope.horizon
    heights[first] = height_above(planes, first, point)
    marks[first], seen[0] = stamp + 1, first
    count, done, ridges = 1, 0, 0
    while done < count:
        v = seen[done]
        for k in range(dim):
            other = across[v, k] >> THREE
            if marks[other] < stamp:
                heights[other] = height_above(planes, other, point)
                marks[other] = stamp
                if heights[other] > planes[7, other]:
                    marks[other] = stamp + 1
                    seen[count] = other
                    count += 1
            if marks[other] == stamp:
                horizon[ridges] = 8 * v + k
                ridges += 1
        done += 1
    return count, ridges


@scratch_kernel
def _lay_through(polytope, dim, f, metric):
    """Turn a facet's plane so that it runs through its vertices."""
    points, corners, planes = polytope.points, polytope.corners, polytope.planes
    basis, parts, normal = polytope.vectors[0:6], polytope.vectors[14], polytope.vectors[15]
    first, size = points[corners[f, 0]], 0
    for c in range(1, dim):
        edge = basis[size]
        for k in range(6):
            edge[k] = points[corners[f, c], k] - first[k]
        before = dot6(edge, edge)
        leave(basis, size, edge, parts)
        leave(basis, size, edge, parts)
        square = dot6(edge, edge)
        if square > TOLERANCE * before:
            factor = 1.0 / math.sqrt(square)
            for k in range(6):
                edge[k] *= factor
            size += 1
    for k in range(6):
        normal[k] = planes[k, f]
    before = dot6(normal, normal)
    leave(basis, size, normal, parts)
    leave(basis, size, normal, parts)
    if dot6(normal, normal) > 0.25 * before:  # else it has no plane of its own: keep the pencil's
        height = dot6(normal, first)
        set_plane(
            planes, f, normal[0], normal[1], normal[2], normal[3], normal[4], normal[5], height,
            metric,
        )  # fmt: skip


@merged
def _join(polytope, dim, ridge, new, vertex, metric):
    """Make the facet of a ridge of the horizon and the new vertex."""
    planes, corners, across = polytope.planes, polytope.corners, polytope.across
    v, k = ridge >> THREE, ridge & SEVEN
    link = across[v, k]
    other, place = link >> THREE, link & SEVEN
    for c in range(dim):
        corners[new, c] = corners[v, c]
        across[new, c] = UNSET
    corners[new, k] = vertex
    across[new, k] = link
    across[other, place] = 8 * new + k
    across[v, k] = BEYOND | new
    polytope.marks[new] = 0
    s, t = polytope.heights[v], -min(polytope.heights[other], 0.0)
    n0 = s * planes[0, other] + t * planes[0, v]
    n1 = s * planes[1, other] + t * planes[1, v]
    n2 = s * planes[2, other] + t * planes[2, v]
    n3 = s * planes[3, other] + t * planes[3, v]
    n4 = s * planes[4, other] + t * planes[4, v]
    n5 = s * planes[5, other] + t * planes[5, v]
    height = s * planes[6, other] + t * planes[6, v]
    square = set_plane(planes, new, n0, n1, n2, n3, n4, n5, height, metric)
    if not square > FLAT * FLAT * (s + t) * (s + t):
        _lay_through(polytope, dim, np.int64(new), metric)


@merged
def _is_corner(polytope, dim, f, point, name):
    """Whether a supporting wrench is a vertex of the facet that it should lie above."""
    points, corners = polytope.points, polytope.corners
    for c in range(dim):
        corner = corners[f, c]
        if name >= 0 and polytope.names[corner] == name:
            return True
        apart = 0.0
        for k in range(6):
            apart = max(apart, abs(points[corner, k] - point[k]))
        if apart <= TOLERANCE:
            return True
    return False


@merged
def _take(plane, f, planes):
    for k in range(8):
        plane[k] = planes[k, f]


@scratch_kernel
def grow(body, dims, metric, goal, polytope):
    """Grow a polytope until its nearest facet is one of the grasp wrench space.

    Args:
        body: `Body`.
        dims: As long as the grasp's rank, 1 to 6; a tuple makes that length known when compiled.
        metric: Coordinates are balanced, so that wrenches reach about 1 along each; a direction is
            as long as the root of the sum of these times its squares (6,).
        goal: (rtol, atol, cutoff, sign): how near the bounds must come, as a share of the upper
            one and in tolerances; the value from which it does not matter; 1.0 if the sign is all
            that is asked, with a cutoff of 0.
        polytope: `Polytope`.

    Returns:
        (status, lower, upper, vertices, facets): the bounds, the direction of `upper` in row 16 of
        `polytope.vectors`, and what is in use of the polytope; no facets: the grasp is not closed,
        and no wrench lies in that direction. EXHAUSTED: the polytope is full; the bounds hold.
    """
    dim = len(dims)
    rtol, atol, cutoff, sign = goal
    points, planes, near = polytope.points, polytope.planes, polytope.near
    best, plane = polytope.vectors[16], polytope.vectors[17]
    row = first_simplex(body, dims, metric, polytope)
    if row != STANDS:
        for k in range(6):
            best[k] = polytope.vectors[row, k]
        return CONVERGED, 0.0, 0.0, 0, 0
    vertices = used = dim + 1
    lower, upper, limit = math.inf, math.inf, cutoff
    status, size, spare, stamp, count, ridges = CONVERGED, used, 0, 0, 0, 0
    first = 0
    for f in range(used):
        near[f] = f
        if planes[6, f] < planes[6, first]:
            first = f
        if planes[6, f] - sign * planes[7, f] >= cutoff:
            lower = min(lower, planes[6, f])
    _take(best, first, planes)
    while True:
        size, f, key = _nearest(polytope, size, limit, sign)
        if f < 0:
            break
        _take(plane, f, planes)
        if vertices >= points.shape[0]:
            lower, status = min(lower, plane[6]), EXHAUSTED
            break
        point = points[vertices]
        height, name, owner = support(body, plane, point, polytope.mixes[vertices])
        if height < upper:
            upper = height
            _take(best, f, planes)
            if height <= plane[7]:
                return CONVERGED, 0.0, 0.0, 0, 0
            limit = min(cutoff, upper - max(rtol * upper, plane[7] * (1.0 + atol)))
        if height - plane[6] <= plane[7] or key >= limit:
            lower = min(lower, plane[6])
            continue
        if _is_corner(polytope, dim, f, point, name):
            lower, status = min(lower, plane[6]), STALLED
            continue
        polytope.names[vertices], polytope.owners[vertices] = name, owner
        # Neighbours are asked for from now on only, so those of the last facets never are.
        _link(polytope, dim, ridges)
        for i in range(count):
            polytope.free[spare] = polytope.seen[i]
            spare += 1
        if used <= FEW:
            count, ridges = _test_all(polytope, dim, used, point)
        else:
            stamp += 2
            count, ridges = _test_around(polytope, dim, np.uint32(f), stamp, point)
        if used + ridges > planes.shape[1] + spare or size + ridges > near.shape[0]:
            lower, status = min(lower, plane[6]), EXHAUSTED
            break
        for r in range(ridges):
            if spare > 0:
                spare -= 1
                new = polytope.free[spare]
            else:
                new = np.uint32(used)
                used += 1
            _join(polytope, dim, polytope.horizon[r], new, vertices, metric)
            near[size] = new
            key = planes[6, new] - sign * planes[7, new]
            size += key < limit
            lower = min(lower, math.inf if key < limit else planes[6, new])
        for i in range(count):
            planes[6, polytope.seen[i]] = math.nan
        vertices += 1
    for i in range(size):
        if planes[6, near[i]] < lower:
            lower = planes[6, near[i]]
    if status == CONVERGED and lower <= 0.0:
        status = UNDECIDED
    return status, lower, upper, vertices, used
