"""Lines of two contacts: their angles to the normals, and how far uncertain locations turn them.

Contacts within d1 and d2 of their perceived positions, L apart, make the line between them turn by
up to eta = asin((d1 + d2) / L), in every direction. The worst line adds eta to the critical
friction angle; the best one is the minimum, over the cap of lines, of the larger of two angles.
"""

import math

from grasp3d._kernels.compiling.decorators import kernel, merged
from grasp3d._kernels.search.antipodal_candidates import line_turn
from grasp3d._kernels.surface.surface_contacts import largest_angle, smallest_angle
from grasp3d._kernels.surface.vectors import (
    angle_between,
    combined,
    cross,
    difference,
    divided,
    dot,
    norm,
    scaled,
    triple,
)


@kernel
def scan(fixed_point, fixed_normals, points, sets, worst, best, signs):
    """Critical angles of the grasps that one fixed contact makes with every vertex.

    Wan & Howe 2018, Sec. III-B: both signs of the line are evaluated, for grasps that squeeze and
    grasps that expand.

    Args:
        fixed_point: The fixed contact (3,).
        fixed_normals: Its normals, as a set (k, 3).
        points: Positions of the vertices (V, 3).
        sets: `ContactNormals`.
        worst: Written, critical angle over the worst normals [rad] (V,); inf where the contacts
            coincide.
        best: Written, the same over the best normals (V,).
        signs: Written, +1 squeeze, -1 expand, of the worst (V,).
    """
    start, counts, normals = sets.start, sets.counts, sets.normals
    count = fixed_normals.shape[0]
    for v in range(points.shape[0]):
        line = difference(points[v], fixed_point)
        length = norm(line)
        worst[v] = best[v] = math.inf
        signs[v] = 0
        if length < 1e-12 or (counts[v] == 0 and start[v + 1] == start[v]):
            continue
        # Closed form: the critical angle is the larger of the angles between line and normals.
        for sign in (1, -1):
            ex, ey, ez = divided(scaled(sign, line), length)
            high = max(
                largest_angle(fixed_normals, 0, count, ex, ey, ez),
                largest_angle(normals, start[v], counts[v], -ex, -ey, -ez),
            )
            low = max(
                smallest_angle(fixed_normals, 0, count, ex, ey, ez),
                smallest_angle(normals, start[v], counts[v], -ex, -ey, -ez),
            )
            if high < worst[v]:
                worst[v], signs[v] = high, sign
            best[v] = min(best[v], low)


BISECTIONS = 52
"""Halvings of an arc of lines, down to rounding errors."""

OPPOSITE = 1e-8
"""Length of the sum of two unit vectors, up to which they are opposite to each other."""

ALIKE = 1e-12
"""Difference of what is added to two angles, up to which they are compared directly [rad]."""


@kernel
def pair_angles(points, start, counts, normals, largest, smallest, lines, openings):
    """Angles between the normals of two contacts and the line from the first to the second.

    Args:
        points: Contacts (b, 2, 3).
        start: First row of each contact's normals (2 b,).
        counts: Number of its normals, 0: every direction (2 b,).
        normals: Inward unit normals (K, 3).
        largest: Written, largest angle of the first contact's normals to the line, and of the
            second one's to the reversed line [rad]; inf where both are at one point (b, 2).
        smallest: Written, the same of the smallest angles (b, 2).
        lines: Written, unit vectors from the first contact to the second (b, 3).
        openings: Written, distances between the contacts (b,).
    """
    for g in range(points.shape[0]):
        line = difference(points[g, 1], points[g, 0])
        openings[g] = opening = norm(line)
        if not opening > 0.0:
            largest[g], smallest[g], lines[g] = math.inf, math.inf, 0.0
            continue
        x, y, z = divided(line, opening)
        lines[g, 0], lines[g, 1], lines[g, 2] = x, y, z
        for i in range(2):
            first, count, side = start[2 * g + i], counts[2 * g + i], 1.0 - 2.0 * i
            largest[g, i] = largest_angle(normals, first, count, side * x, side * y, side * z)
            smallest[g, i] = smallest_angle(normals, first, count, side * x, side * y, side * z)


@merged
def _tangent(d, m):
    """Unit vector across a line d toward m; any one across d where m is parallel to it."""
    t = combined(1.0, m, -dot(d, m), d)
    if norm(t) < 1e-12:
        t = (0.0, d[2], -d[1]) if abs(d[0]) < 0.6 else (d[1], -d[0], 0.0)
    return divided(t, norm(t))


@merged
def _foot(d, m, sine, cosine):
    """Line in the cap of half-angle (sine, cosine) about a line d that is nearest to m."""
    if dot(d, m) >= cosine:
        return m
    return combined(cosine, d, sine, _tangent(d, m))


@merged
def _crossing(d, m1, m2, sine, cosine):
    """Line on the cap's border with equal angles to m1 and m2, the nearer one of two."""
    w = difference(m1, m2)
    along = dot(w, d)
    w = combined(1.0, w, -along, d)
    length = max(norm(w), 1e-300)
    w = divided(w, length)
    p = cross(d, w)
    c = max(-1.0, min(1.0, -cosine * along / (sine * length)))
    s = math.sqrt((1.0 - c) * (1.0 + c))
    if dot(p, combined(1.0, m1, 1.0, m2)) < 0.0:
        s = -s
    return combined(cosine, d, sine, combined(c, w, s, p))


@merged
def _equal(d, m1, m2, sine, cosine):
    """`smallest_over_lines` where nothing is added to the angles."""
    x = _foot(d, m1, sine, cosine)
    if dot(m1, x) <= dot(m2, x):
        return angle_between(x, m1)
    x = _foot(d, m2, sine, cosine)
    if dot(m2, x) <= dot(m1, x):
        return angle_between(x, m2)
    middle = combined(1.0, m1, 1.0, m2)
    length = norm(middle)
    if length < OPPOSITE:  # every line across both is in balance, and one is in the cap
        return 0.5 * math.pi
    if cosine <= -1.0 or dot(middle, d) >= cosine * length:
        return angle_between(middle, m1)
    return angle_between(_crossing(d, m1, m2, sine, cosine), m1)


@kernel
def _unequal(d, m1, m2, sine, cosine, extra1, extra2):
    """`smallest_over_lines` where different angles are added."""
    x = _foot(d, m1, sine, cosine)
    one = angle_between(x, m1) + extra1
    if one >= angle_between(x, m2) + extra2:
        return one
    x = _foot(d, m2, sine, cosine)
    two = angle_between(x, m2) + extra2
    if two >= angle_between(x, m1) + extra1:
        return two
    # On the shortest way between the normals both are balanced at one line.
    apart = angle_between(m1, m2)
    balanced = 0.5 * (apart + extra1 + extra2)
    middle = combined(1.0, m1, 1.0, m2)
    if cosine <= -1.0 or norm(middle) < OPPOSITE:
        return balanced
    x = combined(math.sin(apart - balanced + extra1), m1, math.sin(balanced - extra1), m2)
    length = norm(x)
    if length > 0.0 and dot(x, d) >= cosine * length:
        return balanced
    # Else they are balanced on the cap's border: from the line nearest to one normal to that
    # nearest to the other, the first angle rises and the second one falls.
    u, v = _tangent(d, m1), _tangent(d, m2)
    turn, w = angle_between(u, v), cross(d, u)
    side = 1.0 if dot(w, v) >= 0.0 else -1.0
    low, high, value = 0.0, turn, math.inf
    for _ in range(BISECTIONS):
        middle_turn = 0.5 * (low + high)
        c, s = sine * math.cos(middle_turn), sine * math.sin(middle_turn)
        x = combined(1.0, combined(cosine, d, c, u), s * side, w)
        one, two = angle_between(x, m1) + extra1, angle_between(x, m2) + extra2
        value = min(value, max(one, two))
        if one < two:
            low = middle_turn
        else:
            high = middle_turn
    return value


@kernel
def smallest_over_lines(d, m1, m2, sine, extra1, extra2):
    """Smallest value, over a cap of lines, of the larger of two angles with additions.

    Args:
        d: The cap's axis, a unit vector as three numbers.
        m1: First unit vector, three numbers.
        m2: Second unit vector, three numbers.
        sine: Sine of the cap's half-angle, up to a right angle; above 1: every line is possible.
        extra1: Added to the angle between a line and the first vector [rad].
        extra2: The same for the second vector [rad].

    Returns:
        The value [rad].
    """
    cosine = -1.0 if sine > 1.0 else math.sqrt((1.0 - sine) * (1.0 + sine))
    sine = 0.0 if sine > 1.0 else sine
    if abs(extra1 - extra2) < ALIKE:
        return _equal(d, m1, m2, sine, cosine) + max(extra1, extra2)
    return _unequal(d, m1, m2, sine, cosine, extra1, extra2)


@kernel
def locate_pairs(
    critical, critical_best, openings, openings_best, angles, angles_best, lines, normals, single,
    location, worst_extras, best_extras, located, located_best,
):  # fmt: skip
    """Critical angles of pairs of contacts that include what is not known about their contacts.

    Args:
        critical: Critical angles over the worst normals [rad] (b,).
        critical_best: The same over the best normals (b,).
        openings: Distances between the contacts of the grasps of `critical` (b,).
        openings_best: The same of the grasps of `critical_best`, which may be others (b,).
        angles: Largest and smallest angles between normals and lines of the grasps of `critical`,
            see `pair_angles` (2, b, 2).
        angles_best: The same of the grasps of `critical_best` (2, b, 2).
        lines: Lines from the first to the second contact of the latter (b, 3).
        normals: First normal and reversed second one of the same (b, 2, 3).
        single: Whether both contacts have these normals alone; else the best is bounded (b,).
        location: Sum of the location errors of both contacts, (b,) or (1,).
        worst_extras: Added to the worst angle of each contact [rad], (b, 2) or (1, 2).
        best_extras: Added to the best angle of each contact [rad], (b, 2) or (1, 2).
        located: Written, over the worst normals, lines and fingers [rad] (b,).
        located_best: Written, over the best ones (b,).
    """
    for g in range(critical.shape[0]):
        row = g if location.shape[0] > 1 else 0
        error = location[row]
        one, two = worst_extras[row, 0], worst_extras[row, 1]
        if critical[g] == math.inf:
            located[g] = math.inf
        else:
            angle = critical[g]
            if one != 0.0 or two != 0.0:
                squeezing = max(angles[0, g, 0] + one, angles[0, g, 1] + two)
                expanding = max(math.pi - angles[1, g, 0] + one, math.pi - angles[1, g, 1] + two)
                angle = min(squeezing, expanding)
            located[g] = angle + line_turn(error, openings[g]) if error > 0.0 else angle
        one, two = best_extras[row, 0], best_extras[row, 1]
        if critical_best[g] == math.inf:
            located_best[g] = math.inf
            continue
        if error == 0.0 and one == 0.0 and two == 0.0:
            located_best[g] = critical_best[g]
            continue
        value = math.inf
        turn = math.pi if error > openings_best[g] else line_turn(error, openings_best[g])
        for sign in (1.0, -1.0):
            first, second = angles_best[1, g, 0], angles_best[1, g, 1]
            if sign < 0.0:
                first, second = math.pi - angles_best[0, g, 0], math.pi - angles_best[0, g, 1]
            # No line in the cap is nearer to any normal by more than its turn.
            bound = max(max(first - turn, 0.0) + one, max(second - turn, 0.0) + two)
            if bound < value and single[g]:
                bound = smallest_over_lines(
                    scaled(sign, lines[g]), triple(normals[g, 0], 0), triple(normals[g, 1], 0),
                    error / openings_best[g], one, two,
                )  # fmt: skip
            value = min(value, bound)
        located_best[g] = value
