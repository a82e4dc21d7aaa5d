"""Support functions of grasp wrench spaces: the farthest wrench in a direction.

Wrenches and directions have six numbers, in coordinates of the grasp's span (zeros beyond its
rank). A contact's unit forces along its normal and its two tangents, and its torsional moment, give
four wrenches, its *axes*. Every wrench that the contact can apply is a linear combination of them,
so the three or four inner products of the axes with a direction determine the support of its
circular cone, or of a soft finger's elliptic limit surface (Howe & Cutkosky 1996), (f_t / mu)^2 +
(tau / e)^2 <= f_n^2. Polygonal cones are given as rows, the wrenches of their edges.

Support functions of tasks: how far the wrenches that a grasp must resist reach.

A task is a sum of convex sets, its terms. Each term is a row of numbers: kind, first and last row
of its points, size, direction (3), cosine and sine of an angle. Forces share one unit; torques are
about the centre of mass, in that unit times the contacts' unit of length.
"""

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from grasp3d._kernels.compiling import merged, part, scratch_kernel
from grasp3d._kernels.surface.vectors import clear6, dot6

TINY = 1e-300
"""Smallest divisor."""

NO_TWIST = 1e-12
"""Relative size of a torsional component up to which it is a rounding error."""

NEWTON_STEPS, ROUNDING = 40, 4e-16
"""Most steps of Newton's method, and the error at which they end."""

ROWS, TOTAL, PER_FINGER = 0, 1, 2
"""Kinds of grasp wrench spaces: given wrenches, the hull of all contacts' wrenches (total force
bounded), or the Minkowski sum over the contacts (force per finger bounded)."""


SIX = (0, 0, 0, 0, 0, 0)
"""A tuple as long as the most common rank; loops over it are compiled with a fixed length."""


class WrenchSpace(NamedTuple):
    """The grasp wrench space of one grasp, in balanced coordinates of its span."""

    kind: int
    """ROWS, TOTAL or PER_FINGER."""
    spherical: bool
    """Whether the length of a contact force is bounded by 1, rather than its normal component."""
    soft: bool
    """Whether any finger resists a torsional moment."""
    axes: npt.NDArray[np.float64]
    """ROWS: the wrenches in columns (1, 6, n). Otherwise each contact's axes (n, 4, 6)."""
    cones: npt.NDArray[np.float64]
    """Normal and tangential part of a force on the rim of each contact's cone (n, 2)."""
    group: int = 1
    """PER_FINGER: number of consecutive contacts that are points of one finger and share the bound
    of its force. ROWS: 1 for the hull of all wrenches; otherwise the space is the Minkowski sum of
    hulls, each of that many consecutive wrenches and 0."""


@merged
def _farthest_row(rows, start, stop, u):
    """Support of a range of the given wrenches, and the index of the farthest one."""
    best, row = -math.inf, start
    for j in range(start, stop):
        height = (rows[0, j] * u[0] + rows[1, j] * u[1]) + (rows[2, j] * u[2] + rows[3, j] * u[3])
        height += rows[4, j] * u[4] + rows[5, j] * u[5]
        if height > best:
            best, row = height, j
    return best, row


@merged
def _farthest_sum(rows, group, u, point):
    """Support of the sum of hulls of groups of wrenches; writes the wrench to `point`."""
    total = 0.0
    clear6(point)
    for start in range(0, rows.shape[1], group):
        height, row = _farthest_row(rows, start, start + group, u)
        if height > 0.0:
            total += height
            for k in range(6):
                point[k] += rows[k, row]
    return total


@merged
def _cosine_and_sine_of_torsion(friction, z0, tangent, twist):
    """Cosine and sine of the point where the elliptic limit surface meets the unit ball farthest.

    On the surface a force has the tangential part mu s and the torsion c per normal force, with
    c^2 + s^2 = 1. The farthest one satisfies mu g / s - (1 + mu^2) |w| / c = mu^2 z0, as does the
    point of an ellipse nearest to another point. With m the second term, s = mu g / (m + mu^2 z0),
    and c^2 + s^2 is convex and falls with m: Newton's method reaches 1 from below.
    """
    pull, brake, bend = friction * tangent, (1.0 + friction * friction) * twist, friction**2 * z0
    size = abs(pull) + abs(brake) + abs(bend)
    if brake <= NO_TWIST * size:
        s = 1.0 if pull >= bend else pull / bend
        return math.sqrt(1.0 - s * s), s
    m = max(brake, pull - bend)
    c = s = 0.0
    for _ in range(NEWTON_STEPS):
        c, s = brake / m, pull / max(m + bend, TINY)
        excess = c * c + s * s - 1.0
        if excess <= ROUNDING:
            break
        m += 0.5 * excess / (c * c / m + s * s / max(m + bend, TINY))
    length = math.sqrt(c * c + s * s)
    return c / length, s / length


@part
def _farthest_elliptic(spherical, friction, z0, z1, z2, z3):
    """(support, force) of a contact with the elliptic limit surface; see `_farthest_force`."""
    tangent, twist = math.sqrt(z1 * z1 + z2 * z2), abs(z3)
    if spherical:
        c, s = _cosine_and_sine_of_torsion(friction, z0, tangent, twist)
        normal = 1.0 / math.sqrt(1.0 + friction * friction * s * s)
    else:
        length = math.sqrt(friction * friction * tangent * tangent + twist * twist)
        c, s = twist / max(length, TINY), friction * tangent / max(length, TINY)
        normal = 1.0
    height = normal * (z0 + friction * s * tangent + c * twist)
    scale = normal * friction * s / max(tangent, TINY)
    return height, normal, scale * z1, scale * z2, math.copysign(normal * c, z3)


@merged
def _farthest_force(space, i, u):
    """(support, not clipped at 0, and force along its axes) of one contact."""
    axes = space.axes[i]
    z0, z1, z2 = dot6(axes[0], u), dot6(axes[1], u), dot6(axes[2], u)
    normal, tangential = space.cones[i, 0], space.cones[i, 1]
    # z0, z1, z2: components of g (see `support`) along the normal and the two tangents.
    if space.soft and dot6(axes[3], axes[3]) > 0.0:
        return _farthest_elliptic(
            space.spherical, tangential / normal, z0, z1, z2, dot6(axes[3], u)
        )
    # Inside the cone the farthest unit force is parallel to g, otherwise it is on the rim.
    tangent = math.sqrt(z1 * z1 + z2 * z2)
    if space.spherical and tangent * normal <= z0 * tangential and (z0 > 0.0 or tangent > 0.0):
        height = math.sqrt(z0 * z0 + tangent * tangent)
        scale = 1.0 / max(height, TINY)
        return height, scale * z0, scale * z1, scale * z2, 0.0
    scale = tangential / max(tangent, TINY)
    return normal * z0 + tangential * tangent, normal, scale * z1, scale * z2, 0.0


@merged
def _farthest_of_finger(space, start, u, force):
    """(support, contact) of the points of one finger; writes that contact's force along its axes.

    The contact is -1 if none pushes that way: a finger may also apply no force.
    """
    best, owner = 0.0, -1
    for i in range(start, start + space.group):
        height, f0, f1, f2, f3 = _farthest_force(space, i, u)
        if height > best:
            best, owner = height, i
            force[0], force[1], force[2], force[3] = f0, f1, f2, f3
    return best, owner


@merged
def farthest(space, u, point, force):
    """Find the farthest wrench of a grasp wrench space in a direction.

    With g = u_f + (u_tau x p) / rho at a contact and phi the angle between g and its normal, the
    circular cone reaches |g| cos(max(0, phi - beta)).

    Args:
        space: `WrenchSpace`.
        u: Direction (6,).
        point: Written, the wrench (6,).
        force: Written, the contact force of that wrench in its contact's axes (4,); for PER_FINGER,
            that of one of the contacts.

    Returns:
        (height, identifier, owner): the support, negative if all wrenches of ROWS or TOTAL have
        negative components; a number that identifies the vertex (-1 if none, as on circular
        cones); the index of its row or contact.
    """
    axes = space.axes
    if space.kind == ROWS:
        rows = axes[0]
        force[0], force[1], force[2], force[3] = 1.0, 0.0, 0.0, 0.0
        if space.group > 1:
            return _farthest_sum(rows, space.group, u, point), -1, -1
        height, identifier = _farthest_row(rows, 0, rows.shape[1], u)
        for k in range(6):
            point[k] = rows[k, identifier]
        return height, identifier, identifier
    if space.kind == PER_FINGER:
        total = 0.0
        clear6(point)
        for start in range(0, axes.shape[0], space.group):
            # Support functions of a Minkowski sum add up.
            height, i = _farthest_of_finger(space, start, u, force)
            if i < 0:
                continue
            total += height
            for k in range(6):
                point[k] += (force[0] * axes[i, 0, k] + force[1] * axes[i, 1, k]) + (
                    force[2] * axes[i, 2, k] + force[3] * axes[i, 3, k]
                )
        return total, -1, -1
    best, owner = -math.inf, 0
    for i in range(axes.shape[0]):
        height, f0, f1, f2, f3 = _farthest_force(space, i, u)
        if height > best:
            best, owner = height, i
            force[0], force[1], force[2], force[3] = f0, f1, f2, f3
    for k in range(6):
        point[k] = (force[0] * axes[owner, 0, k] + force[1] * axes[owner, 1, k]) + (
            force[2] * axes[owner, 2, k] + force[3] * axes[owner, 3, k]
        )
    return best, -1, owner


@scratch_kernel()
def support(space, u, point, force):
    """`farthest` as a separate function."""
    return farthest(space, u, point, force)


@part
def contact_forces(space, u, weight, force, forces):
    """Add the contact forces of the farthest wrench in a direction, times a weight.

    Args:
        space: `WrenchSpace`, PER_FINGER.
        u: Direction (6,).
        weight: Factor.
        force: Scratch (4,).
        forces: Changed, forces in the contacts' axes (n, 4).
    """
    for start in range(0, space.axes.shape[0], space.group):
        _, i = _farthest_of_finger(space, start, u, force)
        if i >= 0:
            for k in range(4):
                forces[i, k] += weight * force[k]


ANY_DIRECTION, WITHIN, POINTS = 0, 1, 2
"""Kinds of terms: a force at the centre of mass in any direction, or within an angle of a
direction; the convex hull of given wrenches."""

TERM, SIZE = 9, 3
"""Length of a term, and position of the size of its force."""

NEGLIGIBLE = 1e-12
"""Reach, relative to the task's extent along the coordinates, that is a rounding error."""


class TaskInSpan(NamedTuple):
    """A task in the balanced coordinates of a grasp's span."""

    frame: npt.NDArray[np.float64]
    """Direction of each coordinate, for forces and torques in the contacts' units (6, 6)."""
    rank: int
    """Number of coordinates."""
    extents: npt.NDArray[np.float64]
    """How far the task reaches along each coordinate, in either sense (6,)."""
    terms: npt.NDArray[np.float64]
    """Terms (t, TERM)."""
    points: npt.NDArray[np.float64]
    """Wrenches of the POINTS terms (p, 6)."""


@merged
def _force_within(term, fx, fy, fz):
    """Supremum of f . u_f over forces of one size within an angle of a direction."""
    gx, gy, gz, cosine, sine = term[4], term[5], term[6], term[7], term[8]
    length = math.sqrt((fx * fx + fy * fy) + fz * fz)
    along = (fx * gx + fy * gy) + fz * gz
    if along >= length * cosine:
        reach = length
    else:
        reach = along * cosine + math.sqrt(max(length * length - along * along, 0.0)) * sine
    return term[SIZE] * reach


@merged
def _row_product(points, i, fx, fy, fz, tx, ty, tz):
    return ((points[i, 0] * fx + points[i, 1] * fy) + (points[i, 2] * fz + points[i, 3] * tx)) + (
        points[i, 4] * ty + points[i, 5] * tz
    )


@part
def reach(terms, points, fx, fy, fz, tx, ty, tz):
    """Support function of a task in a direction (f, t), in the contacts' units."""
    total = 0.0
    for i in range(terms.shape[0]):
        term = terms[i]
        kind, first, last = int(term[0]), int(term[1]), int(term[2])
        if kind == ANY_DIRECTION:
            total += term[SIZE] * math.sqrt((fx * fx + fy * fy) + fz * fz)
        elif kind == WITHIN:
            total += _force_within(term, fx, fy, fz)
        else:
            farthest = -math.inf
            for j in range(first, last):
                farthest = max(farthest, _row_product(points, j, fx, fy, fz, tx, ty, tz))
            total += farthest
    return total


@part
def task_reach(task, direction):
    """Reach of a task's opposite along a direction in balanced coordinates, at least 0.

    The contacts must apply the opposite of each wrench of the task.

    Args:
        task: `TaskInSpan`.
        direction: At least as many numbers as the task's rank.
    """
    u0 = u1 = u2 = u3 = u4 = u5 = extent = 0.0
    for k in range(task.rank):
        n, row = direction[k], task.frame[k]
        u0 -= n * row[0]
        u1 -= n * row[1]
        u2 -= n * row[2]
        u3 -= n * row[3]
        u4 -= n * row[4]
        u5 -= n * row[5]
        extent += abs(n) * task.extents[k]
    value = reach(task.terms, task.points, u0, u1, u2, u3, u4, u5)
    return value if value > NEGLIGIBLE * extent else 0.0
