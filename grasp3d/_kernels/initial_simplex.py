"""The first simplex of a growing hull, laid around the origin."""

import math

from grasp3d._kernels.compiling import merged, scratch_kernel
from grasp3d._kernels.polytope import TOLERANCE, set_plane
from grasp3d._kernels.support_functions import support
from grasp3d._kernels.vectors import dot6, leave

STANDS = -1
"""The simplex has its facets."""

HOLDS_ORIGIN = 1e3
"""Distance to the origin, in tolerances, within which a flat is taken to hold it."""


@merged
def _leave_flat(basis, size, dim, parts, u):
    """Write a direction across a flat: from the coordinate that it holds least of."""
    most, axis = -1.0, 0
    for c in range(dim):
        left = 1.0
        for j in range(size):
            left -= basis[j, c] * basis[j, c]
        if left > most:
            most, axis = left, c
    for k in range(6):
        u[k] = 0.0
    u[axis] = 1.0
    for _ in range(2):
        leave(basis, size, u, parts)


@merged
def _add_edge(basis, triangle, size, near, parts):
    """Make the newest edge a unit row of the basis and move the flat's nearest point along it."""
    e, row = basis[size], triangle[size]
    before = dot6(e, e)
    leave(basis, size, e, row)
    square = dot6(e, e)
    if square < 0.25 * before:  # much was taken out: what is left needs a second look
        leave(basis, size, e, parts)
        for j in range(size):
            row[j] += parts[j]
        square = dot6(e, e)
    row[size] = math.sqrt(square)
    for k in range(6):
        e[k] /= row[size]
    for _ in range(2):
        part = dot6(near, e)
        for k in range(6):
            near[k] -= part * e[k]


@merged
def _set_facets(basis, triangle, dim, metric, polytope, g, x, total):
    """Write the planes and the neighbours of the simplex's facets.

    points - points[0] = triangle @ basis. The columns of its inverse are the gradients of the
    barycentric coordinates, and the facet without a vertex looks down that vertex's gradient.
    """
    points, planes = polytope.points, polytope.planes
    for k in range(6):
        total[k] = 0.0
    for j in range(dim):
        for k in range(6):
            g[k] = 0.0
        for i in range(j, dim):
            value = 1.0 if i == j else 0.0
            for k in range(j, i):
                value -= triangle[i, k] * x[k]
            x[i] = value / triangle[i, i]
            for k in range(6):
                g[k] += x[i] * basis[i, k]
        for k in range(6):
            total[k] += g[k]
        height = -dot6(g, points[0])
        set_plane(planes, j + 1, -g[0], -g[1], -g[2], -g[3], -g[4], -g[5], height, metric)
    height = dot6(total, points[1])
    set_plane(planes, 0, total[0], total[1], total[2], total[3], total[4], total[5], height, metric)
    for i in range(dim + 1):
        polytope.marks[i] = 0
        for j in range(dim + 1):
            if i != j:
                place = j if j < i else j - 1
                polytope.corners[i, place] = j
                polytope.across[i, place] = 8 * j + (i if i < j else i - 1)


@scratch_kernel
def first_simplex(body, dims, metric, polytope):
    """Take support points from where the ones before leave the origin out.

    Gilbert, Johnson & Keerthi 1988 go on likewise, from the point nearest to the origin.

    Args:
        body: `Body`.
        dims: As long as the grasp's rank.
        metric: As in `grow`.
        polytope: `Polytope`; points, planes and neighbours are written.

    Returns:
        STANDS, or the row of `polytope.vectors` that holds a direction in which no wrench lies.
    """
    dim = len(dims)
    points, vectors, mixes = polytope.points, polytope.vectors, polytope.mixes
    basis, triangle = vectors[0:6], vectors[6:12]
    u, near, parts, total = vectors[12], vectors[13], vectors[14], vectors[15]
    reach = HOLDS_ORIGIN * TOLERANCE
    for k in range(6):
        near[k] = 0.0
    for size in range(dim + 1):
        point = points[size]
        both_ways = False
        if dot6(near, near) > reach * reach:
            for k in range(6):
                u[k] = -near[k]
        else:
            _leave_flat(basis, size - 1, dim, parts, u)
            both_ways = size > 0
        tolerance = 0.0
        for k in range(6):
            tolerance += TOLERANCE * abs(u[k])
        height, name, owner = support(body, u, point, mixes[size])
        if height <= tolerance:
            return 12
        if both_ways:
            for k in range(6):
                u[k] = -u[k]
            other, mix = points[size + 1], mixes[size + 1]
            opposite, other_name, other_owner = support(body, u, other, mix)
            if opposite <= tolerance:
                return 12
            if opposite > height:
                name, owner = other_name, other_owner
                for k in range(6):
                    point[k] = other[k]
                for k in range(4):
                    mixes[size, k] = mix[k]
        polytope.names[size], polytope.owners[size] = name, owner
        if size == 0:
            for k in range(6):
                near[k] = point[k]
        else:
            for k in range(6):
                basis[size - 1, k] = point[k] - points[0, k]
            _add_edge(basis, triangle, size - 1, near, parts)
    _set_facets(basis, triangle, dim, metric, polytope, near, u, total)
    return STANDS
