"""The largest value of a convex quadratic function on a cap of the unit sphere, with proof.

Maximise g.P g + 2 q.g over unit vectors g with n.g >= c. With multipliers m > largest eigenvalue of
P, for the length, and k >= 0, for the cap, (m - P) g = q + k n gives the dual bound

    m + (q + k n).g - 2 k c,

which no value on the cap exceeds, whatever the multipliers (as for trust regions: More & Sorensen
1983). For each m the best k is 0 where g is within the cap, else that with n.g = c. The bound is
then a convex function of m, least where g has unit length, which Newton's method on 1 / |g| finds;
g, on the cap, attains it.

P is an arrow: of its entries beside the diagonal only those in the first row and column are not 0.
"""

import math
from typing import NamedTuple

from grasp3d._kernels.compiling import merged, part

MAX_STEPS = 40
"""Most steps of Newton's method; any of them yields a bound."""

UNIT = 1e-6
"""Error of |g|^2 at which it ends: that of the bound is of second order."""

NO_SLOPE = 1e-12
"""Size of q, relative to P, below which the maximum is at an eigenvector."""

LEAST_STEP = 1e-10
"""Relative width of an interval of multipliers at which the search for the best ends."""

TINY = 1e-300
"""Smallest divisor."""


class Arrow(NamedTuple):
    """A symmetric matrix of three rows of which (1, 2) is 0."""

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
    """Value of the quadratic function, of triples q and g."""
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
    """The largest eigenvalue from above, where the characteristic polynomial is convex."""
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
    """The unit vector of the cap in the half-plane of n and g, g's own where that is on it."""
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
        start: Multiplier m to start from, for instance that of a similar function; 0: none.
        enough: Bound that need not be improved.

    Returns:
        (bound, multiplier, g): a value that no g on the cap exceeds, and one on the cap;
        it mostly attains the bound, but need not where the function has several maxima.
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
            # The length of g, or of its part across n, where the other is given.
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
