"""Whole grasps: from the wrenches of their contacts to epsilon, closure and proof."""

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from grasp3d._kernels.compiling import merged, scratch_kernel
from grasp3d._kernels.equilibrium import equilibrium
from grasp3d._kernels.growing_hull import EXHAUSTED, STALLED, grow
from grasp3d._kernels.support_functions import PER_FINGER, ROWS, TOTAL, Body
from grasp3d._kernels.wrench_span import span

SIX = (0, 0, 0, 0, 0, 0)
"""As long as the most common rank, whose loops are laid out when compiled."""

SIGN = (0.0, 1e4, 0.0, 1.0)
"""Goal of a closure test; see `grow`."""


class Workspace(NamedTuple):
    """Room to lay out one grasp in the coordinates of its span; n contacts or rows."""

    rows: npt.NDArray[np.float64]
    """Wrenches that span the grasp (4 n, 6), or the n rows (n, 6)."""
    work: npt.NDArray[np.float64]
    """Scratch of that shape."""
    basis: npt.NDArray[np.float64]
    """Basis of the span (6, 6)."""
    axes: npt.NDArray[np.float64]
    """As in `Body`."""
    sizes: npt.NDArray[np.float64]
    """How far the wrenches reach along each row of the basis (6,)."""
    metric: npt.NDArray[np.float64]
    """As in `grow` (6,)."""
    dims: npt.NDArray[np.int64]
    """Six numbers, of which as many are handed on as the rank says (6,)."""


class Answers(NamedTuple):
    """What is known of each grasp (b, ...); written."""

    lower: npt.NDArray[np.float64]
    upper: npt.NDArray[np.float64]
    rank: npt.NDArray[np.int64]
    status: npt.NDArray[np.uint8]
    closed: npt.NDArray[np.bool_]
    direction: npt.NDArray[np.float64]
    """Direction of `upper`, or in which no wrench lies (b, 6)."""
    forces: npt.NDArray[np.float64]
    """Equilibrium, in the contacts' axes (b, n, 4); nan where there is none."""


def make_workspace(kind: int, count: int) -> Workspace:
    """Allocate a workspace for `count` contacts or rows."""
    rows = count if kind == ROWS else 4 * count
    return Workspace(
        rows=np.zeros((rows, 6)),
        work=np.zeros((rows, 6)),
        basis=np.zeros((6, 6)),
        axes=np.zeros((1, 6, count) if kind == ROWS else (count, 4, 6)),
        sizes=np.zeros(6),
        metric=np.zeros(6),
        dims=np.zeros(6, dtype=np.int64),
    )


@merged
def _lay_rows(wrenches, workspace):
    """Lay out given wrenches (n, 6)."""
    rows = workspace.rows
    for i in range(rows.shape[0]):
        for k in range(6):
            rows[i, k] = wrenches[i, k]


@merged
def _lay_contacts(axes, reach, soft, workspace):
    """Lay out the axes (n, 4, 6) of contacts, tangential ones as far as friction reaches (n,)."""
    rows = workspace.rows
    for i in range(axes.shape[0]):
        for j in range(4):
            factor = 1.0
            if 1 <= j <= 2:
                factor = reach[i]
            elif j == 3 and not soft:
                factor = 0.0
            for k in range(6):
                rows[4 * i + j, k] = factor * axes[i, j, k]


@merged
def _along(basis, plain, k, wrench):
    """Coordinate of a wrench along a row of the basis; `plain`: they are the unit vectors."""
    if plain:
        return wrench[k]
    value = 0.0
    for c in range(6):
        value += basis[k, c] * wrench[c]
    return value


@merged
def _project(kind, source, workspace, rank):
    """Write the wrenches in coordinates of their span, balanced: each reaches 1 somewhere."""
    basis, sizes, metric, count = (
        workspace.basis,
        workspace.sizes,
        workspace.metric,
        source.shape[0],
    )
    plain = True
    for k in range(6):
        sizes[k] = 0.0
        plain = plain and basis[k, k] == 1.0
    for i in range(workspace.rows.shape[0]):
        for k in range(rank):
            sizes[k] = max(sizes[k], abs(_along(basis, plain, k, workspace.rows[i])))
    for k in range(6):
        if kind == PER_FINGER:
            sizes[k] *= count
        metric[k] = 1.0 / sizes[k] if sizes[k] > 0.0 else 0.0
    for i in range(count):
        for j in range(1 if kind == ROWS else 4):
            for k in range(6):
                value = metric[k] * _along(basis, plain, k, source[i, j])
                if kind == ROWS:
                    workspace.axes[0, k, i] = value
                else:
                    workspace.axes[i, j, k] = value
    for k in range(6):
        metric[k] *= metric[k]


@merged
def _grow(body, rank, workspace, goal, polytope):
    if rank == 6:
        return grow(body, SIX, workspace.metric, goal, polytope)
    return grow(body, workspace.dims[:rank], workspace.metric, goal, polytope)


@merged
def _direction(rank, workspace, polytope, out):
    """Write the best direction in the six dimensions of wrenches, of length 1."""
    square = 0.0
    for k in range(6):
        out[k] = 0.0
        for j in range(rank):
            out[k] += workspace.basis[j, k] * polytope.vectors[16, j] / workspace.sizes[j]
        square += out[k] * out[k]
    for k in range(6):
        out[k] /= math.sqrt(square)


@merged
def _reach(workspace):
    """Length that no wrench exceeds."""
    square = 0.0
    for k in range(6):
        square += workspace.sizes[k] * workspace.sizes[k]
    return math.sqrt(square)


@merged
def _clear(answers, g):
    """Say of a grasp what holds before anything is known."""
    answers.lower[g] = answers.upper[g] = 0.0
    answers.rank[g], answers.status[g], answers.closed[g] = 0, 0, False
    for k in range(6):
        answers.direction[g, k] = 1.0 if k == 0 else 0.0
    for i in range(answers.forces.shape[1]):
        for k in range(4):
            answers.forces[g, i, k] = math.nan


@scratch_kernel
def epsilons(
    form, wrenches, reach, cones, rim, goal, group, prove, first, workspace, polytope, answers
):
    """Epsilon, closure and proof of many grasps.

    Args:
        form: (kind, spherical, soft) of `Body`.
        wrenches: Axes of contacts (b, n, 4, 6) or rows (b, n, 1, 6).
        reach: Tangential part of the forces that make the span (b, n).
        cones: As in `Body` (b, n, 2).
        rim: As in `Body` (m, 2).
        goal: As in `grow`; its cutoff is 0 or inf.
        group: How many grasps in a row are candidates for the same smallest epsilon; each is given
            up when it cannot be smaller than those before it. 1: all are wanted.
        prove: Whether equilibria are asked for.
        first: Grasp to begin with.
        workspace: `Workspace`.
        polytope: `Polytope`.
        answers: `Answers`.

    Returns:
        The first grasp that the polytope was too small for, b if none; its bounds hold.
    """
    kind, spherical, soft = form
    rtol, atol, cutoff, sign = goal
    least = math.inf
    for g in range(first - first % group, first):
        least = min(least, answers.upper[g])
    for g in range(first, wrenches.shape[0]):
        if g % group == 0:
            least = math.inf
        _clear(answers, g)
        if group > 1 and least <= 0.0:
            answers.lower[g] = answers.upper[g] = math.inf
            continue
        if kind == ROWS:
            _lay_rows(wrenches[g, :, 0], workspace)
        else:
            _lay_contacts(wrenches[g], reach[g], soft, workspace)
        rank = span(workspace.rows, workspace.work, workspace.basis)
        answers.rank[g] = rank
        if rank == 0:
            least = 0.0
            continue
        _project(kind, wrenches[g], workspace, rank)
        body = Body(kind, spherical, soft, workspace.axes, cones[g], rim)
        limit = min(cutoff, least) if group > 1 else cutoff
        status, lower, upper, vertices, used = _grow(
            body, rank, workspace, (rtol, atol, limit, sign), polytope
        )
        closed = used > 0 and lower > 0.0
        if math.isinf(lower) and limit == math.inf:  # numbers so far apart that planes broke down
            status, lower, upper, closed = STALLED, 0.0, _reach(workspace), False
        lower = min(lower, upper)
        answers.lower[g], answers.upper[g] = max(0.0, lower), upper
        answers.status[g], answers.closed[g] = status, closed
        if status != STALLED or closed:
            _direction(rank, workspace, polytope, answers.direction[g])
        least = min(least, upper)
        if prove and closed:
            if kind == PER_FINGER:  # the hull of all contacts closes where their sum does
                body = Body(TOTAL, spherical, soft, workspace.axes, cones[g], rim)
                _, _, _, vertices, used = _grow(body, rank, workspace, SIGN, polytope)
            balanced = used > 0 and equilibrium(
                body, workspace.dims[:rank], polytope, vertices, used, answers.forces[g]
            )
            if not balanced:
                for i in range(answers.forces.shape[1]):
                    for k in range(4):
                        answers.forces[g, i, k] = math.nan
        if status == EXHAUSTED:
            return g
    return wrenches.shape[0]
