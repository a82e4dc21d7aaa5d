"""Batches of grasps: from the contacts' wrenches to epsilon, force closure and critical angles.

A grasp is *closed* if its hull contains a ball about the origin, of `CLOSED` times the largest
wrench, that rounding errors cannot have moved there. It is *open* if the hull finds a direction in
which no wrench reaches farther than rounding errors do. Anything between is undecided.

The critical friction angle is bracketed by the same tests: closed at one end, open at the other.
"""

import math
from typing import NamedTuple

import numpy as np
from numba.core import types
from numba.extending import overload

from grasp3d._kernels.compiling import (
    Bools1,
    Bytes1,
    Floats1,
    Floats2,
    Floats3,
    Ints1,
    merged,
    part,
    scratch_kernel,
)
from grasp3d._kernels.hull.growing_hull import AROUND_ORIGIN, CONVERGED, EXHAUSTED, UNDECIDED, grow
from grasp3d._kernels.hull.polytope import TOLERANCE
from grasp3d._kernels.hull.support_functions import PER_FINGER, ROWS, WrenchSpace
from grasp3d._kernels.hull.wrench_resistance import equilibrium
from grasp3d._kernels.hull.wrenches import span
from grasp3d._kernels.surface.vectors import copy6, dot6

CLOSED = 1e-8
"""Radius of the ball about the origin that proves force closure, relative to the largest wrench."""

CLOSER = 1e-9
"""Angle [rad] by which all friction cones of a closed grasp may shrink: its forces change by less
than `CLOSED`."""

BALL_RTOL = 1e-3
"""Relative gap between the bounds where a hull must contain a larger ball."""

SIGN = (0.0, 1e-12, CLOSED)
"""Goal of a closure test: (rtol, atol, cutoff) as for `grow`, the latter two relative to the
largest wrench."""

OTHER_RANK = 5
"""Status used only in the kernels: the rank is 1 to 5 and below the least one wanted."""


class Workspace(NamedTuple):
    """Scratch arrays for one grasp in the coordinates of its span; n contacts or rows."""

    rows: Floats2
    """Wrenches that span those of the grasp (4 n, 6); or the n rows (n, 6)."""
    scratch: Floats2
    """Scratch of the same shape."""
    basis: Floats2
    """Basis of the span (6, 6)."""
    axes: Floats3
    """As in `WrenchSpace`."""
    extents: Floats1
    """Largest component of the wrenches along each row of the basis (6,)."""
    metric: Floats1
    """As in `grow` (6,)."""
    dims: Ints1
    """Array whose first `rank` entries are passed as `dims` to `grow` (6,)."""


class Results(NamedTuple):
    """Results for each grasp (b, ...); written."""

    lower: Floats1
    upper: Floats1
    rank: Ints1
    status: Bytes1
    closed: Bools1
    direction: Floats2
    """Direction of `upper`, or one that separates: no wrench has a positive component (b, 6)."""
    forces: Floats3
    """Equilibrium forces of a hull (not of a sum) in the contacts' axes (b, n, 4), nan if there are
    none; (0, n, 4) if not requested."""


class Bracket(NamedTuple):
    """Intervals that contain the critical friction angles of grasps (b, ...), to be narrowed.

    With empty arrays each grasp is evaluated once, with its own cones.
    """

    low: Floats1
    """Least angle to test; written, an angle up to which the grasp is certainly open [rad]
    (b,)."""
    high: Floats1
    """Angle from which the grasp is closed; written [rad] (b,)."""
    first: Floats1
    """Angle to test first [rad] (b,)."""
    width: Floats1
    """Width to which the intervals are narrowed [rad] (b,)."""
    wider: Floats2
    """Half-angles of the cones minus the friction angle [rad] (b, n)."""
    radius: Floats1
    """Radius of the ball that the hull of a closed grasp must contain; if positive, the hull must
    also have all six dimensions (b,)."""


def make_workspace(kind: int, count: int) -> Workspace:
    """Allocate a workspace for `count` contacts, or rows."""
    rows = count if kind == ROWS else 4 * count
    return Workspace(
        rows=np.zeros((rows, 6)),
        scratch=np.zeros((rows, 6)),
        basis=np.zeros((6, 6)),
        axes=np.zeros((1, 6, count) if kind == ROWS else (count, 4, 6)),
        extents=np.zeros(6),
        metric=np.zeros(6),
        dims=np.zeros(6, dtype=np.int64),
    )


@merged
def _load_contacts(axes, tangential, soft, workspace):
    """Copy the axes (n, 4, 6) of contacts, the tangential ones scaled by friction (n,)."""
    rows = workspace.rows
    for i in range(axes.shape[0]):
        for j in range(4):
            factor = 1.0
            # Without friction, or without torsion, the axis is not part of the span.
            if 1 <= j <= 2:
                factor = tangential[i]
            elif j == 3 and not soft:
                factor = 0.0
            for k in range(6):
                rows[4 * i + j, k] = factor * axes[i, j, k]


@merged
def load(form, wrenches, tangential, workspace):
    """Write a grasp's wrenches, given as for `epsilons`, and their span; return its rank."""
    kind, soft = form[0], form[2]
    if kind == ROWS:
        for i in range(wrenches.shape[0]):
            copy6(wrenches[i, 0], workspace.rows[i])
    else:
        _load_contacts(wrenches, tangential, soft, workspace)
    return span(workspace.rows, workspace.scratch, workspace.basis)


@merged
def _coordinate(basis, is_unit_basis, k, wrench):
    """Coordinate of a wrench along a row of the basis, which may consist of the unit vectors."""
    if is_unit_basis:
        return wrench[k]
    value = 0.0
    for c in range(6):
        value += basis[k, c] * wrench[c]
    return value


@merged
def project(kind, fingers, source, workspace, rank):
    """Write the wrenches in coordinates of their span, each coordinate scaled to at most 1.

    Args:
        kind: As in `WrenchSpace`.
        fingers: Number of wrenches that are added up; 1 if the space is a single hull.
        source: Wrenches, as for `epsilons`.
        workspace: `Workspace`; written.
        rank: Rank of the wrenches.
    """
    basis, extents, metric = workspace.basis, workspace.extents, workspace.metric
    count = source.shape[0]
    is_unit_basis = True
    for k in range(6):
        extents[k] = 0.0
        is_unit_basis = is_unit_basis and basis[k, k] == 1.0
    for i in range(workspace.rows.shape[0]):
        for k in range(rank):
            extents[k] = max(
                extents[k], abs(_coordinate(basis, is_unit_basis, k, workspace.rows[i]))
            )
    for k in range(6):
        extents[k] *= fingers
        metric[k] = 1.0 / extents[k] if extents[k] > 0.0 else 0.0
    for i in range(count):
        for j in range(source.shape[1]):
            for k in range(6):
                value = metric[k] * _coordinate(basis, is_unit_basis, k, source[i, j])
                if kind == ROWS:
                    workspace.axes[0, k, i] = value
                else:
                    workspace.axes[i, j, k] = value
    # Turn scale factors of wrenches into weights of the squared components of directions.
    for k in range(6):
        metric[k] *= metric[k]


def _grow(space, dims, rank, metric, goal, polytope):
    """Grow the hull in the dimension of the span: that of a tuple, or the rank for an array."""
    dims = dims if isinstance(dims, tuple) else dims[:rank]
    return grow(space, dims, metric, None, AROUND_ORIGIN, goal, polytope)


@overload(_grow, inline="always")
def _grow_in(space, dims, rank, metric, goal, polytope):  # noqa: ARG001 - Numba matches the names
    if isinstance(dims, types.BaseTuple):

        def implementation(space, dims, rank, metric, goal, polytope):  # noqa: ARG001 - as above
            return grow(space, dims, metric, None, AROUND_ORIGIN, goal, polytope)

    else:

        def implementation(space, dims, rank, metric, goal, polytope):
            return grow(space, dims[:rank], metric, None, AROUND_ORIGIN, goal, polytope)

    return implementation


@merged
def write_direction(rank, workspace, vector, out):
    """Write a direction given in balanced coordinates as a unit vector in the wrench space."""
    # Directions are dual to wrenches: they are divided by the scale, not multiplied.
    square = 0.0
    for k in range(6):
        out[k] = 0.0
        for j in range(rank):
            out[k] += workspace.basis[j, k] * vector[j] / workspace.extents[j]
        square += out[k] * out[k]
    for k in range(6):
        out[k] /= math.sqrt(square)


@merged
def _largest_wrench(workspace):
    """Upper bound of the length of all wrenches."""
    square = 0.0
    for k in range(6):
        square += workspace.extents[k] * workspace.extents[k]
    return math.sqrt(square)


@merged
def erase_forces(results, g):
    """Mark a grasp's forces as missing."""
    for i in range(results.forces.shape[1]):
        for k in range(results.forces.shape[2]):
            results.forces[g, i, k] = math.nan


@merged
def _reset_result(results, g):
    """Write the initial results of a grasp: no force closure, no certificate."""
    results.lower[g] = results.upper[g] = 0.0
    results.rank[g], results.status[g], results.closed[g] = 0, 0, False
    for k in range(6):
        results.direction[g, k] = 1.0 if k == 0 else 0.0
    if len(results.forces):
        erase_forces(results, g)


@merged
def _narrowest(cones):
    """(least normal, least tangential) component of forces on the rims of the cones."""
    normal = tangential = math.inf
    for i in range(cones.shape[0]):
        normal, tangential = min(normal, cones[i, 0]), min(tangential, cones[i, 1])
    return normal, tangential


@merged
def _set_cones(angle, wider, cones):
    """Write cones whose half-angles exceed a friction angle by `wider`."""
    for i in range(cones.shape[0]):
        half = max(angle + wider[i], 0.0)
        cones[i, 0], cones[i, 1] = math.cos(half), math.sin(half)


@part
def _separated_up_to(axes, wider, rank, u):
    """Friction angle up to which a direction separates a grasp of hard contacts [rad].

    Up to that angle the contacts' velocities are at least 90 degrees from the cones. Contacts whose
    velocities are rounding errors do not count.
    """
    least, still = math.inf, 0.0
    for k in range(rank):
        still += TOLERANCE * abs(u[k])
    for i in range(axes.shape[0]):
        along, one, other = dot6(axes[i, 0], u), dot6(axes[i, 1], u), dot6(axes[i, 2], u)
        across = math.sqrt(one * one + other * other)
        if max(abs(along), across) > still:
            least = min(least, math.atan2(across, along) - 0.5 * math.pi - wider[i])
    return least


@scratch_kernel(
    "tuple[int, bool, bool, int], Floats4, Floats2, Floats3, tuple[float, float, float], int, int, "
    "tuple[int, int, int, int, int, int] | Ints1, Bracket, Workspace, Polytope, Results"
)
def epsilons(
    form, wrenches, tangential, cones, goal, first, least_rank, dims, bracket, workspace, polytope,
    results,
):  # fmt: skip
    """Epsilon, force closure and certificates of many grasps, or their critical angles.

    Args:
        form: (kind, spherical, soft, group) of `WrenchSpace`.
        wrenches: Axes of contacts (b, n, 4, 6), or rows (b, n, 1, 6).
        tangential: Factor of the tangential axes for the span: 0 without friction (b, n).
        cones: As in `WrenchSpace` (b, n, 2). With a negative tangential part, from a tilt that
            exceeds friction, nothing is decided.
        goal: As in `grow`, with atol and cutoff relative to the largest wrench. If rtol is 0, both
            bounds agree up to rounding once the hull has converged.
        first: Index of the first grasp to compute.
        least_rank: 6, or 1. Grasps of lower rank are left out.
        dims: `SIX` if the least rank is 6, so that loops have known lengths; otherwise the
            workspace's array, with which grasps of rank 6 take up to an eighth longer.
        bracket: `Bracket`; where it is not empty the goal is SIGN, and the cones are written.
        workspace: `Workspace`.
        polytope: `Polytope`.
        results: `Results`.

    Returns:
        The first grasp for which the polytope was too small (its bounds are valid) or that has the
        status OTHER_RANK; b if there is none.
    """
    kind, spherical, soft, group = form
    fingers = 1
    if kind == PER_FINGER or (kind == ROWS and group > 1):
        fingers = wrenches.shape[1] // group
    rtol, atol, cutoff = goal
    searching = bracket.low.shape[0] > 0
    for g in range(first, wrenches.shape[0]):
        _reset_result(results, g)
        rank = load(form, wrenches[g], tangential[g], workspace)
        results.rank[g] = rank
        normal, side = _narrowest(cones[g])
        if rank == 0 or side < 0.0:
            results.status[g] = 0 if rank == 0 else UNDECIDED
            continue
        if rank < least_rank:
            results.status[g] = OTHER_RANK
            return g
        project(kind, fingers, wrenches[g], workspace, rank)
        space = WrenchSpace(kind, spherical, soft, workspace.axes, cones[g], group)
        size = _largest_wrench(workspace)
        least = CLOSED * size
        angle = begin = low = high = not_closed = not_open = 0.0
        gap = rtol
        if searching:
            angle, begin, high = bracket.first[g], bracket.low[g], bracket.high[g]
            low = begin - bracket.width[g]  # so that the least angle is tested if that decides
            not_closed, not_open = low, high
            if bracket.radius[g] > 0.0:
                least = max(least, bracket.radius[g]) if rank == 6 else math.inf
                gap = BALL_RTOL
        while True:
            if searching:
                _set_cones(angle, bracket.wider[g], cones[g])
            own_goal = gap, atol * size, max(cutoff * size, least)
            status, lower, upper, vertices, used = _grow(
                space, dims, rank, workspace.metric, own_goal, polytope
            )
            is_open = used == 0
            closed = not is_open and least < lower < math.inf
            if not searching or (status == EXHAUSTED and not closed):
                break
            # Any direction separates the grasp up to some angle.
            proven = _separated_up_to(workspace.axes, bracket.wider[g], rank, polytope.vectors[16])
            if closed:
                high = max(angle - CLOSER, 0.0)
                not_open = min(not_open, high)
            elif is_open:
                proven = max(proven, angle)
                if not_open <= angle:  # what was undecided at a smaller angle is also open
                    not_open = high
            else:  # from now on closure and separation are sought on either side
                not_closed, not_open = max(not_closed, angle), min(not_open, angle)
            low = max(low, min(proven, not_open))
            not_closed = max(not_closed, low)
            if high - not_closed > bracket.width[g]:
                angle = max(0.5 * (not_closed + high), begin)
            elif not_open > max(low + bracket.width[g], begin):
                angle = max(0.5 * (low + not_open), begin)
            else:
                break
        results.closed[g] = closed
        results.upper[g] = upper if upper < math.inf else size
        exact = rtol == 0.0 and status == CONVERGED
        results.lower[g] = min(results.upper[g], math.inf if exact else lower) if closed else 0.0
        undecided = not closed and not is_open and status != EXHAUSTED
        results.status[g] = UNDECIDED if undecided else status
        if upper < math.inf or is_open:
            write_direction(rank, workspace, polytope.vectors[16], results.direction[g])
        if status == EXHAUSTED and not (searching and closed):
            return g
        if searching:
            bracket.low[g], bracket.high[g] = low, high
        # Cones of 90 degrees or more are not convex: sums of forces inside may lie outside.
        elif closed and len(results.forces) and (kind == ROWS or normal > 0.0):
            equilibrium(space, workspace.dims[:rank], polytope, vertices, used, results.forces[g])
    return wrenches.shape[0]
