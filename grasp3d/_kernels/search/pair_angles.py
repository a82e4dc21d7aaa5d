"""Angles between the line of two contacts and the normals there.

Two fingers are force-closed where the line between the contacts lies inside both friction cones
(Nguyen 1988).
"""

import math

from grasp3d._kernels.compiling import kernel
from grasp3d._kernels.surface.surface_contacts import largest_angle, smallest_angle
from grasp3d._kernels.surface.vectors import difference, divided, norm, scaled


@kernel("Floats1, FixedFloats2, FixedFloats2, ContactNormals, Floats1, Floats1, Int8s1")
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


@kernel("Floats3, Ints1, Ints1, Floats2, Floats2, Floats2")
def pair_angles(points, start, counts, normals, largest, smallest):
    """Angles between the normals of two contacts and the line from the first to the second.

    Args:
        points: Contacts (b, 2, 3).
        start: First row of each contact's normals (2 b,).
        counts: Number of its normals, 0: every direction (2 b,).
        normals: Inward unit normals (K, 3).
        largest: Written, largest angle of the first contact's normals to the line, and of the
            second one's to the reversed line [rad]; inf where both are at one point (b, 2).
        smallest: Written, the same of the smallest angles (b, 2).
    """
    for g in range(points.shape[0]):
        line = difference(points[g, 1], points[g, 0])
        opening = norm(line)
        if not opening > 0.0:
            largest[g], smallest[g] = math.inf, math.inf
            continue
        x, y, z = divided(line, opening)
        for i in range(2):
            first, count, side = start[2 * g + i], counts[2 * g + i], 1.0 - 2.0 * i
            largest[g, i] = largest_angle(normals, first, count, side * x, side * y, side * z)
            smallest[g, i] = smallest_angle(normals, first, count, side * x, side * y, side * z)
