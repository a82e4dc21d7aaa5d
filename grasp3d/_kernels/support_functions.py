"""Support functions of grasp wrench spaces: the farthest wrench in a direction.

A wrench and a direction have six numbers, in coordinates of the grasp's span (zeros behind its
rank). A contact's unit forces along its normal and its two tangents, and its torsional moment,
give four wrenches, its *axes*; every wrench that it can apply is linear in them, and so is their
product with a direction: three numbers per contact settle all edges of its cone.
"""

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from grasp3d._kernels.compiling import merged, scratch_kernel
from grasp3d._kernels.vectors import dot6

TINY = 1e-300
"""Keeps a division by nothing harmless."""

ROWS, TOTAL, PER_FINGER = 0, 1, 2
"""The hull of given wrenches, of all contacts together, or the sum of the contacts' hulls."""


class Body(NamedTuple):
    """What the supports of one grasp are taken over, in balanced coordinates of its span."""

    kind: int
    """ROWS, TOTAL or PER_FINGER."""
    spherical: bool
    """Whether it is a force's length that is at most 1, and not its normal part."""
    soft: bool
    """Whether any contact resists torsion."""
    axes: npt.NDArray[np.float64]
    """ROWS: the wrenches, as one (1, 6, n). Otherwise each contact's axes (n, 4, 6)."""
    cones: npt.NDArray[np.float64]
    """Normal and tangential part of a force on the rim of each contact's cone (n, 2)."""
    rim: npt.NDArray[np.float64]
    """Cosine and sine of the cone's edges about the normal (m, 2); m = 0: a circular cone."""


@merged
def _farthest_row(rows, u):
    """Support of given wrenches and the row that reaches it."""
    best, chosen = -math.inf, 0
    for j in range(rows.shape[1]):
        height = (rows[0, j] * u[0] + rows[1, j] * u[1]) + (rows[2, j] * u[2] + rows[3, j] * u[3])
        height += rows[4, j] * u[4] + rows[5, j] * u[5]
        if height > best:
            best, chosen = height, j
    return best, chosen


@merged
def _farthest_force(body, i, u):
    """Support of one contact, not clipped at 0, its name, and the force in the contact's axes."""
    axes = body.axes[i]
    z0, z1, z2 = dot6(axes[0], u), dot6(axes[1], u), dot6(axes[2], u)
    normal, tangential = body.cones[i, 0], body.cones[i, 1]
    count = body.rim.shape[0]
    name = -1
    if count > 0:
        best = -math.inf
        for j in range(count):
            value = body.rim[j, 0] * z1 + body.rim[j, 1] * z2
            if value > best:
                best, name = value, j
        height = normal * z0 + tangential * best
        m0, m1, m2 = normal, tangential * body.rim[name, 0], tangential * body.rim[name, 1]
    else:
        across = math.sqrt(z1 * z1 + z2 * z2)
        if body.spherical and across * normal <= z0 * tangential and (z0 > 0.0 or across > 0.0):
            height = math.sqrt(z0 * z0 + across * across)
            scale = 1.0 / max(height, TINY)
            m0, m1, m2 = scale * z0, scale * z1, scale * z2
        else:
            height = normal * z0 + tangential * across
            scale = tangential / max(across, TINY)
            m0, m1, m2 = normal, scale * z1, scale * z2
    m3 = 0.0
    if body.soft:
        z3 = dot6(axes[3], u)
        if z0 + abs(z3) > height and dot6(axes[3], axes[3]) > 0.0:  # else it is a hard one
            height = z0 + abs(z3)
            m0, m1, m2, m3 = 1.0, 0.0, 0.0, math.copysign(1.0, z3)
            name = count if z3 >= 0.0 else count + 1
    return height, name, m0, m1, m2, m3


@scratch_kernel
def support(body, u, point, mix):
    """Farthest wrench of a grasp wrench space in a direction.

    With g = u_f + (u_tau x p) / rho at a contact and phi the angle between g and its normal, the
    circular cone reaches |g| cos(max(0, phi - beta)), a polygon the farthest of its edges, and
    torsion the pure normal force with the moment that it allows.

    Args:
        body: `Body`.
        u: Direction (6,).
        point: Written, the wrench (6,).
        mix: Written, the force that makes it, in its contact's axes (4,); not for PER_FINGER.

    Returns:
        (height, name, owner): the support, negative where every wrench of ROWS or TOTAL is behind;
        a number that the same vertex always has (-1: unnamed); its row or contact.
    """
    axes = body.axes
    if body.kind == ROWS:
        height, name = _farthest_row(axes[0], u)
        for k in range(6):
            point[k] = axes[0, k, name]
        mix[0], mix[1], mix[2], mix[3] = 1.0, 0.0, 0.0, 0.0
        return height, name, name
    best, owner, name = -math.inf, 0, -1
    total = 0.0
    for k in range(6):
        point[k] = 0.0
    for i in range(axes.shape[0]):
        height, label, m0, m1, m2, m3 = _farthest_force(body, i, u)
        if body.kind == PER_FINGER:
            if height > 0.0:
                total += height
                for k in range(6):
                    point[k] += (m0 * axes[i, 0, k] + m1 * axes[i, 1, k]) + (
                        m2 * axes[i, 2, k] + m3 * axes[i, 3, k]
                    )
        elif height > best:
            best, owner, name = height, i, label
            mix[0], mix[1], mix[2], mix[3] = m0, m1, m2, m3
    if body.kind == PER_FINGER:
        return total, -1, -1
    for k in range(6):
        point[k] = (mix[0] * axes[owner, 0, k] + mix[1] * axes[owner, 1, k]) + (
            mix[2] * axes[owner, 2, k] + mix[3] * axes[owner, 3, k]
        )
    if name >= 0:
        name += owner * (body.rim.shape[0] + 2)
    return best, name, owner
