"""The smallest contact forces that resist wrenches or whole tasks, for batches of grasps."""

import math
from typing import NamedTuple

import numpy as np

from grasp3d._kernels.compiling import (
    Bytes1,
    Floats1,
    Floats2,
    Floats3,
    Ints1,
    merged,
    scratch_kernel,
)
from grasp3d._kernels.hull.growing_hull import AROUND_ORIGIN, AT_ORIGIN, CONVERGED, EXHAUSTED, grow
from grasp3d._kernels.hull.polytope import SCRATCH_ROWS
from grasp3d._kernels.hull.support_functions import (
    ANY_DIRECTION,
    SIX,
    SIZE,
    TERM,
    TaskInSpan,
    WrenchSpace,
    reach,
    task_reach,
)
from grasp3d._kernels.hull.wrench_problem import erase_forces, load, project, write_direction
from grasp3d._kernels.hull.wrench_resistance import RESISTED, ForceSlice, resist
from grasp3d._kernels.surface.vectors import add6, clear6, dot6

THREE = (0, 0, 0)
"""A tuple as long as the rank of forces, for which `grow` is compiled."""

SHARPER = 0.1
"""Gap between the bounds along one ray, relative to the gap allowed for the result."""

OUTSIDE = 1e-9
"""Largest part of a wrench outside the grasp's span, relative to the wrench, due to rounding."""

NOT_IN_SPAN, NOT_RESISTED, FINITE = 2, 1, 0
"""Why no force suffices: the contacts cannot apply the wrench in either sense, or they cannot push
that way; FINITE where a force suffices."""


UNFINISHED = 255
"""Status of a wrench for which the search found neither a force nor a proof that none exists."""


class TaskScratch(NamedTuple):
    """Scratch for the task of one grasp in the coordinates of its span."""

    frame: Floats2
    """As in `TaskInSpan` (6, 6)."""
    extents: Floats1
    """As in `TaskInSpan` (6,)."""
    terms: Floats2
    """The terms for the grasp's mass (t, TERM)."""
    goals: Floats2
    """As in `ForceSlice` (3, 6)."""
    vectors: Floats2
    """Scratch of `resist` (SCRATCH_ROWS, 8)."""
    best: Floats1
    """As in `ForceSlice` (7,)."""
    ones: Floats1
    """Metric of forces (6,)."""


def make_scratch(terms: int) -> TaskScratch:
    """Allocate scratch for a number of terms."""
    return TaskScratch(
        frame=np.zeros((6, 6)),
        extents=np.zeros(6),
        terms=np.zeros((terms, TERM)),
        goals=np.zeros((3, 6)),
        vectors=np.zeros((SCRATCH_ROWS, 8)),
        best=np.zeros(7),
        ones=np.ones(6),
    )


class ForceResults(NamedTuple):
    """Results for each grasp (b, ...); written."""

    lower: Floats1
    upper: Floats1
    rank: Ints1
    status: Bytes1
    reason: Bytes1
    direction: Floats2
    """Direction that proves `lower` (b, 6)."""
    forces: Floats3
    """Contact forces that resist the wrench, in the contacts' axes (b, n, 4); nan if none do."""


@merged
def _reset(results, g):
    results.lower[g] = results.upper[g] = math.inf
    results.status[g], results.reason[g] = CONVERGED, FINITE
    clear6(results.direction[g])


@merged
def _load(form, axes, tangential, workspace):
    """Write the contacts' wrenches in balanced coordinates of their span; return its rank."""
    rank = load(form, axes, tangential, workspace)
    project(form[0], axes.shape[0], axes, workspace, rank)
    return rank


@merged
def _write_own_direction(rank, workspace, vector, torque_scale, out):
    """Write a direction, given in balanced coordinates, for wrenches in the contacts' units.

    The force part and the torque part times the torque scale together have length 1.
    """
    write_direction(rank, workspace, vector, out)
    for k in range(3, 6):
        out[k] /= torque_scale


@merged
def _complement(rank, basis, out):
    """Write, from row `rank` on, an orthonormal basis of the span's complement (6, 6)."""
    for size in range(rank, 6):
        best, axis = -1.0, 0
        for c in range(6):
            remaining = 1.0
            for j in range(size):
                row = basis[j] if j < rank else out[j]
                remaining -= row[c] * row[c]
            if remaining > best:
                best, axis = remaining, c
        v = out[size]
        for k in range(6):
            v[k] = 1.0 if k == axis else 0.0
        for _ in range(2):
            for j in range(size):
                row = basis[j] if j < rank else out[j]
                component = 0.0
                for k in range(6):
                    component += row[k] * v[k]
                add6(v, -component, row)
        square = 0.0
        for k in range(6):
            square += v[k] * v[k]
        for k in range(6):
            v[k] /= math.sqrt(square)


@merged
def _reach_along(terms, points, v, sign, torque_scale):
    t = sign / torque_scale
    return reach(terms, points, sign * v[0], sign * v[1], sign * v[2], t * v[3], t * v[4], t * v[5])


@merged
def _leaves_span(terms, points, size, rank, torque_scale, workspace, vectors, out):
    """Whether a task has wrenches outside the span; if so, write the direction of one."""
    if rank == 6:
        return False
    _complement(rank, workspace.basis, vectors)
    for j in range(rank, 6):
        for sign in (1.0, -1.0):
            if _reach_along(terms, points, vectors[j], sign, torque_scale) > OUTSIDE * size:
                for k in range(6):
                    out[k] = -sign * vectors[j, k]
                    if k >= 3:
                        out[k] /= torque_scale
                return True
    return False


@merged
def _write_task(terms, points, rank, torque_scale, workspace, task):
    """Write the frame and the extents of a task in balanced coordinates."""
    for k in range(rank):
        row = task.frame[k]
        for c in range(6):
            row[c] = workspace.basis[k, c] / workspace.extents[k]
            if c >= 3:
                row[c] /= torque_scale
        task.extents[k] = max(
            abs(reach(terms, points, row[0], row[1], row[2], row[3], row[4], row[5])),
            abs(reach(terms, points, -row[0], -row[1], -row[2], -row[3], -row[4], -row[5])),
        )


@merged
def _force_in_all_directions(terms):
    """Size of a task if it is a force in any direction at the centre of mass; 0 for other tasks."""
    size = 0.0
    for i in range(terms.shape[0]):
        if terms[i, 0] != ANY_DIRECTION:
            return 0.0
        size += terms[i, SIZE]
    return size


@merged
def _grow_slice(space, task, size, rtol, workspace, polytope, scratch):
    """Bounds of 1 / force, from the forces without torque; the lower one is 0 if that fails."""
    for k in range(3):
        for j in range(6):
            scratch.goals[k, j] = workspace.basis[j, k] / workspace.extents[j]
    scratch.best[6] = math.inf
    forces = ForceSlice(
        space, task, scratch.goals, size, SHARPER * rtol, scratch.vectors, scratch.best
    )
    goal = (rtol, 0.0, math.inf)
    status, lower, _, _, used = grow(
        forces, THREE, scratch.ones, None, AROUND_ORIGIN, goal, polytope
    )
    if used == 0:
        return status, 0.0, 0.0
    return status, min(lower / size, scratch.best[6]), scratch.best[6]


@scratch_kernel(
    "tuple[int, bool, bool, int], Floats4, Floats2, Floats3, Floats2, Floats2, Floats1, "
    "float, Floats1, float, int, Workspace, Polytope, TaskScratch, ForceResults"
)
def task_forces(
    form, axes, tangential, cones, terms, points, masses, size, torque_scale, rtol, first,
    workspace, polytope, scratch, results,
):  # fmt: skip
    """Bounds of the force that resists a whole task.

    Args:
        form: (kind, spherical, soft, group) of `WrenchSpace`; not ROWS.
        axes: Axes of contacts (b, n, 4, 6), torques divided by the torque scale.
        tangential: Factor of the tangential axes for the span: 0 without friction (b, n).
        cones: As in `WrenchSpace` (b, n, 2).
        terms: Terms of the task (t, TERM).
        points: Wrenches of the terms (p, 6).
        masses: Factors of the terms that are forces at the centre of mass (b,).
        size: Size of the task: its largest reach along a unit direction, or more.
        torque_scale: Torque scale of each grasp (b,).
        rtol: Largest gap between the bounds, relative to the upper one.
        first: Index of the first grasp to compute.
        workspace: `Workspace`.
        polytope: `Polytope`.
        scratch: `TaskScratch`.
        results: `ForceResults`; forces are not written.

    Returns:
        The first grasp for which the polytope was too small (b if none); its bounds are valid.
    """
    kind, spherical, soft, group = form
    goal = (rtol, 0.0, math.inf)
    for g in range(first, axes.shape[0]):
        _reset(results, g)
        rank = _load(form, axes[g], tangential[g], workspace)
        results.rank[g] = rank
        scale, direction = torque_scale[g], results.direction[g]
        own = scratch.terms
        for i in range(terms.shape[0]):
            for k in range(TERM):
                own[i, k] = terms[i, k] * (masses[g] if k == SIZE else 1.0)
        if _leaves_span(own, points, size, rank, scale, workspace, polytope.vectors, direction):
            results.reason[g] = NOT_IN_SPAN
            continue
        task = TaskInSpan(scratch.frame, rank, scratch.extents, own, points)
        _write_task(own, points, rank, scale, workspace, task)
        space = WrenchSpace(kind, spherical, soft, workspace.axes, cones[g], group)
        force = _force_in_all_directions(own) if rank == 6 else 0.0
        if force > 0.0:
            status, lower, upper = _grow_slice(
                space, task, force, rtol, workspace, polytope, scratch
            )
            if lower > 0.0:
                _write_own_direction(rank, workspace, scratch.best, scale, direction)
                results.status[g] = status
                results.lower[g], results.upper[g] = 1.0 / upper, 1.0 / lower
                if status == EXHAUSTED:
                    return g
                continue
        start = AROUND_ORIGIN
        while True:
            if rank == 6:
                status, lower, upper, _, used = grow(
                    space, SIX, workspace.metric, task, start, goal, polytope
                )
            else:
                status, lower, upper, _, used = grow(
                    space, workspace.dims[:rank], workspace.metric, task, start, goal, polytope
                )
            best = polytope.vectors[16]
            if used > 0 or start == AT_ORIGIN:
                break
            if task_reach(task, best) > 0.0:
                break
            # Not force-closed, but the task may lie where the contacts can push.
            start = AT_ORIGIN
        _write_own_direction(rank, workspace, best, scale, direction)
        results.status[g] = status
        if used == 0:
            results.reason[g] = NOT_RESISTED
            continue
        results.lower[g] = 1.0 / upper
        results.upper[g] = 1.0 / lower if lower > 0.0 else math.inf
        if status == EXHAUSTED:
            return g
    return axes.shape[0]


@merged
def _write_goal(wrench, rank, torque_scale, workspace, remainder, goal):
    """Write the opposite of a wrench in balanced coordinates; return (size, part outside)."""
    size = outside = 0.0
    for c in range(6):
        remainder[c] = -wrench[c] if c < 3 else -wrench[c] / torque_scale
        size += remainder[c] * remainder[c]
        goal[c] = 0.0
    for k in range(rank):
        value = dot6(workspace.basis[k], remainder)
        goal[k] = value / workspace.extents[k]
        add6(remainder, -value, workspace.basis[k])
    for c in range(6):
        outside += remainder[c] * remainder[c]
    return math.sqrt(size), math.sqrt(outside)


@scratch_kernel(
    "tuple[int, bool, bool, int], Floats4, Floats2, Floats3, Floats2, Floats1, float, "
    "Workspace, Floats2, ForceResults"
)
def wrench_forces(
    form, axes, tangential, cones, wrenches, torque_scale, rtol, workspace, vectors, results
):
    """Find the force that resists one wrench for each grasp, and the contact forces.

    Args:
        form: As in `task_forces`.
        axes: As in `task_forces`.
        tangential: As in `task_forces`.
        cones: As in `task_forces`.
        wrenches: Forces and torques in the contacts' units (b, 6).
        torque_scale: Torque scale of each grasp (b,).
        rtol: Largest gap between the bounds, relative to the upper one.
        workspace: `Workspace`.
        vectors: Scratch (SCRATCH_ROWS, 8).
        results: `ForceResults`; status UNFINISHED where the search did not end.
    """
    kind, spherical, soft, group = form
    for g in range(axes.shape[0]):
        _reset(results, g)
        erase_forces(results, g)
        rank = _load(form, axes[g], tangential[g], workspace)
        results.rank[g] = rank
        scale = torque_scale[g]
        goal = vectors[17]
        size, outside = _write_goal(wrenches[g], rank, scale, workspace, vectors[16], goal)
        if rank < 6 and outside > OUTSIDE * size:
            results.reason[g] = NOT_IN_SPAN
            continue
        if size == 0.0:
            results.lower[g] = results.upper[g] = 0.0
            for i in range(axes.shape[1]):
                for k in range(4):
                    results.forces[g, i, k] = 0.0
            continue
        space = WrenchSpace(kind, spherical, soft, workspace.axes, cones[g], group)
        if rank == 6:
            status, lower, upper = resist(space, SIX, goal, rtol, vectors, results.forces[g])
        else:
            status, lower, upper = resist(
                space, workspace.dims[:rank], goal, rtol, vectors, results.forces[g]
            )
        if status != RESISTED:
            results.status[g] = UNFINISHED
            erase_forces(results, g)
            continue
        results.lower[g], results.upper[g] = lower, upper
        _write_own_direction(rank, workspace, vectors[16], scale, results.direction[g])
