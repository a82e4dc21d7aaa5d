"""Steps toward grasps of three fingers that balance without friction.

Three normals balance if they lie in the plane through the contacts and meet in a point: four
equations for two contacts on a surface, each with two coordinates. So most smooth surfaces have
such grasps through every point, and Newton's method finds the one near a start in a few steps,
where random steps would have to become smaller by a constant factor each.
"""

import math

from grasp3d._kernels.compiling import merged
from grasp3d._kernels.search.multifinger_grasps import (
    evaluate_if_allowed,
    keep_or_undo,
    set_current,
    walk_finger,
)
from grasp3d._kernels.surface.vectors import cross, difference, divided, dot, norm

STEPS = 8
"""Most steps."""

NUDGE = 1e-3
"""Length of the steps that derivatives are taken over: less than an edge, as normals are smooth
between creases only."""

DAMPING = 1e-4
"""Added to the diagonal of the normal equations, relative to their trace: where the surface is flat
some steps change nothing."""

LONGEST = 0.3
"""Longest step of a finger."""

SHORTENING, TRIES = 0.3, 3
"""Factor by which a step that does not improve the grasp is shortened, and the steps tried."""

TINY = 1e-12


@merged
def _write_residuals(candidate, residuals):
    """Write the elevations of the normals over the plane, and by what they miss a point (4,).

    The latter is the moment of multiples of the normals that balance as forces, for such multiples
    and lever arms of about 1.
    """
    points, normals = candidate.points, candidate.normals
    a, b = difference(points[1], points[0]), difference(points[2], points[0])
    up = cross(a, b)
    up = divided(up, max(norm(up), TINY))
    for i in range(3):
        residuals[i] = dot(normals[i], up)
    second = dot(cross(normals[2], normals[0]), up)
    third = dot(cross(normals[0], normals[1]), up)
    moment = second * dot(cross(a, normals[1]), up) + third * dot(cross(b, normals[2]), up)
    residuals[3] = moment / max(abs(second) * norm(a) + abs(third) * norm(b), TINY)


@merged
def _write_step(domain, workspace):
    """Write the step of the two fingers toward balance, by Gauss and Newton, in the last column."""
    residuals, equations = workspace.residuals, workspace.equations
    _write_residuals(workspace.candidate, residuals[4])
    for c in range(4):
        j = 1 + c // 2
        walk_finger(j, 0.5 * math.pi * (c % 2), NUDGE, domain, workspace)
        _write_residuals(workspace.candidate, residuals[c])
        set_current(j, domain, workspace)
        for k in range(4):
            residuals[c, k] = (residuals[c, k] - residuals[4, k]) / NUDGE
    trace = 0.0
    for r in range(4):
        for c in range(5):
            equations[r, c] = 0.0
            for k in range(4):
                equations[r, c] += residuals[r, k] * residuals[c, k]
        trace += equations[r, r]
    for r in range(4):
        equations[r, r] += DAMPING * trace + TINY
    # Positive definite, so no pivots need be sought.
    for k in range(4):
        for r in range(4):
            if r != k:
                factor = equations[r, k] / equations[k, k]
                for c in range(k + 1, 5):
                    equations[r, c] -= factor * equations[k, c]
    for r in range(4):
        equations[r, 4] /= -equations[r, r]


@merged
def may_balance(v, domain):
    """Whether fingers move freely, and the vertex has one normal: caps do not balance."""
    return not domain.on_vertices and domain.radii[v] == 0.0


@merged
def balance(angle, domain, limits, workspace, plane, hull):
    """Improve the current grasp of three fingers by steps toward balance without friction.

    Returns:
        The critical angle of the improved grasp [rad].
    """
    equations = workspace.equations
    for _ in range(STEPS):
        if angle <= limits.target:
            break
        _write_step(domain, workspace)
        share = 1.0
        for r in (0, 2):
            share = min(
                share, LONGEST / max(math.hypot(equations[r, 4], equations[r + 1, 4]), TINY)
            )
        changed = math.inf
        for _ in range(TRIES):
            fits = True
            for j in range(1, 3):
                x, y = equations[2 * j - 2, 4], equations[2 * j - 1, 4]
                length = share * math.hypot(x, y)
                fits = walk_finger(j, math.atan2(y, x), length, domain, workspace) and fits
            changed = evaluate_if_allowed(
                fits, 3, angle - limits.margin, limits, workspace, plane, hull
            )
            if changed < math.inf:
                break
            share *= SHORTENING
        keep_or_undo(changed < math.inf, 0, 3, domain, workspace)
        if changed == math.inf:
            break
        angle = changed
    return angle
