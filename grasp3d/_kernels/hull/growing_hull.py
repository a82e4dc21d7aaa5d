"""The growing hull: Ferrari & Canny's epsilon without the complete convex hull.

Epsilon (Ferrari & Canny 1992) is the distance from the origin to the nearest facet of the grasp
wrench space. Its complete hull has hundreds to thousands of facets, of which epsilon needs one. So
a polytope inside the space, whose vertices are support wrenches, is grown only at its facet nearest
to the origin: the support function in the direction of that facet's normal either confirms that the
facet is one of the space itself, or returns a new vertex above it (an expanding polytope as in van
den Bergen 2001, with certified bounds). The first polytope is a simplex, chosen to contain the
origin.

A new vertex sees the facets whose planes it lies above. These are removed; the ridges between them
and the facets that stay form the horizon, and each ridge of the horizon with the new vertex makes a
new facet. Every hyperplane through a ridge lies in the pencil of the two facets that meet there, a
linear combination of their planes: with the new vertex at height s > 0 above the visible facet and
-t <= 0 below the other one, the new facet's plane is s times the other's plus t times the visible
one's, which is 0 at the new vertex. The weights are non-negative, so only nearly opposite planes
cancel: a dozen multiplications replace an elimination, and degenerate facets do no harm.
"""

import math

import numpy as np

from grasp3d._kernels.compiling import merged, part_for_constants
from grasp3d._kernels.hull.polytope import (
    TOLERANCE,
    distance_of,
    find_visible,
    flood_visible,
    join,
    link_new_facets,
    set_normalised_plane,
    set_plane,
    square_in,
)
from grasp3d._kernels.hull.support_functions import task_reach
from grasp3d._kernels.hull.wrench_resistance import farthest_point
from grasp3d._kernels.surface.vectors import add6, clear6, copy6, dot6, remove_components, scale6

AROUND_ORIGIN, AT_ORIGIN = 0, 1
"""Position of the first simplex: around the origin if possible, or with the origin as a vertex."""

COMPLETE = -1
"""Result of `first_simplex`: the simplex is complete."""

ORIGIN_TOLERANCE = 1e3
"""Distance, in tolerances, up to which an affine hull counts as containing the origin."""


@merged
def _write_orthogonal_direction(basis, size, dim, components, u):
    """Write a direction orthogonal to the basis, based on the unit vector least in its span."""
    largest, axis = -1.0, 0
    for c in range(dim):
        remaining = 1.0
        for j in range(size):
            remaining -= basis[j, c] * basis[j, c]
        if remaining > largest:
            largest, axis = remaining, c
    clear6(u)
    u[axis] = 1.0
    for _ in range(2):
        remove_components(basis, size, u, components)


@merged
def _add_edge(basis, triangle, size, nearest, components):
    """Orthonormalise the newest edge of the simplex, and project the nearest point onto it.

    `nearest` is the point, nearest to the origin, of the affine hull of the vertices so far;
    `triangle` collects the edges' coordinates in the basis.
    """
    e, row = basis[size], triangle[size]
    before = dot6(e, e)
    remove_components(basis, size, e, row)
    square = dot6(e, e)
    if square < 0.25 * before:  # much cancelled: orthogonalise the remainder again
        remove_components(basis, size, e, components)
        for j in range(size):
            row[j] += components[j]
        square = dot6(e, e)
    row[size] = math.sqrt(square)
    for k in range(6):
        e[k] /= row[size]
    for _ in range(2):
        component = dot6(nearest, e)
        add6(nearest, -component, e)


@merged
def _set_facets(basis, triangle, dim, metric, task, polytope, g, x, total):
    """Write the planes and neighbours of the simplex's facets.

    points - points[0] = triangle @ basis. The columns of the inverse are the gradients of the
    barycentric coordinates. The outward normal of a facet is opposite to the gradient of the
    coordinate of the vertex that the facet lacks.
    """
    points, planes = polytope.points, polytope.planes
    clear6(total)
    for j in range(dim):
        clear6(g)
        # Column j of the inverse of the triangular matrix, by forward substitution.
        for i in range(j, dim):
            value = 1.0 if i == j else 0.0
            for k in range(j, i):
                value -= triangle[i, k] * x[k]
            x[i] = value / triangle[i, i]
            add6(g, x[i], basis[i])
        add6(total, 1.0, g)
        scale6(g, -1.0)
        set_normalised_plane(planes, j + 1, g, dot6(g, points[0]), metric, task)
    # The barycentric coordinates sum to 1, so the gradient of the first is minus the others' sum.
    set_normalised_plane(planes, 0, total, dot6(total, points[1]), metric, task)
    for i in range(dim + 1):
        polytope.marks[i] = 0
        for j in range(dim + 1):
            if i != j:
                position = j if j < i else j - 1
                polytope.corners[i, position] = j
                polytope.neighbours[i, position] = j


@part_for_constants
def first_simplex(space, dims, metric, task, start, polytope):
    """Choose affinely independent support wrenches whose simplex contains the origin if possible.

    As in Gilbert, Johnson & Keerthi 1988, each new point is the support in the direction from the
    nearest point of the current affine hull to the origin. If that hull contains the origin, the
    new point is the support in an orthogonal direction, on the side that reaches farther.

    Args:
        space: `WrenchSpace`.
        dims: Sequence as long as the grasp's rank.
        metric: As in `grow`.
        task: As in `grow`.
        start: As in `grow`.
        polytope: `Polytope`; points, planes and neighbours are written.

    Returns:
        COMPLETE, or the row of `polytope.vectors` that holds a direction in which no wrench has a
        positive component.
    """
    dim = len(dims)
    points, vectors, vertex_forces = polytope.points, polytope.vectors, polytope.vertex_forces
    basis, triangle = vectors[0:6], vectors[6:12]
    u, nearest, components, total = vectors[12], vectors[13], vectors[14], vectors[15]
    radius = ORIGIN_TOLERANCE * TOLERANCE
    clear6(nearest)
    pointed = start == AT_ORIGIN
    if pointed:  # the origin, no force at any contact, is the first vertex
        polytope.identifiers[0], polytope.owners[0] = -1, 0
        clear6(points[0])
        clear6(vertex_forces[0])
    for size in range(1 if pointed else 0, dim + 1):
        point = points[size]
        both_ways = False
        if dot6(nearest, nearest) > radius * radius:
            copy6(nearest, u)
            scale6(u, -1.0)
        else:
            _write_orthogonal_direction(basis, size - 1, dim, components, u)
            both_ways = size > 0
        # No wrench with a positive component along u: u separates the origin from the space.
        tolerance = 0.0
        for k in range(6):
            tolerance += TOLERANCE * abs(u[k])
        height, identifier, owner = farthest_point(space, u, point, vertex_forces[size])
        if height <= tolerance and not pointed:
            return 12
        if both_ways:
            scale6(u, -1.0)
            other, other_force = points[size + 1], vertex_forces[size + 1]
            opposite, other_identifier, other_owner = farthest_point(space, u, other, other_force)
            if opposite <= tolerance and not (pointed and height > tolerance):
                return 12
            if opposite > height:
                identifier, owner = other_identifier, other_owner
                copy6(other, point)
                copy6(other_force, vertex_forces[size])
        polytope.identifiers[size], polytope.owners[size] = identifier, owner
        if size == 0:
            copy6(point, nearest)
        else:
            for k in range(6):
                basis[size - 1, k] = point[k] - points[0, k]
            _add_edge(basis, triangle, size - 1, nearest, components)
    _set_facets(basis, triangle, dim, metric, task, polytope, nearest, u, total)
    return COMPLETE


CONVERGED, UNDECIDED, STALLED, EXHAUSTED = 0, 1, 2, 3
"""How the growth of a hull ended, see `grasp3d.quality.ferrari_canny.Status`."""

CANCELLATION = 1e-4
"""Relative length of a combination of two planes below which they are nearly opposite: the facet's
plane is then computed from its vertices."""

MAX_FULL_SCAN = 1024
"""Largest number of facets at which a new vertex is tested against all, which vectorises. With more
facets the visible ones are flooded from the nearest facet."""


@merged
def _pop_nearest(polytope, size, limit, task):
    """Take the nearest facet out of the queue, and drop facets at or beyond the limit.

    Returns:
        (size of the queue, facet or -1 if none is left, its distance from the origin).
    """
    queue, planes = polytope.queue, polytope.planes
    count, position, key = 0, -1, limit
    for i in range(size):
        f = queue[i]
        queue[count] = f
        value = distance_of(planes, f, task)  # nan where the facet was removed
        if value < key:
            key, position = value, count
        count += value < limit
    if position < 0:
        return 0, -1, key
    f = queue[position]
    queue[position] = queue[count - 1]
    return count - 1, np.int64(f), key


@part_for_constants
def _fit_plane(polytope, dim, f, metric, task):
    """Fit a facet's plane to its vertices, by orthogonalising its normal against its edges."""
    points, corners, planes = polytope.points, polytope.corners, polytope.planes
    basis, components, normal = polytope.vectors[0:6], polytope.vectors[14], polytope.vectors[15]
    first, size = points[corners[f, 0]], 0
    for c in range(1, dim):
        edge = basis[size]
        for k in range(6):
            edge[k] = points[corners[f, c], k] - first[k]
        before = dot6(edge, edge)
        remove_components(basis, size, edge, components)
        remove_components(basis, size, edge, components)
        square = dot6(edge, edge)
        if square > TOLERANCE * before:
            factor = 1.0 / math.sqrt(square)
            scale6(edge, factor)
            size += 1
    for k in range(6):
        normal[k] = planes[k, f]
    before = dot6(normal, normal)
    remove_components(basis, size, normal, components)
    remove_components(basis, size, normal, components)
    # With degenerate vertices nearly all cancels: then the combination of planes is kept.
    if dot6(normal, normal) > 0.25 * before:
        set_normalised_plane(planes, f, normal, dot6(normal, first), metric, task)


@merged
def _combine_planes(polytope, dim, r, new, vertex, metric, pinched):
    """Join a horizon ridge and the new vertex, and combine the planes of the ridge's two facets.

    It is the positive combination in the pencil of both old facets that is 0 at the new vertex.
    """
    planes, heights, row = polytope.planes, polytope.heights, polytope.combined[r]
    v, other = join(polytope, dim, polytope.horizon[r], new, vertex, pinched)
    s, t = heights[v], -min(heights[other], 0.0)
    n0 = s * planes[0, other] + t * planes[0, v]
    n1 = s * planes[1, other] + t * planes[1, v]
    n2 = s * planes[2, other] + t * planes[2, v]
    n3 = s * planes[3, other] + t * planes[3, v]
    n4 = s * planes[4, other] + t * planes[4, v]
    n5 = s * planes[5, other] + t * planes[5, v]
    row[0], row[1], row[2], row[3], row[4], row[5] = n0, n1, n2, n3, n4, n5
    row[6] = s * planes[6, other] + t * planes[6, v]
    row[7] = s + t
    polytope.squares[r] = square_in(metric, n0, n1, n2, n3, n4, n5)


@merged
def _add_facets(polytope, dim, ridges, used, free_count, vertex, metric, task, pinched):
    """Add the facets that join the horizon's ridges to the new vertex.

    Square roots and divisions have their own loop, which vectorises.

    Returns:
        The numbers of facets in use and of free facets.
    """
    added, squares, factors = polytope.added, polytope.squares, polytope.factors
    for r in range(ridges):
        if free_count > 0:
            free_count -= 1
            new = polytope.free[free_count]
        else:
            new = np.uint32(used)
            used += 1
        added[r] = new
        _combine_planes(polytope, dim, r, new, vertex, metric, pinched)
    for r in range(ridges):
        factors[r] = 1.0 / math.sqrt(squares[r])
    for r in range(ridges):
        new, row = added[r], polytope.combined[r]
        polytope.marks[new] = 0
        set_plane(
            polytope.planes, new, row[0], row[1], row[2], row[3], row[4], row[5], row[6],
            factors[r], task,
        )  # fmt: skip
        if not squares[r] > CANCELLATION * CANCELLATION * row[7] * row[7]:
            _fit_plane(polytope, dim, np.int64(new), metric, task)
    return used, free_count


@merged
def _known(distance):
    """A distance, or -inf if it could not be computed."""
    return distance if distance == distance else -math.inf  # noqa: PLR0124


@merged
def _queue_facets(polytope, ridges, size, limit, lower, task):
    """Queue those of the facets added last that are nearer than a limit.

    Returns:
        (size of the queue, least distance of all facets not queued so far; -inf if a plane could
        not be computed).
    """
    added, queue, planes = polytope.added, polytope.queue, polytope.planes
    for r in range(ridges):
        new = added[r]
        queue[size] = new
        distance = distance_of(planes, new, task)
        near = distance < limit
        size += near
        lower = min(lower, math.inf if near else _known(distance))
    return size, lower


@merged
def _is_corner(polytope, dim, f, point, identifier):
    """Whether a support wrench is already a vertex of the facet.

    In exact arithmetic it would then not lie above the facet; continuing would loop for ever.
    """
    points, corners = polytope.points, polytope.corners
    for c in range(dim):
        corner = corners[f, c]
        if identifier >= 0 and polytope.identifiers[corner] == identifier:
            return True
        distance = 0.0
        for k in range(6):
            distance = max(distance, abs(points[corner, k] - point[k]))
        if distance <= TOLERANCE:
            return True
    return False


@merged
def _per_reach(plane, task):
    """Factor that converts distances along a plane's normal to multiples of the task's reach."""
    if task is None:
        return 1.0
    reach = task_reach(task, plane)
    return 1.0 / reach if reach > 0.0 else math.inf


@merged
def _copy_plane(plane, f, planes):
    """Copy a facet's column of `planes`."""
    for k in range(8):
        plane[k] = planes[k, f]


@part_for_constants
def grow(space, dims, metric, task, start, goal, polytope):
    """Grow a polytope until its nearest facet is a facet of the grasp wrench space.

    Args:
        space: `WrenchSpace` or `ForceSlice`.
        dims: Sequence as long as the grasp's rank, 1 to 6; a tuple fixes the loops' length at
            compile time.
        metric: Weights of a direction's squared components in its squared length (6,). Coordinates
            are balanced so that wrenches reach about 1 along each of them.
        task: `TaskInSpan` that the space must contain when scaled. Distances are then relative to
            the task, and the result is 1 over the scale. None for the unit ball, for epsilon.
        start: AROUND_ORIGIN, or AT_ORIGIN for a task that a grasp without force closure may
            resist as well.
        goal: (rtol, atol, cutoff), the largest gap between the bounds, relative to the upper one
            and absolute, and the epsilon above which the exact value is not needed.
        polytope: `Polytope`.

    Returns:
        (status, lower, upper, vertices, facets): bounds of epsilon, with the direction of `upper`
        in row 16 of `polytope.vectors`, and the numbers of vertices and facets in use. With 0
        facets the grasp is not force-closed: no wrench has a positive component in that direction.
        If EXHAUSTED, the polytope is full, but the bounds are valid.
    """
    dim = len(dims)
    rtol, atol, cutoff = goal
    points, planes, queue = polytope.points, polytope.planes, polytope.queue
    best, plane = polytope.vectors[16], polytope.vectors[17]
    row = first_simplex(space, dims, metric, task, start, polytope)
    if row != COMPLETE:  # all wrenches lie in a half-space: the direction proves it
        copy6(polytope.vectors[row], best)
        return CONVERGED, 0.0, 0.0, 0, 0
    vertices = used = dim + 1
    lower, upper, limit = math.inf, math.inf, cutoff
    status, size, free_count, stamp, count, ridges = CONVERGED, used, 0, 0, 0, 0
    first, pinched = 0, False
    # Facets at or beyond `limit` no longer determine epsilon; they only count for `lower`.
    for f in range(used):
        queue[f] = f
        distance = distance_of(planes, f, task)
        if distance < distance_of(planes, first, task):
            first = f
        if not distance < cutoff:
            lower = min(lower, _known(distance))
    _copy_plane(best, first, planes)
    while True:
        size, f, key = _pop_nearest(polytope, size, limit, task)
        if f < 0:
            break
        _copy_plane(plane, f, planes)
        scale = _per_reach(plane, task)
        if vertices >= points.shape[0]:
            lower, status = min(lower, scale * plane[6]), EXHAUSTED
            break
        point = points[vertices]
        height, identifier, owner = farthest_point(
            space, plane, point, polytope.vertex_forces[vertices]
        )
        if height <= plane[7]:  # the plane through the origin separates
            _copy_plane(best, f, planes)
            return CONVERGED, 0.0, 0.0, 0, 0
        if scale * height < upper:
            upper = scale * height
            _copy_plane(best, f, planes)
            limit = min(cutoff, upper - max(rtol * upper, scale * plane[7], atol))
        # The facet is one of the grasp wrench space itself, or need not be known more exactly.
        if height - plane[6] <= plane[7] or key >= limit:
            lower = min(lower, scale * plane[6])
            continue
        if _is_corner(polytope, dim, f, point, identifier):
            lower, status = min(lower, scale * plane[6]), STALLED
            continue
        polytope.identifiers[vertices], polytope.owners[vertices] = identifier, owner
        # Facets are linked only when neighbours are needed, so the last ones never are.
        pinched = link_new_facets(polytope, dim, ridges, vertices) or pinched
        for i in range(count):
            polytope.free[free_count] = polytope.visible[i]
            free_count += 1
        if used <= MAX_FULL_SCAN:
            count, ridges = find_visible(polytope, dim, used, point)
        else:
            stamp += 2
            count, ridges = flood_visible(polytope, dim, np.uint32(f), stamp, point)
        # One new facet per ridge; the facets visible now are reused from the next vertex on.
        if used + ridges > planes.shape[1] + free_count or size + ridges > queue.shape[0]:
            lower, status = min(lower, scale * plane[6]), EXHAUSTED
            break
        used, free_count = _add_facets(
            polytope, dim, ridges, used, free_count, vertices, metric, task, pinched
        )
        size, lower = _queue_facets(polytope, ridges, size, limit, lower, task)
        # nan compares as neither near nor visible, so removed facets need no separate test.
        for i in range(count):
            planes[6, polytope.visible[i]] = math.nan
            if task is not None:
                planes[8, polytope.visible[i]] = math.nan
        vertices += 1
    for i in range(size):
        distance = distance_of(planes, queue[i], task)
        if distance < lower:
            lower = distance
    if status == CONVERGED and lower <= 0.0:
        status = UNDECIDED
    return status, lower, upper, vertices, used
