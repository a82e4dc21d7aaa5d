"""The lowest point of a few planes, with a cone about the origin added."""

import math

from grasp3d._kernels.compiling.decorators import kernel

PARALLEL = 1e-14
"""Determinant, relative to the squares of slopes, below which lines do not meet."""

TIED = 1e-13
"""Difference of heights that rounding makes: of points that are equally low the first counts."""


@kernel
def lowest_point(planes, number, reach, slope):
    """Minimise max over planes of (a + b u + c v) + slope * |(u, v)| for |u|, |v| <= reach.

    The smallest value is at a corner of the square, down a plane from the origin, on a side of the
    square or the line where two planes meet (where they meet each other, or where the cone balances
    the slope along them), where three planes meet, or at the origin.

    Args:
        planes: Values at the origin a, and slopes b and c (at least `number`, 3).
        number: Number of planes.
        reach: Half-width of the square, above 0.
        slope: Slope of the cone, at least 0.

    Returns:
        (smallest value, u, v).
    """
    best = _height(planes, number, slope, 0.0, 0.0), 0.0, 0.0
    for corner in (-reach, reach):
        best = _lower(planes, number, slope, corner, reach, reach, best)
        best = _lower(planes, number, slope, corner, -reach, reach, best)
    for i in range(number):
        b, c = planes[i, 1], planes[i, 2]
        most = max(abs(b), abs(c))
        if most > 0.0:
            best = _lower(planes, number, slope, -reach * b / most, -reach * c / most, reach, best)
        for edge in (-reach, reach):
            best = _lower(planes, number, slope, edge, _balanced(c, slope, reach), reach, best)
            best = _lower(planes, number, slope, _balanced(b, slope, reach), edge, reach, best)
        for j in range(i):
            best = _on_line(planes, number, slope, i, j, reach, best)
    return best


@kernel
def _height(planes, number, slope, u, v):
    """The function that is minimised."""
    height = -math.inf
    for i in range(number):
        height = max(height, planes[i, 0] + planes[i, 1] * u + planes[i, 2] * v)
    return height + slope * math.hypot(u, v)


@kernel
def _lower(planes, number, slope, u, v, reach, best):
    """The lower of the best point and another one, if that is in the square."""
    if not (abs(u) <= reach and abs(v) <= reach):
        return best
    height = _height(planes, number, slope, u, v)
    return (height, u, v) if height < best[0] - TIED else best


@kernel
def _balanced(along, slope, distance):
    """Where the cone balances a slope along a line, from the point of it nearest to the origin.

    inf: nowhere.
    """
    if slope <= abs(along):
        return math.inf
    return -distance * along / math.sqrt(slope * slope - along * along)


@kernel
def _on_line(planes, number, slope, i, j, reach, best):
    """The best point so far, or a better one on the line where two planes meet."""
    a, b, c = (
        planes[i, 0] - planes[j, 0],
        planes[i, 1] - planes[j, 1],
        planes[i, 2] - planes[j, 2],
    )
    square = b * b + c * c
    if square == 0.0:
        return best
    for edge in (-reach, reach):
        if c != 0.0:
            best = _lower(planes, number, slope, edge, -(a + b * edge) / c, reach, best)
        if b != 0.0:
            best = _lower(planes, number, slope, -(a + c * edge) / b, edge, reach, best)
    # The point of the line nearest to the origin, and the slope of the planes along it.
    u, v, length = -a * b / square, -a * c / square, math.sqrt(square)
    along = (planes[i, 2] * b - planes[i, 1] * c) / length
    t = _balanced(along, slope, math.hypot(u, v))
    best = _lower(planes, number, slope, u - t * c / length, v + t * b / length, reach, best)
    for k in range(j):
        best = _at_corner(planes, number, slope, a, b, c, i, k, reach, best)
    return best


@kernel
def _at_corner(planes, number, slope, a, b, c, i, k, reach, best):
    """The best point so far, or a better one where a third plane meets the line a + b u + c v."""
    d, e, f = (
        planes[i, 0] - planes[k, 0],
        planes[i, 1] - planes[k, 1],
        planes[i, 2] - planes[k, 2],
    )
    determinant = b * f - c * e
    if abs(determinant) <= PARALLEL * (abs(b) + abs(c)) * (abs(e) + abs(f)):
        return best
    u, v = (c * d - a * f) / determinant, (a * e - b * d) / determinant
    return _lower(planes, number, slope, u, v, reach, best)
