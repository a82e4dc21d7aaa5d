"""The forces that a grasp can apply at the centre of mass without any torque.

These forces form a three-dimensional slice of the grasp wrench space. A task of forces in all
directions at the centre of mass, such as weight, needs only this slice: a polytope in it has few
facets where one in six dimensions has thousands. `resist` finds the slice's boundary along rays and
proves a lower bound on the force that the task needs.

Equilibria: balanced contact forces computed from a polytope that contains the origin.

The force that resists one wrench: where a ray leaves the grasp wrench space.

With K the space of forces bounded by 1, the smallest bound t for which a wrench c lies in t K is
1 / s, where the ray along c leaves K at s c. That is a linear program over all points of K. A basis
of as many wrenches as the rank is kept: c is a non-negative combination of them with weights x, and
t <= the sum of x. The plane through them has the normal u. The support h(u) proves t >= u . c /
h(u), and its wrench replaces one of the basis (the simplex method with column generation). Taking
the support between u and the best direction so far saves a third of the steps, as is known from
cutting planes. The basis starts with short wrenches along the coordinates, which K may lack: if
some of them remain, K does not reach c, or only with a large force.
"""

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from numba.core import types
from numba.extending import overload

from grasp3d._kernels.compiling import merged, part, scratch_kernel
from grasp3d._kernels.hull.support_functions import (
    ROWS,
    SIX,
    TaskInSpan,
    WrenchSpace,
    contact_forces,
    farthest,
    support,
    task_reach,
)
from grasp3d._kernels.surface.vectors import add6, clear6, copy6, dot6

PASSES = 3
"""How often the residual is balanced; later passes remove what ties and rounding leave."""

TIE = 1e-9
"""Relative rounding error in the choice of the facet that a ray intersects, and of its weights."""


@part
def solve(matrix, x, dim):
    """Solve matrix @ x = column 6 of `matrix` by elimination; x is 0 at singular pivots."""
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
    """Add forces that balance a wrench, the residual: those of the vertices of one facet."""
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

    The sum of all vertices of the polytope and of every contact's unit normal force, or of every
    row, is a wrench. The ray along its opposite intersects a facet, and a non-negative combination
    of that facet's vertices balances the wrench.

    Args:
        space: `WrenchSpace`, not PER_FINGER.
        dims: Sequence as long as the rank.
        polytope: The `Polytope` of a force-closed grasp, as `grow` left it.
        vertices: Number of vertices of the polytope.
        used: Number of facets of the polytope.
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
    # With weight 1 for every vertex, each contact's force sums several vectors of its cone and its
    # normal, so it is non-zero and strictly inside.
    for i in range(vertices):
        for k in range(4):
            forces[polytope.owners[i], k] += polytope.vertex_forces[i, k]
        add6(residual, -1.0, points[i])
    for _ in range(PASSES):
        _balance_residual(dim, polytope, used, residual, matrix, x, forces)


RESISTED, UNREACHED, UNFINISHED = 0, 1, 2
"""How the search ended: with a force; without one; or out of steps."""

SHORT, SHORTEST = 1e-3, 1e-8
"""Longest and shortest wrenches tried for the first basis, in coordinates in which the space
reaches about 1; longer ones are replaced in fewer steps."""

STEPS = 500
"""Most steps of the search."""

TOWARD_BEST = 0.4
"""Fraction of the way from u to the best direction so far at which the support is evaluated."""

TOLERANCE = 1e-12
"""Relative size of rounding errors."""

LOOSE = 1e-3
"""Relative amount by which the forces may exceed the bound that the search found."""

LEFT = 1e-10
"""Weight, relative to the largest, up to which a first basis wrench is a rounding error."""


@merged
def _start(dims, goal, length, inverse, directions, x):
    """Write the first basis: its inverse (6, 6), zero directions (6, 8), and the weights."""
    dim = len(dims)
    for i in range(dim):
        for k in range(6):
            inverse[i, k] = 0.0
            directions[i, k] = 0.0
        inverse[i, i] = math.copysign(1.0 / length, goal[i])
        x[i] = abs(goal[i]) / length


@merged
def _leaving(dims, inverse, point, x, y):
    """Choose the basis vector to replace: the one whose weight vanishes first; write B^-1 p."""
    dim = len(dims)
    leaving, least = -1, math.inf
    for i in range(dim):
        y[i] = dot6(inverse[i], point)
        if y[i] > TOLERANCE and x[i] < least * y[i]:
            leaving, least = i, x[i] / y[i]
    return leaving, least


@merged
def _replace(dims, inverse, x, y, leaving, least, u):
    """Update the inverse of the basis, the weights, and the normal u; return the sum of weights."""
    dim = len(dims)
    factor = 1.0 / y[leaving]
    for k in range(6):
        inverse[leaving, k] *= factor
        u[k] = inverse[leaving, k]
    total = least
    for i in range(dim):
        if i != leaving:
            for k in range(6):
                inverse[i, k] -= y[i] * inverse[leaving, k]
                u[k] += inverse[i, k]
            x[i] = max(x[i] - least * y[i], 0.0)
            total += x[i]
    x[leaving] = least
    return total


@merged
def _search(space, dims, goal, rtol, length, vectors):
    """Replace basis vectors until the bounds meet; return (status, lower, upper)."""
    dim = len(dims)
    inverse, directions, columns, best = vectors[0:6], vectors[6:12], vectors[20:26], vectors[16]
    x, y, u, point, query = vectors[12], vectors[13], vectors[14], vectors[15], vectors[18]
    _start(dims, goal, length, inverse, directions, x)
    lower, upper, status = 0.0, 0.0, UNFINISHED
    square = dot6(goal, goal)
    for i in range(dim):
        upper += x[i]
    for k in range(6):
        u[k] = inverse[k, k] if k < dim else 0.0
        query[k] = goal[k] * upper / square
    between = True
    for _ in range(STEPS):
        height, _, _ = farthest(space, query, point, y)
        # Both query . goal and u . goal equal the upper bound; hence their mixtures do, too.
        if height > 0.0 and upper > lower * height:
            lower = upper / height
            copy6(query, best)
        if upper - lower <= rtol * upper:
            status = RESISTED
            break
        if dot6(u, point) > 1.0 + TOLERANCE:
            leaving, least = _leaving(dims, inverse, point, x, y)
            if leaving < 0:
                break
            copy6(query, directions[leaving])
            copy6(point, columns[leaving])
            upper = _replace(dims, inverse, x, y, leaving, least, u)
            between = lower > 0.0
        elif not between:
            status = RESISTED
            break
        else:
            between = False
        if between:
            factor = TOWARD_BEST * upper / dot6(best, goal)
            for k in range(6):
                query[k] = (1.0 - TOWARD_BEST) * u[k] + factor * best[k]
        else:
            copy6(u, query)
    return status, min(lower, upper), upper


@part
def resist(space, dims, goal, rtol, vectors, forces):
    """Find the smallest bound on contact forces that can apply a wrench.

    Args:
        space: `WrenchSpace`.
        dims: Sequence as long as the grasp's rank.
        goal: The wrench that the contacts must apply, not 0, in the space's coordinates (6,).
        rtol: Largest gap between the bounds, relative to the upper one.
        vectors: Scratch (>= 26, 8). The direction that proves the lower bound is written to row 16.
        forces: Written, contact forces of that wrench in the contacts' axes (n, 4). If n is 0, as
            for ROWS, they are not computed.

    Returns:
        (status, lower, upper): bounds if RESISTED; otherwise they may be invalid.
    """
    status, lower, upper = UNFINISHED, 0.0, 0.0
    length = SHORT
    while length >= SHORTEST:
        status, lower, upper = _search(space, dims, goal, rtol, length, vectors)
        if status == RESISTED:
            found = upper
            status, upper = _combine(space, len(dims), goal, vectors, forces)
            if upper > found * (1.0 + LOOSE):  # a wrench of the first basis replaces others
                status = UNREACHED
        if status != UNREACHED:
            break
        length *= SHORT * 0.01
    return status, min(lower, upper), upper


@part
def _combine(space, dim, goal, vectors, forces):
    """Combine the wrenches of the basis, and their forces, with newly solved weights.

    The weights updated in each step have accumulated the rounding errors of all steps.

    Returns:
        (status, upper): UNREACHED if a wrench of the first basis is left.
    """
    matrix, directions, columns, x = vectors[0:6], vectors[6:12], vectors[20:26], vectors[12]
    for i in range(forces.shape[0]):
        for k in range(forces.shape[1]):
            forces[i, k] = 0.0
    for j in range(dim):
        is_applied = dot6(directions[j], directions[j]) > 0.0
        for k in range(dim):
            unit = 1.0 if k == j else 0.0
            matrix[k, j] = columns[j, k] if is_applied else unit
    for k in range(dim):
        matrix[k, 6] = goal[k]
    solve(matrix, x, dim)
    upper = size = 0.0
    for j in range(dim):
        size = max(size, x[j])
    for j in range(dim):
        if dot6(directions[j], directions[j]) == 0.0:
            if abs(x[j]) > LEFT * size:
                return UNREACHED, math.inf
        elif x[j] > 0.0:
            upper += x[j]
            if forces.shape[0] > 0:
                contact_forces(space, directions[j], x[j], vectors[13], forces)
    return RESISTED, upper


@scratch_kernel("Floats3, Floats2, Ints1, Ints1, float, Floats2, Floats2, Floats1")
def least_multiples(rows, goals, ranks, dims, rtol, vectors, empty, multiples):
    """Find, for each grasp, the least multiple of the convex hull of rows that contains a wrench.

    Args:
        rows: Wrenches in columns, zeros beyond the rank (b, 6, n).
        goals: The wrenches (b, 6).
        ranks: Dimension of the span of the rows (b,).
        dims: Zeros (6,).
        rtol: As in `resist`.
        vectors: As in `resist`.
        empty: No rows of two numbers (0, 2).
        multiples: Written; nan if none is found (b,).
    """
    for g in range(rows.shape[0]):
        if dot6(goals[g], goals[g]) == 0.0:
            multiples[g] = 0.0
            continue
        spherical, soft = True, False
        space = WrenchSpace(ROWS, spherical, soft, rows[g : g + 1], empty, 1)
        status, _, upper = resist(space, dims[: ranks[g]], goals[g], rtol, vectors, empty)
        multiples[g] = upper if status == RESISTED else math.nan


class ForceSlice(NamedTuple):
    """The slice of one grasp of rank 6; coordinates are forces."""

    space: WrenchSpace
    task: TaskInSpan
    """The task in the balanced coordinates of the whole space."""
    goals: npt.NDArray[np.float64]
    """The wrenches of unit forces, in those coordinates (3, 6)."""
    size: float
    """Size of the task's forces."""
    rtol: float
    """Largest gap between the bounds of `resist`."""
    vectors: npt.NDArray[np.float64]
    """Scratch of `resist`."""
    best: npt.NDArray[np.float64]
    """Written: the direction, in balanced coordinates, with the smallest ratio so far of support to
    the task's reach, and that ratio (7,)."""


@part
def _boundary(slice_, u, point):
    """Find where the ray along u leaves the slice; see `farthest_point`."""
    goal, best = slice_.vectors[17], slice_.best
    length = math.sqrt((u[0] * u[0] + u[1] * u[1]) + u[2] * u[2])
    for k in range(6):
        goal[k] = (
            u[0] * slice_.goals[0, k] + u[1] * slice_.goals[1, k] + u[2] * slice_.goals[2, k]
        ) / length
        point[k] = 0.0
    vectors = slice_.vectors
    status, lower, upper = resist(slice_.space, SIX, goal, slice_.rtol, vectors, vectors[:0])
    if status != RESISTED:
        return 0.0, -1, 0
    for k in range(3):
        point[k] = u[k] / (length * upper)
    # The direction v that proves the bound along this ray may prove a larger one along another.
    v = slice_.vectors[16]
    support_there = dot6(v, goal) / lower
    ratio = support_there / task_reach(slice_.task, v)
    if ratio < best[6]:
        copy6(v, best)
        best[6] = ratio
    return ratio * length * slice_.size, -1, 0


def farthest_point(space, u, point, force):
    """Farthest wrench of a `WrenchSpace` in a direction, or boundary point of a `ForceSlice`.

    Arguments are those of `support`. The height of a boundary point is that at which the task
    provably needs the force, at least the point's own; 0 if no force reaches that way.
    """
    if isinstance(space, ForceSlice):
        return _boundary(space, u, point)
    return support(space, u, point, force)


@overload(farthest_point, inline="always")
def _farthest_point(space, u, point, force):  # noqa: ARG001 - Numba matches the names
    if isinstance(space, types.NamedTuple) and space.instance_class is ForceSlice:

        def implementation(space, u, point, force):  # noqa: ARG001 - as above
            return _boundary(space, u, point)

    else:

        def implementation(space, u, point, force):
            return support(space, u, point, force)

    return implementation
