"""Proof that a grasp is not force-closed: a motion that no contact can oppose.

A direction u of wrench space is a motion of the object, and separates a grasp if at no contact a
force of its friction cone has a positive component along the contact's velocity g, and at some
contact every force has a negative one. Two cases prove it in floating point. Contacts that move
need an angle between g and the cone that is 90 degrees or more, up to a rounding error of the
angle: then friction that is smaller by that angle surely does not suffice. Contacts that the motion
leaves at rest have no component at all, but only if they rest exactly: as small a velocity of any
direction would need its sign. So u is replaced by the nearest direction that leaves them at rest,
which exists where they are at one point or on one line.
"""

import math

from grasp3d._kernels.compiling.decorators import merged, part
from grasp3d._kernels.hull.support_functions import ROWS, farthest_in_patch
from grasp3d._kernels.surface.vectors import dot6, remove_components

MOVING, RESTING, UNPROVEN = 0, 1, 2
"""Results of `separation`: separated, all contacts move; separated, some contacts rest (to be
relied on where these contacts are exactly at one point, or on one line); not proven."""

ANGLE = 1e-9
"""Angle by which friction may be smaller for the proof to hold [rad]."""

AT_REST = 1e-9
"""Velocity, relative to the longest wrench and for a unit direction, up to which a contact may be
at rest; more than that has a direction that is known to 1e-6."""

ROUNDING = 1e-15
"""Rounding error of a support function, relative to the longest wrench."""

CLEARLY_MOVING = 1e-6
"""Velocity from which a contact moves once others are at rest."""

INDEPENDENT = 1e-6
"""Part of a wrench orthogonal to others below which it adds no dimension."""


@merged
def _is_resisted(soft, j):
    """Whether a contact resists a motion along its axis: all but torsion do unless it is soft."""
    return soft or j != 3


@merged
def _speed(axes, soft, u):
    """Size of a contact's velocity, with its turning where it resists torsion, or rolling."""
    square = 0.0
    for j in range(axes.shape[0]):
        if not _is_resisted(soft, j):
            continue
        z = dot6(axes[j], u)
        square += z * z
    return math.sqrt(square)


@merged
def _support(axes, cone, soft, rim, u):
    """Support function of a contact's cone of unit forces, not clipped at 0."""
    z0, z1, z2 = dot6(axes[0], u), dot6(axes[1], u), dot6(axes[2], u)
    if axes.shape[0] == 6:  # it resists rolling
        z0 += farthest_in_patch(axes, rim, u)[0]
    tangent = math.sqrt(z1 * z1 + z2 * z2)
    sideways = tangent
    if rim.shape[0] > 0:
        sideways = -math.inf
        for j in range(rim.shape[0]):
            sideways = max(sideways, rim[j, 0] * z1 + rim[j, 1] * z2)
    support = cone[0] * z0 + cone[1] * sideways
    # Of a circular cone that contains the velocity the velocity itself is the farthest.
    if rim.shape[0] == 0 and z0 * cone[1] > tangent * cone[0]:
        support = math.sqrt(z0 * z0 + tangent * tangent)
    return max(support, z0 + abs(dot6(axes[3], u))) if soft else support


@merged
def _leave_at_rest(axes, soft, slowest, scratch, u, v):
    """Write u without its components along all wrenches of the contacts that it hardly moves.

    Returns:
        Whether any motion remains.
    """
    basis, components, size = scratch[0:6], scratch[6], 0
    for i in range(axes.shape[0]):
        if _speed(axes[i], soft, u) > slowest:
            continue
        for j in range(axes.shape[1]):
            if not _is_resisted(soft, j):
                continue
            if size >= 6:
                return False
            row = basis[size]
            for k in range(6):
                row[k] = axes[i, j, k]
            before = dot6(row, row)
            remove_components(basis, size, row, components)
            remove_components(basis, size, row, components)
            square = dot6(row, row)
            if square > INDEPENDENT * INDEPENDENT * before:
                factor = 1.0 / math.sqrt(square)
                for k in range(6):
                    row[k] *= factor
                size += 1
    for k in range(6):
        v[k] = u[k]
    remove_components(basis, size, v, components)
    remove_components(basis, size, v, components)
    square = dot6(v, v)
    if not square > 0.25:
        return False
    for k in range(6):
        v[k] /= math.sqrt(square)
    return True


@merged
def _clearly_separated(axes, cone, soft, slowest, u):
    """Whether a contact moves, and that clearly away from its circular cone; quickly decided."""
    z0, z1, z2 = dot6(axes[0], u), dot6(axes[1], u), dot6(axes[2], u)
    across = z1 * z1 + z2 * z2
    return (
        not soft
        and axes.shape[0] == 4
        and z0 < 0.0
        and z0 * z0 + across > slowest * slowest
        and across * (cone[1] * cone[1]) <= z0 * z0 * (cone[0] * cone[0])
        and cone[0] > 0.0
    )


@part
def separation(kind, soft, axes, cones, rim, largest, u, scratch):
    """Whether a direction proves that a grasp is not force-closed.

    Args:
        kind: As in `WrenchSpace`; given wrenches are not examined.
        soft: As in `WrenchSpace`.
        axes: Wrenches of the contacts' axes, (n, 4, 6) or where they resist rolling (n, 6, 6).
        cones: As in `WrenchSpace` (n, 2).
        rim: As in `WrenchSpace` (m, 2).
        largest: Length of the longest wrench.
        u: Unit direction (6,); replaced where contacts are left at rest.
        scratch: Shape (18, 8).

    Returns:
        MOVING, RESTING or UNPROVEN.
    """
    if kind == ROWS:
        return MOVING
    count, slowest, resting = axes.shape[0], AT_REST * largest, 0
    for i in range(count):
        if _clearly_separated(axes[i], cones[i], soft, slowest, u):
            continue
        speed = _speed(axes[i], soft, u)
        if speed <= slowest:
            resting += 1
        elif _support(axes[i], cones[i], soft, rim, u) > ANGLE * speed + ROUNDING * largest:
            return UNPROVEN
    if resting == 0:
        return MOVING
    v = scratch[7]
    if resting == count or not _leave_at_rest(axes, soft, slowest, scratch, u, v):
        return UNPROVEN
    for i in range(count):
        if _speed(axes[i], soft, u) > slowest:
            speed = _speed(axes[i], soft, v)
            # What touches its cone's border here might gain a positive component by the change.
            if (
                speed <= CLEARLY_MOVING * largest
                or _support(axes[i], cones[i], soft, rim, v) > ANGLE * speed
            ):
                return UNPROVEN
    for k in range(6):
        u[k] = v[k]
    return RESTING
