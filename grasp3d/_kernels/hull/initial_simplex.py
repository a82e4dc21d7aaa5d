"""The first simplex of a growing hull, chosen to contain the origin."""

import math

from grasp3d._kernels.compiling.decorators import merged, part_for_constants
from grasp3d._kernels.forces.force_slice import farthest_point
from grasp3d._kernels.hull.polytope import TOLERANCE, set_normalised_plane
from grasp3d._kernels.surface.vectors import dot6, remove_components

AROUND_ORIGIN, AT_ORIGIN = 0, 1
"""Where the first simplex is: about the origin if possible; or with the origin as a vertex."""

COMPLETE = -1
"""Result of `first_simplex`: the simplex is complete."""

ORIGIN_TOLERANCE = 1e3
"""Distance, in tolerances, up to which an affine hull counts as containing the origin."""


@merged
def _write_orthogonal_direction(basis, size, dim, components, u):
    """Write a direction orthogonal to the basis, from the unit vector least in its span."""
    largest, axis = -1.0, 0
    for c in range(dim):
        remaining = 1.0
        for j in range(size):
            remaining -= basis[j, c] * basis[j, c]
        if remaining > largest:
            largest, axis = remaining, c
    for k in range(6):
        u[k] = 0.0
    u[axis] = 1.0
    for _ in range(2):
        remove_components(basis, size, u, components)


@merged
def _add_edge(basis, triangle, size, nearest, components):
    """Orthonormalise the newest edge of the simplex, and project the nearest point onto it.

    `nearest` is the point of the affine hull of the vertices so far that is nearest to the origin;
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
        for k in range(6):
            nearest[k] -= component * e[k]


@merged
def _set_facets(basis, triangle, dim, metric, task, polytope, g, x, total):
    """Write the planes and the neighbours of the simplex's facets.

    points - points[0] = triangle @ basis. The columns of the inverse are the gradients of the
    barycentric coordinates; a facet's outward normal is opposite to the gradient of the coordinate
    of the vertex that it lacks.
    """
    points, planes = polytope.points, polytope.planes
    for k in range(6):
        total[k] = 0.0
    for j in range(dim):
        for k in range(6):
            g[k] = 0.0
        # Column j of the inverse of the triangular matrix, by forward substitution.
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
        set_normalised_plane(
            planes, j + 1, -g[0], -g[1], -g[2], -g[3], -g[4], -g[5], height, metric, task
        )
    # The barycentric coordinates sum to 1, so the gradient of the first is minus the others' sum.
    height = dot6(total, points[1])
    set_normalised_plane(
        planes, 0, total[0], total[1], total[2], total[3], total[4], total[5], height, metric, task
    )
    for i in range(dim + 1):
        polytope.marks[i] = 0
        for j in range(dim + 1):
            if i != j:
                position = j if j < i else j - 1
                polytope.corners[i, position] = j
                polytope.neighbours[i, position] = j


@merged
def _set_origin(polytope):
    """Make the origin, no force at any contact, the first vertex."""
    polytope.identifiers[0], polytope.owners[0] = -1, 0
    for k in range(6):
        polytope.points[0, k] = 0.0
    for k in range(6):
        polytope.vertex_forces[0, k] = 0.0


@part_for_constants
def first_simplex(space, dims, metric, task, start, polytope):
    """Choose affinely independent support wrenches whose simplex contains the origin if possible.

    As in Gilbert, Johnson & Keerthi 1988 each new point is the support in the direction from the
    nearest point of the affine hull so far to the origin. Where that hull contains the origin, the
    support in a direction orthogonal to it is taken, on the side that reaches farther.

    Args:
        space: `WrenchSpace`.
        dims: Sequence as long as the grasp's rank.
        metric: As in `grow`.
        task: As in `grow`.
        start: As in `grow`.
        polytope: `Polytope`; points, planes and neighbours are written.

    Returns:
        COMPLETE, or the row of `polytope.vectors` with a direction in which no wrench has a
        positive component.
    """
    dim = len(dims)
    points, vectors, vertex_forces = polytope.points, polytope.vectors, polytope.vertex_forces
    basis, triangle = vectors[0:6], vectors[6:12]
    u, nearest, components, total = vectors[12], vectors[13], vectors[14], vectors[15]
    radius = ORIGIN_TOLERANCE * TOLERANCE
    for k in range(6):
        nearest[k] = 0.0
    pointed = start == AT_ORIGIN
    if pointed:
        _set_origin(polytope)
    for size in range(1 if pointed else 0, dim + 1):
        point = points[size]
        both_ways = False
        if dot6(nearest, nearest) > radius * radius:
            for k in range(6):
                u[k] = -nearest[k]
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
            for k in range(6):
                u[k] = -u[k]
            other, other_force = points[size + 1], vertex_forces[size + 1]
            opposite, other_identifier, other_owner = farthest_point(space, u, other, other_force)
            if opposite <= tolerance and not (pointed and height > tolerance):
                return 12
            if opposite > height:
                identifier, owner = other_identifier, other_owner
                for k in range(6):
                    point[k] = other[k]
                for k in range(6):
                    vertex_forces[size, k] = other_force[k]
        polytope.identifiers[size], polytope.owners[size] = identifier, owner
        if size == 0:
            for k in range(6):
                nearest[k] = point[k]
        else:
            for k in range(6):
                basis[size - 1, k] = point[k] - points[0, k]
            _add_edge(basis, triangle, size - 1, nearest, components)
    _set_facets(basis, triangle, dim, metric, task, polytope, nearest, u, total)
    return COMPLETE
