"""Equilibria: forces that balance, read off a polytope that holds the origin."""

import math

from grasp3d._kernels.compiling import merged, scratch_kernel
from grasp3d._kernels.support_functions import ROWS

BALANCED = 1e-9
"""What may be left of a balance, in units of the wrenches' own size."""


TIED = 1e-9
"""Share by which facets that a ray runs through, or a weight of one, may seem to miss it."""


@scratch_kernel
def _solve(matrix, x, dim):
    """Solve matrix @ x = row 6 of `matrix`, by elimination; a singular one gives what it can."""
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
def _along(planes, f, x):
    return (
        (planes[0, f] * x[0] + planes[1, f] * x[1]) + (planes[2, f] * x[2] + planes[3, f] * x[3])
    ) + (planes[4, f] * x[4] + planes[5, f] * x[5])


@scratch_kernel
def equilibrium(body, dims, polytope, vertices, used, forces):
    """Write forces that balance, all different from zero and strictly inside their cones.

    The vertices of the polytope and every contact's normal force add up to a wrench; the facet that
    its opposite points through adds what is missing.

    Args:
        body: `Body`, not PER_FINGER.
        dims: As long as the rank.
        polytope: The `Polytope` that `grow` left, closed.
        vertices: Vertices in it.
        used: Facets in it.
        forces: Written, each contact's force in its axes (n, 4), or each row's weight (n, 4), first
            column; they add up to 1.

    Returns:
        Whether they balance to BALANCED.
    """
    dim = len(dims)
    points, planes, corners, vectors = (
        polytope.points,
        polytope.planes,
        polytope.corners,
        polytope.vectors,
    )
    rest, matrix, x = vectors[15], vectors[0:6], vectors[14]
    many = forces.shape[0]
    for k in range(6):
        rest[k] = 0.0
    for i in range(many):
        for k in range(4):
            forces[i, k] = 0.0
        if body.kind != ROWS:
            forces[i, 0] = 1.0
            for k in range(6):
                rest[k] -= body.axes[i, 0, k]
    for i in range(vertices):
        for k in range(4):
            forces[polytope.owners[i], k] += polytope.mixes[i, k]
        for k in range(6):
            rest[k] -= points[i, k]
    ways, nearest = polytope.heights, math.inf
    for f in range(used):
        along = _along(planes, f, rest)
        ways[f] = planes[6, f] / along if along > 0.0 else math.inf
    for f in range(used):
        nearest = min(nearest, ways[f]) if ways[f] >= 0.0 else nearest
    nearest *= 1.0 + TIED
    for f in range(used):
        if not ways[f] <= nearest:
            continue
        # Facets in one plane are hit alike; the ray runs through the one that it is a sum of.
        for k in range(dim):
            for c in range(dim):
                matrix[k, c] = points[corners[f, c], k]
            matrix[k, 6] = rest[k]
        _solve(matrix, x, dim)
        most, least = 0.0, 0.0
        for c in range(dim):
            most, least = max(most, x[c]), min(least, x[c])
        if least < -TIED * most:
            continue
        for c in range(dim):
            vertex = corners[f, c]
            share = max(x[c], 0.0)
            for k in range(4):
                forces[polytope.owners[vertex], k] += share * polytope.mixes[vertex, k]
            for k in range(6):
                rest[k] -= share * points[vertex, k]
        break
    total = 0.0
    for i in range(many):
        total += math.sqrt(
            forces[i, 0] * forces[i, 0] + forces[i, 1] * forces[i, 1] + forces[i, 2] * forces[i, 2]
        )
    for i in range(many):
        for k in range(4):
            forces[i, k] /= total
    left = 0.0
    for k in range(dim):
        left = max(left, abs(rest[k]))
    return left <= BALANCED * total
