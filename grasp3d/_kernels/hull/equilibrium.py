"""Equilibria: balanced contact forces computed from a polytope that contains the origin."""

import math

from grasp3d._kernels.compiling import merged, part
from grasp3d._kernels.hull.support_functions import ROWS
from grasp3d._kernels.surface.vectors import add6, clear6

PASSES = 3
"""How often the residual is balanced: later times what ties and rounding left of it."""

TIE = 1e-9
"""Relative rounding error in deciding which facet a ray intersects, and of its weights."""


@part
def solve(matrix, x, dim):
    """Solve matrix @ x = column 6 of `matrix` by elimination; 0 for singular pivots."""
    for c in range(dim):
        pivot = c
        for r in range(c + 1, dim):
            if abs(matrix[r, c]) > abs(matrix[pivot, c]):
                pivot = r
        for k in range(8):
            matrix[c, k], matrix[pivot, k] = matrix[pivot, k], matrix[c, k]
        if abs(matrix[c, c]) < 1e-200:
            continue
        for r in range(c + 1, dim):
            factor = matrix[r, c] / matrix[c, c]
            for k in range(c, 8):
                matrix[r, k] -= factor * matrix[c, k]
    for c in range(dim - 1, -1, -1):
        value = matrix[c, 6]
        for k in range(c + 1, dim):
            value -= matrix[c, k] * x[k]
        x[c] = value / matrix[c, c] if abs(matrix[c, c]) >= 1e-200 else 0.0


@merged
def _normal_component(planes, f, x):
    return (
        (planes[0, f] * x[0] + planes[1, f] * x[1]) + (planes[2, f] * x[2] + planes[3, f] * x[3])
    ) + (planes[4, f] * x[4] + planes[5, f] * x[5])


@part
def _balance_residual(dim, polytope, used, residual, matrix, x, forces):
    """Add what balances a wrench, the residual, to forces: the vertices of one facet."""
    points, planes, corners = polytope.points, polytope.planes, polytope.corners
    # The polytope contains the origin, so the ray along the residual leaves it through a facet.
    distances, nearest = polytope.heights, math.inf
    for f in range(used):
        component = _normal_component(planes, f, residual)
        distances[f] = planes[6, f] / component if component > 0.0 else math.inf
    for f in range(used):
        nearest = min(nearest, distances[f]) if distances[f] >= 0.0 else nearest
    nearest *= 1.0 + TIE
    best, chosen, weights = -math.inf, -1, polytope.vectors[13]
    for f in range(used):
        if not distances[f] <= nearest:
            continue
        # Coplanar facets are hit at the same distance: the ray intersects the one whose vertices
        # combine to it with non-negative weights.
        for k in range(dim):
            for c in range(dim):
                matrix[k, c] = points[corners[f, c], k]
            matrix[k, 6] = residual[k]
        solve(matrix, x, dim)
        most, least = 0.0, 0.0
        for c in range(dim):
            most, least = max(most, x[c]), min(least, x[c])
        if least > best * most:
            best, chosen = least / most, f
            for c in range(dim):
                weights[c] = max(x[c], 0.0)
        if best >= -TIE:
            break
    for c in range(dim if chosen >= 0 else 0):
        vertex = corners[chosen, c]
        for k in range(4):
            forces[polytope.owners[vertex], k] += weights[c] * polytope.vertex_forces[vertex, k]
        add6(residual, -weights[c], points[vertex])


@part
def equilibrium(space, dims, polytope, vertices, used, forces):
    """Write balanced contact forces, all strictly inside their friction cones.

    All vertices of the polytope and every contact's unit normal force, or every row, sum up to a
    wrench. The facet that the ray along the opposite wrench intersects balances it, by a
    non-negative combination of the facet's vertices.

    Args:
        space: `WrenchSpace`, not PER_FINGER.
        dims: Sequence as long as the rank.
        polytope: The `Polytope` of a force-closed grasp, as `grow` left it.
        vertices: Its number of vertices.
        used: Its number of facets.
        forces: Written, each contact's force in its axes, or each row's weight in the first column
            (n, 4).
    """
    dim = len(dims)
    points, vectors = polytope.points, polytope.vectors
    residual, matrix, x = vectors[15], vectors[0:6], vectors[14]
    count = forces.shape[0]
    clear6(residual)
    for i in range(count):
        for k in range(4):
            forces[i, k] = 0.0
        forces[i, 0] = 1.0
        if space.kind != ROWS:
            add6(residual, -1.0, space.axes[i, 0])
        else:
            for k in range(dim):
                residual[k] -= space.axes[0, k, i]
    # With weight 1 for every vertex, each contact's force is a sum of several vectors of its cone,
    # together with its normal: hence non-zero and strictly inside.
    for i in range(vertices):
        for k in range(4):
            forces[polytope.owners[i], k] += polytope.vertex_forces[i, k]
        add6(residual, -1.0, points[i])
    for _ in range(PASSES):
        _balance_residual(dim, polytope, used, residual, matrix, x, forces)
