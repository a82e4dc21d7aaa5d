"""The two families of directions among which epsilon of two hard fingers is found.

Epsilon is the least h(u) / |u| over directions u in the span of the wrenches (Ferrari & Canny 1992;
h the support function), so 1 / epsilon^2 is the largest |u|^2 where h(u) <= 1. With u = (u_f, w),
torques divided by the torque scale, the contact at p_i sees g_i = u_f + w x p_i, and along the line
of the contacts, d, all see the same: g_1.d = g_2.d = t. Those five numbers determine u. The largest
value of a convex function is attained at an extreme point. For cones C_i of less than 90 degrees
{h_i <= 1} is the sum of the unit ball and the polar cone of C_i: a ball that touches a cone from
within, along its rim. Where the cones are not so wide that the two balls can be met at the same t,
at an extreme point one contact, the *front*, sees a g_f on the spherical cap, and g_b of the other,
the *back*, lies on a straight line of the surface of its cone:

    g_b = o + (t - o.d) v,   v.d = 1,

o the apex of that cone, n_b / cos(beta_b), and v its ray at an angle psi about the normal. Where
each finger's force is limited by itself the apex is 0, and besides g_f may be 0.

For a given psi |u|^2 is a convex quadratic function of g_f. For all psi within delta of a given one
the rays lie in the triangle between the two outermost and the line in which the tangent planes
there meet, on which |u|^2 is largest: it is the ray of a slightly wider polar cone, sin(beta) times
cos(delta) for sin(beta).

Coordinates: along d, from the front contact into its cone; along c, the arm from the centre of mass
to the line; and along d x c.
"""

import math
from typing import NamedTuple

from grasp3d._kernels.compiling.decorators import merged, part
from grasp3d._kernels.hull.cap_maximum import Arrow
from grasp3d._kernels.surface.vectors import cross, dot

ON_LINE = 1e-12
"""Distance of the centre of mass from the line, relative to that of the contacts, taken as 0."""

PARALLEL = 1e-12
"""Sine of the angle between a normal and the line below which any tangent will do."""

CLEAR_LENGTH = 1e-4
"""Distance of the contacts relative to that from the centre of mass from which the line through
them is well determined."""

LEAST_OPENING = 1e-9
"""Slope along the line below which a ray of a polar cone never arrives."""


class Side(NamedTuple):
    """Which contact is the front, in the coordinates of the line."""

    arm: float
    """Distance of the centre of mass from the line."""
    inverse: float
    """1 / (s_f - s_b), s the contacts' coordinates along the line."""
    front: float
    """s_f / (s_f - s_b)."""
    normal: tuple[float, float, float]
    """Normal of the front contact."""
    cosine: float
    """Cosine of the half-angle of the front's cap: 1 where a normal component is bounded."""
    back: tuple[float, float, float]
    """Normal of the back contact."""
    first: tuple[float, float, float]
    """Its tangent at psi = 0, toward d."""
    second: tuple[float, float, float]
    """Its other tangent."""
    back_cosine: float
    """Cosine of the half-angle of the back's cone."""
    back_sine: float
    """Sine of it."""
    apex: float
    """Distance of the apex of the back's polar cone along its normal."""


@merged
def triple(values):
    """The first three numbers of a row."""
    return values[0], values[1], values[2]


@merged
def combined(s, a, t, b):
    """Sum of s times a and t times b."""
    return s * a[0] + t * b[0], s * a[1] + t * b[1], s * a[2] + t * b[2]


@merged
def _perpendicular(d):
    """Any unit vector across d."""
    x, y, z = abs(d[0]), abs(d[1]), abs(d[2])
    axis = (1.0, 0.0, 0.0)
    if y <= x and y <= z:
        axis = (0.0, 1.0, 0.0)
    elif z <= x and z <= y:
        axis = (0.0, 0.0, 1.0)
    v = combined(1.0, axis, -dot(axis, d), d)
    return combined(1.0 / math.sqrt(dot(v, v)), v, 0.0, v)


@merged
def point_of(axes):
    """A contact point from its axes (4, 6): the moments of unit forces along a frame there."""
    twice = (0.0, 0.0, 0.0)
    for k in range(3):
        arm = cross(triple(axes[k]), triple(axes[k, 3:]))
        twice = combined(1.0, twice, 1.0, arm)
    return combined(0.5, twice, 0.0, twice)


@merged
def is_long(points, length):
    """Whether the contacts are so far apart that the line through them is well determined."""
    farthest = max(dot(points[0], points[0]), dot(points[1], points[1]))
    return length * length > CLEAR_LENGTH * CLEAR_LENGTH * farthest


@merged
def line_frame(p, q, n):
    """(d, c, d x c, distance of the centre of mass, length): axes of the line through p and q.

    d points to the side of n, the normal at p. Points are divided by the torque scale.
    """
    d = combined(1.0, q, -1.0, p)
    length = math.sqrt(dot(d, d))
    d = combined(math.copysign(1.0 / length, dot(d, n)), d, 0.0, d)
    c = combined(1.0, p, -dot(p, d), d)
    arm = math.sqrt(dot(c, c))
    if arm <= ON_LINE * length:
        arm, c = 0.0, _perpendicular(d)
    else:
        c = combined(1.0 / arm, c, 0.0, c)
        c = combined(1.0, c, -dot(c, d), d)  # again: nearly all may have been subtracted
        c = combined(1.0 / math.sqrt(dot(c, c)), c, 0.0, c)
    return d, c, cross(d, c), arm, length


@merged
def _in_frame(frame, v):
    return dot(frame[0], v), dot(frame[1], v), dot(frame[2], v)


@part
def side_of(frame, points, normals, cones, spherical, f):
    """The side where contact f is the front.

    Args:
        frame: As returned by `line_frame`, from contact f.
        points: Contact points over the torque scale (two triples).
        normals: Inward normals (two triples).
        cones: As in `WrenchSpace` (2, 2).
        spherical: As in `WrenchSpace`.
        f: 0 or 1.
    """
    b = 1 - f
    s_f, s_b = dot(points[f], frame[0]), dot(points[b], frame[0])
    inverse = 1.0 / (s_f - s_b)
    back = _in_frame(frame, normals[b])
    across = math.sqrt(back[1] * back[1] + back[2] * back[2])
    if across > PARALLEL:
        first = (across, -back[0] * back[1] / across, -back[0] * back[2] / across)
    else:
        first = _perpendicular(back)
    size = math.sqrt(cones[b, 0] * cones[b, 0] + cones[b, 1] * cones[b, 1])
    cosine = cones[b, 0] / size
    return Side(
        frame[3],
        inverse,
        s_f * inverse,
        _in_frame(frame, normals[f]),
        cones[f, 0] if spherical else 1.0,
        back,
        first,
        cross(back, first),
        cosine,
        cones[b, 1] / size,
        1.0 / (cosine if spherical else 1.0),
    )


@merged
def aligned_side(side, front_rim, back_rim, spherical):
    """A side with the same line through the centre of mass, and cones about the line.

    Args:
        side: `Side`.
        front_rim: Half-angle of the front's cone [rad].
        back_rim: Half-angle of the back's cone [rad].
        spherical: As in `WrenchSpace`.
    """
    cosine = math.cos(back_rim)
    return Side(
        0.0,
        side.inverse,
        side.front,
        (1.0, 0.0, 0.0),
        math.cos(front_rim) if spherical else 1.0,
        (-1.0, 0.0, 0.0),
        (0.0, 1.0, 0.0),
        (0.0, 0.0, -1.0),
        cosine,
        math.sin(back_rim),
        1.0 / (cosine if spherical else 1.0),
    )


@merged
def ray_at(side, cosine, sine, reduction):
    """(whether it arrives, v, e) of the back's ray at psi: g_b = e + t v, across the line.

    Args:
        side: `Side`.
        cosine: Of psi, the angle of the ray about the back's normal, from `first`.
        sine: Of psi.
        reduction: cos(delta): of the ray in which the tangent planes delta to both sides meet.
    """
    x, y = side.back_cosine * cosine, side.back_cosine * sine
    z = -side.back_sine * reduction
    r0 = x * side.first[0] + y * side.second[0] + z * side.back[0]
    r1 = x * side.first[1] + y * side.second[1] + z * side.back[1]
    r2 = x * side.first[2] + y * side.second[2] + z * side.back[2]
    v1, v2 = r1 / r0, r2 / r0
    a0 = side.apex * side.back[0]
    e1, e2 = side.apex * side.back[1] - a0 * v1, side.apex * side.back[2] - a0 * v2
    return r0 > LEAST_OPENING, v1, v2, e1, e2


@merged
def square_of_direction(side, v1, v2, e1, e2):
    """|u|^2 = g.P g + 2 q.g + r of the front's g, where the back's is e + t v across the line.

    Returns:
        (P, q, r), q of three numbers.
    """
    arm, inverse, front = side.arm, side.inverse, side.front
    rest = 1.0 - front
    turn, slant = inverse * inverse, 1.0 / (1.0 + arm * arm)
    lever = 1.0 - arm * v1 * inverse
    own1, own2 = front * front + turn, slant * front * front + turn
    both1, both2 = front * rest - turn, slant * front * rest - turn
    matrix = Arrow(
        lever * lever + v1 * v1 * own1 + v2 * v2 * own2,
        lever * arm * inverse + v1 * both1,
        v2 * both2,
        arm * arm * turn + rest * rest + turn,
        slant * rest * rest + turn,
    )
    q0 = -lever * arm * inverse * e1 + v1 * e1 * own1 + v2 * e2 * own2
    q1, q2 = e1 * (both1 - arm * arm * turn), e2 * both2
    return matrix, (q0, q1, q2), e1 * e1 * (own1 + arm * arm * turn) + e2 * e2 * own2


@merged
def write_direction(side, frame, g, v, e, out):
    """Write the unit direction u in which the front sees g, and the back e + t v across the line.

    Args:
        side: `Side`.
        frame: As returned by `line_frame`.
        g: (3,) in the frame; v, e: (2,).
        v: Across the line.
        e: Across the line.
        out: Written (6,).
    """
    d, c, across, arm, _ = frame
    t = g[0]
    turn = (g[1] - e[0] - t * v[0]) * side.inverse  # about d x c
    roll = (e[1] + t * v[1] - g[2]) * side.inverse  # about c
    s = side.front / side.inverse
    push = (g[2] + s * roll) / (1.0 + arm * arm)
    square = 0.0
    for k in range(3):
        out[k] = (t + arm * turn) * d[k] + (g[1] - s * turn) * c[k] + push * across[k]
        out[k + 3] = arm * push * d[k] + roll * c[k] + turn * across[k]
        square += out[k] * out[k] + out[k + 3] * out[k + 3]
    for k in range(6):
        out[k] /= math.sqrt(square)
