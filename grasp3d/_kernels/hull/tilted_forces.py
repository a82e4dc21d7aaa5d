"""Support functions of contact forces over all normals within a tilt of the given ones.

A contact has its axes, as in `support_functions`, and a row of numbers in `WrenchSpace.cones`:

* WORST_CASE: forces that a contact can apply whichever its normal is, on one of several levels, the
  same for all contacts of the grasp, and in one of several modes, its own. They are the convex hull
  of a force along the normal, of a part of a ball about it and of a circle of forces, the corner.
  The fourth axis is the torsional moment, which has a size in each mode.
* BEST_CASE: forces that it can apply at some normal.

Contacts next to each other may share a bound, as the points of a patch do: `WrenchSpace.group`.
"""

import math

from grasp3d._kernels.compiling import merged, scratch_kernel
from grasp3d._kernels.surface.vectors import clear6, dot6

WORST_CASE, BEST_CASE = 3, 4
"""Kinds of limit surfaces, besides those of `support_functions`."""

TINY = 1e-300
"""Smallest divisor."""


COLUMNS = 7
"""Numbers of a mode of WORST_CASE forces: the torsional moment, times the fourth axis; the shortest
force along the normal that it needs; radius of the ball, cosine and sine of the largest angle of
its forces; normal and tangential component of the corner."""

MODES = 6
"""Modes of a level, where contacts are soft; otherwise there is one level of one mode."""


@merged
def _components(axes, u):
    """(z0, z1, z2, tangent, size, z3) of a direction along the axes of a WORST_CASE contact."""
    z0, z1, z2 = dot6(axes[0], u), dot6(axes[1], u), dot6(axes[2], u)
    square = z1 * z1 + z2 * z2
    return z0, z1, z2, math.sqrt(square), math.sqrt(z0 * z0 + square), dot6(axes[3], u)


@merged
def _farthest_mode(row, first, width, z):
    """(support, first column) of the mode of a level that reaches farthest."""
    z0, tangent, size, turning = z[0], z[3], z[4], abs(z[5])
    best, chosen = -math.inf, first
    for k in range(first, first + width, COLUMNS):
        inside = z0 > 0.0 and tangent * row[k + 3] <= z0 * row[k + 4]
        ball = row[k + 2] * (size if inside else row[k + 3] * z0 + row[k + 4] * tangent)
        corner = row[k + 5] * z0 + row[k + 6] * tangent
        height = max(row[k + 1] * z0, ball, corner) + row[k] * turning
        if height > best:
            best, chosen = height, k
    return best, chosen


@merged
def _sure(row, first, z0, tangent):
    """(support, f_normal, f_tangential) of one contact in the mode whose columns start at first."""
    apex = row[first + 1]
    best, normal, tangential = apex * z0, apex, 0.0
    length, cosine, sine = row[first + 2], row[first + 3], row[first + 4]
    if tangent * cosine <= z0 * sine and z0 > 0.0:
        size = math.sqrt(z0 * z0 + tangent * tangent)
        cosine, sine = z0 / size, tangent / size
    height = length * (cosine * z0 + sine * tangent)
    if height > best:
        best, normal, tangential = height, length * cosine, length * sine
    height = row[first + 5] * z0 + row[first + 6] * tangent
    if height > best:
        best, normal, tangential = height, row[first + 5], row[first + 6]
    return best, normal, tangential


@merged
def _possible(spherical, row, z0, tangent):
    """(support, f_normal, f_tangential) over the normals of one contact.

    Args:
        spherical: As in `WrenchSpace`.
        row: Friction; cosine and sine of the tilt; and of the friction angle plus the tilt, which
            is at most pi.
        z0: Component of the direction along the normal.
        tangent: And across it.
    """
    square, turned, aside = row[0] * row[0], row[1], row[2]
    length = math.sqrt(z0 * z0 + tangent * tangent)
    cosine, sine = z0 / max(length, TINY), tangent / max(length, TINY)
    if length == 0.0:
        cosine = 1.0
    if spherical:
        f0, f1 = (cosine, sine) if cosine >= row[3] else (row[3], row[4])
        height = z0 * f0 + tangent * f1
        share = 1.0 if height > 0.0 else 0.0
        return share * height, share * f0, share * f1
    # Of all angles between g and a normal this one would be the best; those between two are left.
    c = 1.0
    if square > TINY:
        c = min(math.sqrt(square / (square * square + square)), 1.0)
    s = math.sqrt(1.0 - c * c)
    if cosine < turned and c > cosine * turned + sine * aside:
        c, s = cosine * turned + sine * aside, sine * turned - cosine * aside
    elif cosine > -turned and c < cosine * turned - sine * aside:
        c, s = cosine * turned - sine * aside, sine * turned + cosine * aside
    slide = row[0] * length * s
    height = length * c + abs(slide)
    slide = math.copysign(row[0], slide) if slide != 0.0 else 0.0
    # Of the normal from the given one, toward g.
    along, across = cosine * c + sine * s, sine * c - cosine * s
    return height, along - slide * across, across + slide * along


@merged
def _width(space):
    """Columns of a level."""
    columns = space.cones.shape[1]
    return MODES * COLUMNS if space.torsion == WORST_CASE and columns > COLUMNS else columns


@merged
def _of_contact(space, i, first, u):
    """(support, force and moment along four axes) of one contact; the level starts at first."""
    row = space.cones[i]
    z = _components(space.axes[i], u)
    z0, z1, z2, tangent, _, z3 = z
    scale, f3 = 1.0 / max(tangent, TINY), 0.0
    if space.torsion == WORST_CASE:
        height, mode = _farthest_mode(row, first, _width(space), z)
        _, f0, across = _sure(row, mode, z0, tangent)
        f3 = math.copysign(row[mode], z3)
        return height, f0, scale * across * z1, scale * across * z2, f3
    height, f0, across = _possible(space.spherical, row, z0, tangent)
    f1, f2 = (scale * across * z1, scale * across * z2) if tangent > 0.0 else (across, 0.0)
    return height, f0, f1, f2, f3


@merged
def _of_group(space, start, first, u):
    """The contact that reaches farthest of those that share a bound, and `_of_contact` of it.

    The contact is -1 where none pushes that way. On a level with moments a contact presses, even
    where that pushes the wrong way.
    """
    best, chosen = -math.inf if space.torsion == WORST_CASE and space.group == 1 else 0.0, -1
    f0 = f1 = f2 = f3 = 0.0
    for i in range(start, min(start + space.group, space.axes.shape[0])):
        found = _of_contact(space, i, first, u)
        if found[0] > best:
            best, f0, f1, f2, f3 = found
            chosen = i
    return chosen, best, f0, f1, f2, f3


@scratch_kernel()
def _best_level(space, u):
    """First column of the level that reaches farthest in a direction."""
    best, chosen, width = -math.inf, 0, _width(space)
    if space.cones.shape[1] == width:
        return 0
    one, two = (
        _components(space.axes[0], u),
        _components(space.axes[1], u),
    )  # soft pairs have levels
    for first in range(0, space.cones.shape[1], width):
        height, _ = _farthest_mode(space.cones[0], first, width, one)
        height += _farthest_mode(space.cones[1], first, width, two)[0]
        if height > best:
            best, chosen = height, first
    return chosen


@scratch_kernel()
def farthest_tilted(space, u, point):
    """Write the farthest wrench (6,) in a direction (6,); returns the support.

    `space` is a `WrenchSpace` of WORST_CASE or BEST_CASE forces.
    """
    clear6(point)
    first, total = _best_level(space, u), 0.0
    for start in range(0, space.axes.shape[0], space.group):
        chosen, height, f0, f1, f2, f3 = _of_group(space, start, first, u)
        total += height
        if chosen < 0:
            continue
        axes = space.axes[chosen]
        for k in range(6):
            point[k] += (f0 * axes[0, k] + f1 * axes[1, k]) + (f2 * axes[2, k] + f3 * axes[3, k])
    return total


@scratch_kernel()
def add_tilted_forces(space, u, weight, forces):
    """Add the contact forces of the farthest wrench, times a weight, to forces (n, 4)."""
    first = _best_level(space, u)
    for start in range(0, space.axes.shape[0], space.group):
        chosen, _, f0, f1, f2, f3 = _of_group(space, start, first, u)
        if chosen >= 0:
            forces[chosen, 0] += weight * f0
            forces[chosen, 1] += weight * f1
            forces[chosen, 2] += weight * f2
            forces[chosen, 3] += weight * f3
