"""Epsilon of two hard fingers with circular cones, by branch and bound over one angle.

Epsilon is the least h(u) / |u| over directions u in the span of the wrenches (Ferrari & Canny 1992;
h the support function), so 1 / epsilon^2 is the largest |u|^2 where h(u) <= 1. With u = (u_f, w),
torques divided by the torque scale, the contact at p_i sees g_i = u_f + w x p_i. Along the line of
the contacts, d, both see the same: g_1.d = g_2.d = t. These five numbers determine u. A convex
function attains its largest value at an extreme point. For cones C_i of less than 90 degrees
{h_i <= 1} is the sum of the unit ball and the polar cone of C_i: a ball that touches a cone from
within, along its rim. Unless the cones are so wide that the two balls can be met at the same t, at
an extreme point one contact, the *front*, sees a g_f on the spherical cap, and g_b of the other,
the *back*, lies on a straight line of the surface of its cone:

    g_b = o + (t - o.d) v,   v.d = 1,

where o is the apex of that cone, n_b / cos(beta_b), and v its ray at an angle psi about the normal.
Where the force of each finger is limited separately, the apex is 0, and g_f may also be 0.

For a given psi, |u|^2 is a convex quadratic function of g_f, whose maximum `largest_on_cap` finds
with proof. Intervals of psi are divided until none can hold a direction that matters: the bound of
an interval exceeds its value by the square of its width. For all psi within delta of a given one,
the rays lie in the triangle between the two outermost ones and the line in which the tangent planes
there meet. |u|^2 is largest on that line, which is the ray of a slightly wider polar cone, with
sin(beta) cos(delta) in place of sin(beta).

Coordinates: along d, from the front contact into its cone; along c, the arm from the centre of mass
to the line; and along d x c.

The module also finds the largest value of a convex quadratic function on a cap of the unit sphere:
maximise g.P g + 2 q.g over unit vectors g with n.g >= c. With multipliers m > largest eigenvalue of
P, for the length, and k >= 0, for the cap, (m - P) g = q + k n gives the dual bound

    m + (q + k n).g - 2 k c,

which no value on the cap exceeds, whatever the multipliers (compare trust regions: More & Sorensen
1983). For each m the best k is 0 if g is within the cap, otherwise that with n.g = c. The bound is
then a convex function of m and least where g has unit length. Newton's method on 1 / |g| finds that
m; g, moved onto the cap, attains the bound.

P is an arrow: off the diagonal, only entries in the first row and column are not 0.
"""

import math
from typing import NamedTuple

import numpy as np

from grasp3d._kernels.compiling import Floats1, Floats2, Ints1, merged, part, scratch_kernel
from grasp3d._kernels.hull.growing_hull import CONVERGED
from grasp3d._kernels.hull.support_functions import PER_FINGER
from grasp3d._kernels.hull.wrench_problem import CLOSED
from grasp3d._kernels.surface.vectors import angle_between, combined, cross, dot

MAX_STEPS = 40
"""Most steps of Newton's method; any number of them yields a bound."""

UNIT = 1e-6
"""Error of |g|^2 at which the search ends; the bound's error is of second order in it."""

NO_SLOPE = 1e-12
"""Size of q, relative to P, below which an eigenvector is the maximum."""

LEAST_STEP = 1e-10
"""Relative width of an interval of multipliers at which the search for the best one ends."""

TINY = 1e-300
"""Smallest divisor."""


class Arrow(NamedTuple):
    """A symmetric 3 x 3 matrix whose entry (1, 2) is 0."""

    corner: float
    """Entry (0, 0)."""
    arm1: float
    """Entry (0, 1)."""
    arm2: float
    """Entry (0, 2)."""
    diagonal1: float
    """Entry (1, 1)."""
    diagonal2: float
    """Entry (2, 2)."""


@merged
def _solved(matrix, m, b0, b1, b2):
    """(whether m - P is positive definite, solution x of (m - P) x = b)."""
    d1, d2 = m - matrix.diagonal1, m - matrix.diagonal2
    x1, x2 = matrix.arm1 / d1, matrix.arm2 / d2
    rest = m - matrix.corner - matrix.arm1 * x1 - matrix.arm2 * x2
    t = (b0 + x1 * b1 + x2 * b2) / rest
    return min(d1, d2, rest) > 0.0, t, b1 / d1 + x1 * t, b2 / d2 + x2 * t


@merged
def value_at(matrix, q, g):
    """Value of the quadratic function at g; q and g are triples."""
    corner = matrix.corner * g[0] + 2.0 * (matrix.arm1 * g[1] + matrix.arm2 * g[2] + q[0])
    one, two = matrix.diagonal1 * g[1] + 2.0 * q[1], matrix.diagonal2 * g[2] + 2.0 * q[2]
    return corner * g[0] + one * g[1] + two * g[2]


@merged
def _above_eigenvalues(matrix):
    """An upper bound of the eigenvalues, by Gershgorin's circles."""
    a1, a2 = abs(matrix.arm1), abs(matrix.arm2)
    return max(matrix.corner + a1 + a2, matrix.diagonal1 + a1, matrix.diagonal2 + a2)


@merged
def _largest_eigenvalue(matrix):
    """Largest eigenvalue, approached from above, where the characteristic polynomial is convex."""
    m = _above_eigenvalues(matrix)
    s1, s2 = matrix.arm1 * matrix.arm1, matrix.arm2 * matrix.arm2
    for _ in range(MAX_STEPS):
        d0, d1, d2 = m - matrix.corner, m - matrix.diagonal1, m - matrix.diagonal2
        value = d0 * d1 * d2 - s1 * d2 - s2 * d1
        slope = d1 * d2 + d0 * d2 + d0 * d1 - s1 - s2
        step = value / max(slope, TINY)
        if not step > LEAST_STEP * m:
            break
        m -= step
    return m * (1.0 + 2.0 * LEAST_STEP)


@merged
def _top_eigenvector(matrix, m, n0, n1, n2):
    """The unit eigenvector of the largest eigenvalue m, on the side of n."""
    x1 = matrix.arm1 / max(m - matrix.diagonal1, TINY)
    x2 = matrix.arm2 / max(m - matrix.diagonal2, TINY)
    scale = 1.0 / math.sqrt(1.0 + x1 * x1 + x2 * x2)
    scale = math.copysign(scale, n0 + n1 * x1 + n2 * x2)
    return scale, scale * x1, scale * x2


@merged
def _nearest_in_cap(g0, g1, g2, n0, n1, n2, c):
    """Unit vector of the cap in the half-plane of n and g: that along g if it is on the cap."""
    scale = 1.0 / math.sqrt(max(g0 * g0 + g1 * g1 + g2 * g2, TINY))
    along = n0 * g0 + n1 * g1 + n2 * g2
    if along * scale >= c:
        return scale * g0, scale * g1, scale * g2
    r0, r1, r2 = g0 - along * n0, g1 - along * n1, g2 - along * n2
    scale = math.sqrt((1.0 - c * c) / max(r0 * r0 + r1 * r1 + r2 * r2, TINY))
    return c * n0 + scale * r0, c * n1 + scale * r1, c * n2 + scale * r2


@part
def largest_on_cap(matrix, q, n, c, start, enough):
    """The largest value of g.P g + 2 q.g on the cap of unit vectors g with n.g >= c.

    Args:
        matrix: P, positive semidefinite.
        q: Three numbers.
        n: Three numbers, of unit length.
        c: Cosine of the cap's half-angle, from above 0 to below 1.
        start: Multiplier m to start from, for instance that of a similar function; 0 if none.
        enough: Bound that need not be improved.

    Returns:
        (bound, multiplier, g): a value that no g on the cap exceeds, and a g on the cap that
        usually attains it, but may not where the function has several maxima.
    """
    q0, q1, q2 = q
    n0, n1, n2 = n
    size = math.sqrt(q0 * q0 + q1 * q1 + q2 * q2)
    above = _above_eigenvalues(matrix)
    if size <= NO_SLOPE * above:
        m = _largest_eigenvalue(matrix)
        g0, g1, g2 = _top_eigenvector(matrix, m, n0, n1, n2)
        if n0 * g0 + n1 * g1 + n2 * g2 >= c:
            return m + 2.0 * size, m, (g0, g1, g2)
    low, high, bound = max(matrix.corner, matrix.diagonal1, matrix.diagonal2), math.inf, math.inf
    m = start if start > low else above + size
    g0, g1, g2, flat = n0, n1, n2, 1.0 - c * c
    for _ in range(MAX_STEPS):
        definite, x0, x1, x2 = _solved(matrix, m, q0, q1, q2)
        if definite:
            k, along, target = 0.0, n0 * x0 + n1 * x1 + n2 * x2, 1.0
            if along < c:  # the multiplier of the cap puts g on the plane of the rim
                _, b0, b1, b2 = _solved(matrix, m, n0, n1, n2)
                per_k = n0 * b0 + n1 * b1 + n2 * b2
                k, target = (c - along) / per_k, flat
                x0, x1, x2 = x0 + k * b0, x1 + k * b1, x2 + k * b2
            g0, g1, g2 = x0, x1, x2
            bound = min(bound, m + q0 * g0 + q1 * g1 + q2 * g2 - k * c)
            # The length of g, or of its part across n where n.g is fixed.
            square = g0 * g0 + g1 * g1 + g2 * g2 - (1.0 - target)
            if abs(square - target) <= UNIT * target or bound <= enough:
                break
            _, h0, h1, h2 = _solved(matrix, m, g0, g1, g2)
            slope = g0 * h0 + g1 * h1 + g2 * h2
            if k > 0.0:
                change = n0 * h0 + n1 * h1 + n2 * h2
                slope -= change * change / per_k
            low, high = (m, high) if square > target else (low, m)
            m += (math.sqrt(max(square, 0.0) / target) - 1.0) * square / slope
        else:
            low = max(low, m)
            m = low
        if high - low < LEAST_STEP * high:
            break
        if not low < m < high:
            m = 0.5 * (low + high) if high < math.inf else 2.0 * (low + above + size)
    return bound, m, _nearest_in_cap(g0, g1, g2, n0, n1, n2, c)


ON_LINE = 1e-12
"""Distance of the centre of mass from the line, relative to that of the contacts, taken as 0."""

PARALLEL = 1e-12
"""Sine of the angle between a normal and the line below which any tangent will do."""

CLEAR_LENGTH = 1e-4
"""Distance between the contacts, relative to their distance from the centre of mass, above which
the line through them is well determined."""

LEAST_OPENING = 1e-9
"""Slope along the line below which a ray of a polar cone counts as parallel to it."""


class Side(NamedTuple):
    """The choice of the front contact, in the coordinates of the line."""

    arm: float
    """Distance of the centre of mass from the line."""
    inverse: float
    """1 / (s_f - s_b), with s the contacts' coordinates along the line."""
    front: float
    """s_f / (s_f - s_b)."""
    normal: tuple[float, float, float]
    """Normal of the front contact."""
    cosine: float
    """Cosine of the half-angle of the front's cap; 1 where the normal component is bounded."""
    back: tuple[float, float, float]
    """Normal of the back contact."""
    first: tuple[float, float, float]
    """Tangent of the back contact at psi = 0, toward d."""
    second: tuple[float, float, float]
    """The other tangent of the back contact."""
    back_cosine: float
    """Cosine of the half-angle of the back's cone."""
    back_sine: float
    """Sine of the half-angle of the back's cone."""
    apex: float
    """Distance of the apex of the back's polar cone along its normal."""


@merged
def triple(values):
    """The first three numbers of a row."""
    return values[0], values[1], values[2]


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
    """A contact point from its axes (4, 6), the moments of unit forces along a frame there."""
    twice = (0.0, 0.0, 0.0)
    for k in range(3):
        arm = cross(triple(axes[k]), triple(axes[k, 3:]))
        twice = combined(1.0, twice, 1.0, arm)
    return combined(0.5, twice, 0.0, twice)


@merged
def is_long(points, length):
    """Whether the contacts are far enough apart to determine the line through them."""
    farthest = max(dot(points[0], points[0]), dot(points[1], points[1]))
    return length * length > CLEAR_LENGTH * CLEAR_LENGTH * farthest


@merged
def _largest_wrench(points):
    """Upper bound of the length of all wrenches of unit forces at two points."""
    return math.sqrt(1.0 + max(dot(points[0], points[0]), dot(points[1], points[1])))


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
        c = combined(1.0, c, -dot(c, d), d)  # again, as nearly all may have cancelled
        c = combined(1.0 / math.sqrt(dot(c, c)), c, 0.0, c)
    return d, c, cross(d, c), arm, length


@merged
def _in_frame(frame, v):
    return dot(frame[0], v), dot(frame[1], v), dot(frame[2], v)


@part
def side_of(frame, points, normals, cones, spherical, f):
    """The `Side` on which contact f is the front.

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
    """A side with the centre of mass on the line and both cones about the line.

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
    """(whether it arrives, v, e) of the back's ray at psi, g_b = e + t v across the line.

    Args:
        side: `Side`.
        cosine: Cosine of psi, the angle of the ray about the back's normal, from `first`.
        sine: Sine of psi.
        reduction: cos(delta), for the ray where the tangent planes at psi +/- delta meet.
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
    """|u|^2 = g.P g + 2 q.g + r as a function of the front's g; the back's is e + t v.

    Returns:
        (P, q, r), where q has three numbers.
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
    """Write the unit direction u in which the front sees g and the back e + t v across the line.

    Args:
        side: `Side`.
        frame: As returned by `line_frame`.
        g: What the front sees, in the frame (3,).
        v: Across the line (2,).
        e: Across the line (2,).
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


FIRST_INTERVALS = 6
"""Number of intervals of psi at the start."""

MOST_PARTS = 8
"""Most parts into which an interval is divided at once."""

MAX_INTERVALS = 30_000
"""Number of intervals after which a pair is left to the growing hull."""

CLEAR_ANGLE = 1e-6
"""Angle between the line of the contacts and the rim of a friction cone [rad] above which force
closure is certain despite rounding."""

ROUNDING = 1e-14
"""Relative error of the bounds due to rounding."""

RANK = 5
"""Dimension of the wrenches of two hard fingers, which lack the torque about their line."""

SMALLEST_FRICTION = 1e-6
"""Least tangential component of a force on a cone's rim; below it the rank may be lower."""


class PairScratch(NamedTuple):
    """Scratch of one thread."""

    intervals: Floats2
    """Stack of intervals: middle, half width, bound and value (k, 4)."""
    best: Floats1
    """The best direction: value, front, g (3), v (2), e (2); and the last multiplier found by
    `largest_on_cap` (10,)."""
    starts: Ints1
    """First row of each side's intervals in the stack (2,)."""


def make_pair_scratch() -> PairScratch:
    """Allocate scratch for any number of pairs."""
    return PairScratch(np.zeros((512, 4)), np.zeros(10), np.zeros(2, dtype=np.int64))


@merged
def _keep(best, value, front, g, v1, v2, e1, e2):
    """Keep a direction if it is better than all before."""
    if value > best[0]:
        best[0], best[1] = value, front
        best[2], best[3], best[4] = g
        best[5], best[6], best[7], best[8] = v1, v2, e1, e2


@part
def _examined(side, front, per_finger, cosine, sine, reduction, factor, best):
    """(bound, value) of |u|^2: the bound over an interval of psi, the value at its middle.

    The bound is inf if rays of the outer cone never arrive. Where the bound alone decides the
    interval, the value is 0; otherwise `best` is updated.
    """
    bound, g = 0.0, side.normal
    for outer in (True, False):
        arrives, v1, v2, a1, a2 = ray_at(side, cosine, sine, reduction if outer else 1.0)
        if not arrives:
            bound = math.inf
            continue
        e1, e2 = (0.0, 0.0) if per_finger else (a1, a2)
        matrix, q, rest = square_of_direction(side, v1, v2, e1, e2)
        most, enough = -math.inf, factor * best[0] - rest
        if side.cosine < 1.0 and (outer or bound == math.inf):
            most, m, g = largest_on_cap(matrix, q, side.normal, side.cosine, best[9], enough)
            best[9] = m
        here = rest + value_at(matrix, q, g)
        alone = 0.0
        if per_finger:  # the front may see 0
            _, _, alone = square_of_direction(side, v1, v2, a1, a2)
        if outer:
            bound = max(most + rest, here, alone)
            if bound <= factor * best[0]:
                break
        else:
            _keep(best, here, front, g, v1, v2, e1, e2)
            _keep(best, alone, front, (0.0, 0.0, 0.0), v1, v2, a1, a2)
            return bound, max(here, alone)
    return bound, 0.0


@merged
def _divided(side, front, per_finger, middle, half, parts, factor, scratch, size, largest):
    """Examine the parts of an interval, and stack the undecided ones.

    Returns:
        (size of the stack, largest bound of decided intervals).
    """
    intervals, best = scratch.intervals, scratch.best
    narrow = half / parts
    reduction = math.cos(narrow)
    turn_cosine, turn_sine = math.cos(2.0 * narrow), math.sin(2.0 * narrow)
    psi = middle - half + narrow
    cosine, sine = math.cos(psi), math.sin(psi)
    for _ in range(parts):
        bound, value = _examined(side, front, per_finger, cosine, sine, reduction, factor, best)
        if bound <= factor * best[0]:
            largest = max(largest, bound)
        else:
            row = intervals[size]
            row[0], row[1], row[2], row[3] = psi, narrow, bound, value
            size += 1
        psi += 2.0 * narrow
        cosine, sine = (
            cosine * turn_cosine - sine * turn_sine,
            sine * turn_cosine + cosine * turn_sine,
        )
    return size, largest


@merged
def _parts(bound, value, goal):
    """Number of parts of an interval, as bounds approach values with the square of the width."""
    if bound == math.inf or value >= goal:
        return np.int64(2)
    parts = math.ceil(math.sqrt((bound - value) / (goal - value)))
    return np.int64(min(max(parts, 2), MOST_PARTS))


@part
def _searched(side, front, per_finger, factor, first, size, largest, scratch):
    """Divide the stacked intervals of a side; return (whether all are decided, largest bound)."""
    intervals, best = scratch.intervals, scratch.best
    count = 0
    while size > first:
        size -= 1
        middle, half, bound, value = intervals[size]
        goal = factor * best[0]
        if bound <= goal:
            largest = max(largest, bound)
            continue
        parts = _parts(bound, value, goal)
        count += parts
        if count > MAX_INTERVALS or size + parts > intervals.shape[0]:
            return False, largest
        size, largest = _divided(
            side, front, per_finger, middle, half, parts, factor, scratch, size, largest
        )
    return True, largest


@part
def _nearly_symmetric(sides, angles, spherical, per_finger, factor, scratch):
    """(largest bound of |u|^2, whether it is close enough) for a nearly symmetric pair.

    A cone contains a cone about the line whose half-angle is smaller by the angle of the normal to
    the line. A centre of mass at a distance a from the line changes epsilon by a factor of at most
    (a + sqrt(a^2 + 4)) / 2 (see `quality.uncertain_epsilon`). About the line all psi are alike.
    """
    best, largest = scratch.best, 0.0
    for f in range(2):
        front, back = angles[f], angles[1 - f]
        aligned = aligned_side(sides[f], front[1] - front[0], back[1] - back[0], spherical)
        best[0] = 0.0  # only the bound is needed
        bound, _ = _examined(aligned, 0.0, per_finger, 1.0, 0.0, 1.0, 1.0, best)
        largest = max(largest, bound)
    best[0] = 0.0
    for f in range(2):
        _examined(sides[f], 1.0 * f, per_finger, 1.0, 0.0, 1.0, 1.0, best)
    stretch = 0.5 * (sides[0].arm + math.sqrt(sides[0].arm * sides[0].arm + 4.0))
    largest *= stretch * stretch
    return largest, largest <= factor * best[0]


@merged
def _angles_of(d, normal, cone):
    """(angle from d to a normal, half-angle of the cone about it) [rad]."""
    return angle_between(normal, d), math.atan2(cone[1], cone[0])


@merged
def _is_regular(form, angles):
    """Whether this module's families of directions are the only ones."""
    kind, spherical, _, _ = form
    one, two = angles[0][0] + angles[0][1], angles[1][0] + angles[1][1]
    if kind == PER_FINGER:
        return max(one, two) < 0.5 * math.pi - CLEAR_ANGLE
    return not spherical or one + two < math.pi - CLEAR_ANGLE


@part
def _separated(frames, points, normals, cones, spherical, direction):
    """Find a direction (6,) in which no wrench has a positive component; return whether one exists.

    If neither sense of the line lies in one of the cones, that contact can see a direction across
    the line, away from its normal, while the other sees nothing. If the cones of both hold the same
    sense, each contact sees its reversed normal.
    """
    zero = (0.0, 0.0)
    for f in range(2):
        frame = frames[f]
        side = side_of(frame, points, normals, cones, spherical, f)
        n, b = side.normal, side.back
        across = math.sqrt(n[1] * n[1] + n[2] * n[2])
        rim = math.atan2(cones[f, 1], cones[f, 0])
        if math.atan2(across, n[0]) - rim > CLEAR_ANGLE:
            g = (0.0, -n[1] / across, -n[2] / across)
            write_direction(side, frame, g, zero, zero, direction)
            return True
        if f == 0:
            angle = math.atan2(math.sqrt(b[1] * b[1] + b[2] * b[2]), b[0])
            if math.atan2(cones[1, 1], cones[1, 0]) - angle > CLEAR_ANGLE:
                g = (-1.0, -n[1] / n[0], -n[2] / n[0])
                write_direction(side, frame, g, zero, (-b[1] / b[0], -b[2] / b[0]), direction)
                return True
    return False


@merged
def _largest_square(sides, angles, spherical, per_finger, factor, scratch):
    """(whether found, bound of the largest |u|^2); writes the best u to `scratch.best`."""
    asymmetry = sides[0].arm + max(
        angles[0][0] / math.tan(angles[0][1]), angles[1][0] / math.tan(angles[1][1])
    )
    if asymmetry < 0.5 * (factor - 1.0):
        largest, near = _nearly_symmetric(sides, angles, spherical, per_finger, factor, scratch)
        if near:
            return True, largest
    scratch.best[0], size, largest, done = 0.0, np.int64(0), 0.0, True
    parts = np.int64(FIRST_INTERVALS)
    for f in range(2):
        scratch.starts[f] = size
        size, largest = _divided(
            sides[f], 1.0 * f, per_finger, 0.0, math.pi, parts, factor, scratch, size, largest
        )
    for f in range(1, -1, -1):
        first = scratch.starts[f]
        if done:
            done, largest = _searched(
                sides[f], 1.0 * f, per_finger, factor, first, size, largest, scratch
            )
            size = first
    return done, largest


@part
def _epsilon(form, frames, points, normals, cones, angles, rtol, scratch, direction):
    """(whether found, lower, upper) of one force-closed pair; writes its direction (6,)."""
    kind, spherical, _, _ = form
    per_finger, best = kind == PER_FINGER, scratch.best
    best[9] = 0.0
    sides = (
        side_of(frames[0], points, normals, cones, spherical, np.int64(0)),
        side_of(frames[1], points, normals, cones, spherical, np.int64(1)),
    )
    factor = 1.0 / ((1.0 - rtol) * (1.0 - rtol))
    done, largest = _largest_square(sides, angles, spherical, per_finger, factor, scratch)
    if not done:
        return False, 0.0, 0.0
    f = int(best[1])
    write_direction(
        sides[f], frames[f], triple(best[2:5]), (best[5], best[6]), (best[7], best[8]), direction
    )
    largest = max(best[0], largest)
    return True, (1.0 - ROUNDING) / math.sqrt(largest), (1.0 + ROUNDING) / math.sqrt(best[0])


@scratch_kernel(
    "tuple[int, bool, bool, int], Floats4, Floats2, Floats3, float, PairScratch, Results, Bools1"
)
def pair_epsilons(form, wrenches, tangential, cones, rtol, scratch, results, left):
    """Epsilon of pairs of hard fingers with circular cones, where it is clear whether they close.

    Args:
        form: As in `wrench_problem.epsilons`.
        wrenches: Axes of the contacts (b, 2, 4, 6).
        tangential: As in `wrench_problem.epsilons` (b, 2).
        cones: As in `WrenchSpace` (b, 2, 2).
        rtol: Largest gap between the bounds, relative to the upper one.
        scratch: `PairScratch`.
        results: `Results`.
        left: Written, whether a pair is left to the growing hull (b,).
    """
    for g in range(wrenches.shape[0]):
        left[g] = True
        axes = wrenches[g]
        points = (point_of(axes[0]), point_of(axes[1]))
        normals = (triple(axes[0, 0]), triple(axes[1, 0]))
        frames = (
            line_frame(points[0], points[1], normals[0]),
            line_frame(points[1], points[0], normals[1]),
        )
        if not (
            is_long(points, frames[0][4])
            and min(tangential[g, 0], tangential[g, 1]) > SMALLEST_FRICTION
            and min(cones[g, 0, 0], cones[g, 1, 0]) > 0.0
            and min(cones[g, 0, 1], cones[g, 1, 1]) >= 0.0
        ):
            continue
        d = frames[0][0]
        back = combined(-1.0, d, 0.0, d)
        angles = (_angles_of(d, normals[0], cones[g, 0]), _angles_of(back, normals[1], cones[g, 1]))
        inside = min(angles[0][1] - angles[0][0], angles[1][1] - angles[1][0])
        closed, lower, upper = inside > CLEAR_ANGLE, 0.0, 0.0
        if closed and _is_regular(form, angles):
            decided, lower, upper = _epsilon(
                form, frames, points, normals, cones[g], angles, rtol, scratch,
                results.direction[g],
            )  # fmt: skip
        else:
            decided = inside < -CLEAR_ANGLE and _separated(
                frames, points, normals, cones[g], form[1], results.direction[g]
            )
        # Where force closure is within rounding errors, the tolerances of hulls decide.
        if not decided or (closed and lower <= CLOSED * _largest_wrench(points)):
            continue
        left[g] = False
        results.lower[g], results.upper[g] = min(lower, upper), upper
        results.rank[g], results.status[g], results.closed[g] = RANK, CONVERGED, closed
