"""Batches of grasps: from the contacts' wrenches to epsilon, force closure and certificates."""

import math
from typing import NamedTuple

import numpy as np
from numba.core import types
from numba.extending import overload

from grasp3d._kernels.array_types import Bools1, Bytes1, Floats1, Floats2, Floats3, Ints1
from grasp3d._kernels.compiling import merged, scratch_kernel
from grasp3d._kernels.hull.certificates import (
    LARGEST_SLACK,
    SMALL_SLACK,
    STATIONARY,
    UNPROVEN,
    balance,
    clear_slack,
    separation,
)
from grasp3d._kernels.hull.critical_angle import narrow
from grasp3d._kernels.hull.equilibrium import equilibrium
from grasp3d._kernels.hull.growing_hull import (
    AROUND_ORIGIN,
    CONVERGED,
    EXHAUSTED,
    STALLED,
    UNDECIDED,
    grow,
)
from grasp3d._kernels.hull.support_functions import NO_TORSION, PER_FINGER, ROWS, TOTAL, WrenchSpace
from grasp3d._kernels.hull.wrenches import span
from grasp3d._kernels.surface.vectors import copy6

SIGN = (0.0, 1e4, 0.0, 1.0)
"""Goal of a closure test; see `grow`."""

CLEAR = 1e-8
"""Epsilon relative to the largest wrench from which the hull itself proves force closure. Rounding
errors of less than that may have moved the origin into it."""

NEAR_DEGENERATE = 4
"""Status, in the kernels only: not force-closed if contacts that are close together coincide."""

OTHER_RANK = 5
"""Status, in the kernels only: the grasp has a rank from 1 to 5, below the least one wanted."""


class Workspace(NamedTuple):
    """Scratch arrays for one grasp in the coordinates of its span; n contacts or rows."""

    rows: Floats2
    """Wrenches with the span of the grasp (4 n, 6); or the n rows (n, 6)."""
    scratch: Floats2
    """Scratch of that shape."""
    basis: Floats2
    """Basis of the span (6, 6)."""
    axes: Floats3
    """As in `WrenchSpace`."""
    extents: Floats1
    """Largest component of the wrenches along each row of the basis (6,)."""
    metric: Floats1
    """As in `grow` (6,)."""
    dims: Ints1
    """Its first `rank` entries are passed as `dims` of `grow` (6,)."""


class Results(NamedTuple):
    """Results for each grasp (b, ...); written."""

    lower: Floats1
    upper: Floats1
    rank: Ints1
    status: Bytes1
    closed: Bools1
    direction: Floats2
    """Direction of `upper`, or a separating one: no wrench has a positive component (b, 6)."""
    forces: Floats3
    """Equilibrium forces, in the contacts' axes (b, n, 4); nan where there is none."""
    slack: Floats1
    """As returned by `balance`; 0 where the hull alone proves force closure (b,)."""


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
def _load_contacts(axes, tangential, torsion, workspace):
    """Copy the axes (n, 4, 6) of contacts, the tangential ones scaled by friction (n,)."""
    rows = workspace.rows
    for i in range(axes.shape[0]):
        for j in range(4):
            factor = 1.0
            # Without friction, or without torsion, the axis does not belong to the span.
            if 1 <= j <= 2:
                factor = tangential[i]
            elif j == 3 and torsion == NO_TORSION:
                factor = 0.0
            for k in range(6):
                rows[4 * i + j, k] = factor * axes[i, j, k]


@merged
def load(form, wrenches, tangential, tolerance, workspace):
    """Write the wrenches of a grasp, as `epsilons` takes them, and their span; returns its rank."""
    kind, torsion = form[0], form[2]
    if kind == ROWS:
        for i in range(wrenches.shape[0]):
            copy6(wrenches[i, 0], workspace.rows[i])
    else:
        _load_contacts(wrenches, tangential, torsion, workspace)
    return span(workspace.rows, tolerance, workspace.scratch, workspace.basis)


@merged
def _coordinate(basis, is_unit_basis, k, wrench):
    """Coordinate of a wrench along a row of the basis, which may be the unit vectors."""
    if is_unit_basis:
        return wrench[k]
    value = 0.0
    for c in range(6):
        value += basis[k, c] * wrench[c]
    return value


@merged
def project(kind, source, workspace, rank):
    """Write the wrenches in coordinates of their span, each coordinate scaled to at most 1."""
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
        if kind == PER_FINGER:  # a sum of `count` wrenches
            extents[k] *= count
        metric[k] = 1.0 / extents[k] if extents[k] > 0.0 else 0.0
    for i in range(count):
        for j in range(source.shape[1]):
            for k in range(6):
                value = metric[k] * _coordinate(basis, is_unit_basis, k, source[i, j])
                if kind == ROWS:
                    workspace.axes[0, k, i] = value
                else:
                    workspace.axes[i, j, k] = value
    # From scale factors of wrenches to weights of the squared components of directions.
    for k in range(6):
        metric[k] *= metric[k]


def _grow(space, dims, rank, metric, goal, polytope):
    """Grow the hull in the dimension of the span: that of a tuple, or the given one of an array."""
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
    """Write a direction of balanced coordinates as a unit vector in the wrench space."""
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
    results.slack[g] = math.inf
    erase_forces(results, g)


@merged
def _is_convex(kind, cones):
    """Whether all friction cones are narrower than 90 degrees."""
    if kind == ROWS:
        return True
    least = math.inf
    for i in range(cones.shape[0]):
        least = min(least, cones[i, 0])
    return least > 0.0


@merged
def _examine_separation(form, wrenches, cones, rim, workspace, polytope, results, g):
    """Set the result of a grasp without proof of force closure by whether its direction separates.

    Where it does not, a grasp that is not force-closed becomes UNDECIDED.
    """
    kind, _, torsion = form
    proof = separation(
        kind, torsion != NO_TORSION, wrenches, cones, rim, _largest_wrench(workspace),
        results.direction[g], polytope.vectors,
    )  # fmt: skip
    if proof == UNPROVEN:
        if not results.closed[g]:
            results.status[g] = UNDECIDED
        return
    results.status[g] = NEAR_DEGENERATE if proof == STATIONARY else CONVERGED
    results.closed[g] = False
    results.lower[g] = results.upper[g] = 0.0


@merged
def _narrowed(bracket, cones, polytope, results, g):
    """Narrow a grasp's interval by its closure; returns whether its cones are to be tried next.

    The interval stays where closure has no proof.
    """
    closed = results.closed[g]
    if not (results.slack[g] < LARGEST_SLACK if closed else results.status[g] == CONVERGED):
        return False
    angle = narrow(
        bracket, g, math.atan2(cones[g, 0, 1], cones[g, 0, 0]), closed, results.forces[g],
        results.slack[g], results.direction[g], polytope.vectors,
    )  # fmt: skip
    for i in range(cones.shape[1]):
        cones[g, i, 0], cones[g, i, 1] = math.cos(angle), math.sin(angle)
    return angle > 0.0


@scratch_kernel(
    "tuple[int, bool, int], Floats3, Floats1, Floats2, Floats2, float, Workspace, Floats2, Floats2"
)
def verify(form, wrenches, tangential, cones, rim, tolerance, workspace, scratch, forces):
    """Correct forces of one grasp found by other means; returns the slack of `balance`."""
    kind, spherical, torsion = form
    rank = load(form, wrenches, tangential, tolerance, workspace)
    total = ROWS if kind == ROWS else TOTAL
    project(total, wrenches, workspace, rank)
    space = WrenchSpace(total, spherical, torsion, workspace.axes, cones, rim, 1)
    return balance(space, rank, workspace.extents, forces, scratch)


@scratch_kernel(
    "tuple[int, bool, int], Floats4, Floats2, Floats3, Floats2, float, "
    "tuple[float, float, float, float], bool, int, int, "
    "tuple[int, int, int, int, int, int] | Ints1, Bracket, Workspace, Polytope, Results"
)
def epsilons(
    form, wrenches, tangential, cones, rim, tolerance, goal, with_forces, first, least_rank, dims,
    bracket, workspace, polytope, results,
):  # fmt: skip
    """Epsilon, force closure and certificates of many grasps.

    Args:
        form: (kind, spherical, torsion) of `WrenchSpace`.
        wrenches: Axes of contacts (b, n, 4, 6), or rows (b, n, 1, 6).
        tangential: Factor of the tangential axes for the span: 0 without friction (b, n).
        cones: As in `WrenchSpace` (b, n, 2).
        rim: As in `WrenchSpace` (m, 2).
        tolerance: As in `span`.
        goal: As in `grow`; its cutoff is 0 or inf.
        with_forces: Whether equilibrium forces are computed.
        first: Index of the first grasp to compute.
        least_rank: 6, or 1: grasps of lower rank are left out.
        dims: `SIX` where that is 6, so that the lengths of loops are known; else the workspace's
            array, with which grasps of rank 6 take up to an eighth longer.
        bracket: `Bracket`; with intervals the goal is SIGN, with forces, and the cones, all of
            one angle, are written: a grasp is tried until its interval is narrow, or closure has
            no proof.
        workspace: `Workspace`.
        polytope: `Polytope`.
        results: `Results`.

    Returns:
        The first grasp for which the polytope was too small, whose bounds hold, or that has the
        status OTHER_RANK; b if none.
    """
    kind, spherical, torsion = form
    g = first
    while g < wrenches.shape[0]:
        _reset_result(results, g)
        rank = load(form, wrenches[g], tangential[g], tolerance, workspace)
        results.rank[g] = rank
        if rank == 0:
            g += 1
            continue
        if rank < least_rank:
            results.status[g] = OTHER_RANK
            return g
        project(kind, wrenches[g], workspace, rank)
        space = WrenchSpace(kind, spherical, torsion, workspace.axes, cones[g], rim, 1)
        status, lower, upper, vertices, used = _grow(
            space, dims, rank, workspace.metric, goal, polytope
        )
        closed = used > 0 and lower > 0.0
        # No plane could be computed: the sizes of the coordinates differ too much.
        if math.isinf(lower) and goal[2] == math.inf:
            status, lower, upper, closed = STALLED, 0.0, _largest_wrench(workspace), False
        lower = min(lower, upper)
        results.lower[g], results.upper[g] = max(0.0, lower), upper
        results.status[g], results.closed[g] = status, closed
        if status != STALLED or closed:
            write_direction(rank, workspace, polytope.vectors[16], results.direction[g])
        clear = lower > CLEAR * _largest_wrench(workspace)
        if closed and clear:
            results.slack[g] = 0.0
        if closed and (with_forces or not clear) and _is_convex(kind, cones[g]):
            if kind == PER_FINGER:  # the hull contains the origin where the sum does
                space = WrenchSpace(TOTAL, spherical, torsion, workspace.axes, cones[g], rim, 1)
                _, _, _, vertices, used = _grow(space, dims, rank, workspace.metric, SIGN, polytope)
            slack = math.inf
            if used > 0:
                equilibrium(
                    space, workspace.dims[:rank], polytope, vertices, used, results.forces[g]
                )
                extents, scratch = workspace.extents, polytope.vectors
                if clear and spherical and kind == TOTAL:
                    slack = clear_slack(space, rank, extents, lower, results.forces[g], scratch[0])
                if not slack < SMALL_SLACK:
                    slack = balance(space, rank, extents, results.forces[g], scratch)
            results.slack[g] = slack
            if not slack < LARGEST_SLACK:
                erase_forces(results, g)
        # The origin may be outside, or rounding may have moved it: either needs a proof.
        proven = clear or results.slack[g] < LARGEST_SLACK
        if not (closed and proven) and status != EXHAUSTED:
            _examine_separation(form, wrenches[g], cones[g], rim, workspace, polytope, results, g)
        if status == EXHAUSTED:
            return g
        trying = bracket.high.shape[0] > 0 and rank == 6
        if not (trying and _narrowed(bracket, cones, polytope, results, g)):
            g += 1
    return wrenches.shape[0]
