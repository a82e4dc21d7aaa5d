"""The best contact on a face: cutting planes over its barycentric coordinates.

The contacts of a face at which both angles are at most a limit form a nearly convex region. A
polygon that contains it is cut at a point inside: along the cone of half-angle `limit` about the
vertex's normal, and along the tangent of the region in which the other angle is below it. Where the
point is better than the limit, its angle is the new limit. An empty polygon proves that the face
has nothing better, for most faces after one point; on others the next point is that of Newton's
method, or the polygon's centroid.

The line to a point of the face, and the normal there before it has unit length, are linear in two
of the point's barycentric coordinates.
"""

import math

from grasp3d._kernels.compiling import merged, part
from grasp3d._kernels.search.antipodal_candidates import SMALLEST_OPENING
from grasp3d._kernels.search.face_contacts import INSIDE
from grasp3d._kernels.surface.polygons import centroid, cut, stays_inside
from grasp3d._kernels.surface.vectors import (
    combined,
    copy,
    difference,
    divided,
    dot,
    norm,
    triple,
    weighted_sum,
)


@part
def worst_normal(own, line, worst):
    """Write the vertex's normal that is farthest from a unit vector; returns their cosine.

    Args:
        own: Normals of the vertex (k, 3).
        line: The vector, three numbers.
        worst: Written (3,), unless there are none.
    """
    count = own.shape[0]
    if count == 0:
        return 1.0
    least, row = 2.0, 0
    for i in range(count):
        cosine = dot(own[i], line)
        if cosine < least:
            least, row = cosine, i
    copy(own[row], worst)
    return least


@merged
def own_derivatives(cosine, normal, unit, opening, u, w):
    """The cosine to the vertex's normal, its two first and its three second derivatives.

    Args:
        cosine: The cosine.
        normal: The normal (3,).
        unit: Unit vector along the line, three numbers.
        opening: Its length.
        u: Derivative of the line by the first coordinate.
        w: That by the second one.
    """
    along_u, along_w = dot(unit, u), dot(unit, w)
    a = (dot(normal, u) - cosine * along_u) / opening
    b = (dot(normal, w) - cosine * along_w) / opening
    uu, uw, ww = (
        dot(u, u) - along_u * along_u, dot(u, w) - along_u * along_w, dot(w, w) - along_w * along_w
    )  # fmt: skip
    return (
        cosine,
        a,
        b,
        -(2.0 * a * along_u + cosine * uu / opening) / opening,
        -(a * along_w + b * along_u + cosine * uw / opening) / opening,
        -(2.0 * b * along_w + cosine * ww / opening) / opening,
    )


@merged
def other_derivatives(cosine, line, normal, opening, length, u, w, p, q):
    """The same of the cosine between the reversed line and the face's normal.

    Args:
        cosine: The cosine.
        line: The line, three numbers.
        normal: The normal, not of unit length.
        opening: Length of the line.
        length: Length of the normal.
        u: Derivative of the line by the first coordinate.
        w: That by the second one.
        p: Derivative of the normal by the first coordinate.
        q: That by the second one.
    """
    du, dw = dot(line, u) / opening, dot(line, w) / opening
    mp, mq = dot(normal, p) / length, dot(normal, q) / length
    # The cosine is -(line . normal) / r, r being the product of both lengths.
    r = opening * length
    rx, ry = du * length + opening * mp, dw * length + opening * mq
    lines, normals = length / opening, opening / length
    rxx = (dot(u, u) - du * du) * lines + 2.0 * du * mp + (dot(p, p) - mp * mp) * normals
    rxy = (dot(u, w) - du * dw) * lines + du * mq + dw * mp + (dot(p, q) - mp * mq) * normals
    ryy = (dot(w, w) - dw * dw) * lines + 2.0 * dw * mq + (dot(q, q) - mq * mq) * normals
    a = -(dot(p, line) + dot(normal, u) + cosine * rx) / r
    b = -(dot(q, line) + dot(normal, w) + cosine * ry) / r
    return (
        cosine,
        a,
        b,
        -(2.0 * dot(p, u) + 2.0 * a * rx + cosine * rxx) / r,
        -(dot(p, w) + dot(q, u) + a * ry + b * rx + cosine * rxy) / r,
        -(2.0 * dot(q, w) + 2.0 * b * ry + cosine * ryy) / r,
    )


@merged
def step_to_equal(a, b):
    """Newton's step to the largest minimum of two functions; (0, 0): none.

    Where both are equal there, each counts so much that the gradients cancel.

    Args:
        a: Value, two first and three second derivatives of one function.
        b: Those of the other one.
    """
    nx, ny = a[1] - b[1], a[2] - b[2]
    square = nx * nx + ny * ny
    part = -(b[1] * nx + b[2] * ny) / square if square > 0.0 else 0.5
    if square > 0.0 and 0.0 < part < 1.0:
        rest = 1.0 - part
        hxx, hxy = part * a[3] + rest * b[3], part * a[4] + rest * b[4]
        hyy = part * a[5] + rest * b[5]
        along, tx, ty = (b[0] - a[0]) / square, -ny, nx
        curvature = tx * (hxx * tx + hxy * ty) + ty * (hxy * tx + hyy * ty)
        if curvature >= 0.0:
            return 0.0, 0.0
        mixed = tx * (hxx * nx + hxy * ny) + ty * (hxy * nx + hyy * ny)
        across = -(tx * b[1] + ty * b[2] + along * mixed) / curvature
        return along * nx + across * tx, along * ny + across * ty
    one = a if part >= 1.0 else b
    determinant = one[3] * one[5] - one[4] * one[4]
    if one[3] >= 0.0 or determinant <= 0.0:
        return 0.0, 0.0
    return (
        (one[4] * one[2] - one[5] * one[1]) / determinant,
        (one[4] * one[1] - one[3] * one[2]) / determinant,
    )


RESOLVED = 1e-7
"""Decrease of an angle that is not searched for [rad]."""

MOST_POINTS = 60
"""Most points of a face at which its angles are computed."""

LOOSE = 1.5
"""Factor of the decreases that linear bounds leave possible, as angles are not linear."""

BENT = 0.15
"""Difference of two corners' normals from which a face is divided: there the contacts within a
limit need not form a convex region."""

MOST_PARTS = 8
"""Most parts of an edge of a divided face."""

ANYWHERE, BEYOND = False, True
"""Whether only contacts beyond a plane that touches the ball of the smallest opening count."""

MOST_TANGENTS = 12
"""Most planes beside the ball of the smallest opening that are tried from each start."""

ROUNDING = 1e-12
"""Opening by which contacts in such a plane may be too near."""


@merged
def _farthest(polygon, size, x, y):
    """Squared distance from a point to the farthest corner of a polygon."""
    square = 0.0
    for i in range(size):
        square = max(square, (polygon[i, 0] - x) ** 2 + (polygon[i, 1] - y) ** 2)
    return square


@part
def best_on_face(weights, cosine, lines, normals, own, limits, polygon, nearest):
    """Find the contact on a face with the smallest critical angle, if that is below a limit.

    Args:
        weights: Barycentric coordinates from which the search starts (3,); those of the best
            contact are written where one was found.
        cosine: Cosine of the limit, not below 0.
        lines: Lines from the vertex to the corners (3, 3).
        normals: Normals at the corners (3, 3).
        own: Normals of the vertex (k, 3).
        limits: `PairLimits`.
        polygon: Scratch (2 * REGION_CORNERS, 3).
        nearest: Scratch (3,).

    Returns:
        Cosine of the smallest critical angle found, or `cosine` where there is none below it.
    """
    smallest, limit, others = limits.smallest, cosine, (lines, normals, own)
    cosine = _best_in_region(
        weights, cosine, *others, 0.0, limits.largest, ANYWHERE, polygon, nearest
    )
    if smallest <= SMALLEST_OPENING or not cosine > limit:
        return cosine
    if norm(weighted_sum(weights, lines[0], lines[1], lines[2])) >= smallest:
        return cosine
    # The best contact is too near, and those that are not form no convex region: each part of it
    # that a plane leaves is searched, and then that beside the best contact there. Every part that
    # the ball of the smallest opening leaves apart has a corner of the face.
    found, cosine = triple(weights, 0), 0.0
    for start in range(4):
        if start > 0:
            for k in range(3):
                weights[k] = 1.0 - 2.0 * INSIDE if k == start - 1 else INSIDE
        own_cosine = 0.0
        for _ in range(MOST_TANGENTS):
            better = _best_in_region(
                weights, own_cosine, *others, smallest, limits.largest, BEYOND, polygon, nearest
            )
            gain, own_cosine = better - own_cosine, better  # the cosine of `weights`, to the last
            if not gain > RESOLVED:
                break
        if own_cosine > cosine:
            cosine, found = own_cosine, triple(weights, 0)
    copy(found, weights)
    return max(cosine, limit)


@part
def _best_in_region(
    weights, cosine, lines, normals, own, smallest, largest, beyond, polygon, nearest
):  # fmt: skip
    """`best_on_face` where contacts within the limits of openings form a convex region.

    With `beyond`: only of those beyond the plane that touches the ball of the smallest opening in
    the direction of the starting point.
    """
    start, n = triple(lines[0], 0), triple(normals[0], 0)
    u, w = difference(lines[1], start), difference(lines[2], start)
    p, q = difference(normals[1], n), difference(normals[2], n)
    bend = math.sqrt(max(dot(p, p), dot(q, q)) * max(dot(u, u), dot(w, w)))
    for i in range(3):
        polygon[i, 0] = 1.0 - 2.0 * INSIDE if i == 1 else INSIDE
        polygon[i, 1] = 1.0 - 2.0 * INSIDE if i == 2 else INSIDE
    size = weights.shape[0]  # 3 corners
    x, y, previous = weights[1], weights[2], 1.0
    sine = math.sqrt(max(1.0 - cosine * cosine, 0.0))
    for number in range(MOST_POINTS):
        line = weighted_sum((1.0, x, y), start, u, w)
        normal = weighted_sum((1.0, x, y), n, p, q)
        opening, length = norm(line), norm(normal)
        if opening < 1e-6 or length < 1e-12:
            return cosine
        product = dot(normal, line)
        other = -product / (opening * length)
        unit = divided(line, opening)
        first, own_normal = worst_normal(own, unit, nearest), triple(nearest, 0)
        along_u, along_w = dot(unit, u), dot(unit, w)
        ahead = along_u * x + along_w * y
        if beyond and number == 0:
            constant = smallest - opening + ahead
            size, _ = cut(polygon, size, -along_u, -along_w, constant)
        if opening > largest:
            size, _ = cut(polygon, size, along_u, along_w, opening - largest - ahead)
        elif opening >= smallest - ROUNDING and min(first, other) > cosine:
            cosine = min(first, other)
            sine = math.sqrt(max(1.0 - cosine * cosine, 0.0))
            weights[0], weights[1], weights[2] = 1.0 - x - y, x, y
            if sine < RESOLVED:
                return cosine
        reach = 1.0
        # From the vector across the normal: from the cosine, small sines would be rounding errors.
        across = combined(1.0, unit, -first, own_normal)
        first_sine = norm(across)
        if size > 2 and first < 1.0 and first_sine > 1e-9:
            # The plane through the vertex that touches the cone about the normal below the point.
            h = combined(cosine / first_sine, across, -sine, own_normal)
            size, least = cut(polygon, size, dot(h, u), dot(h, w), dot(h, start))
            turn = max(min(-LOOSE * least / opening, sine), -1.0)
            reach = cosine * math.sqrt(1.0 - turn * turn) + sine * turn
        if size > 2:
            # The region is where cosine |line| |normal| + line . normal is not positive.
            a = cosine * (along_u * length + opening * dot(normal, p) / length)
            a += dot(p, line) + dot(normal, u)
            b = cosine * (along_w * length + opening * dot(normal, q) / length)
            b += dot(q, line) + dot(normal, w)
            value = cosine * opening * length + product
            slack = bend * (1.0 - cosine + sine) * _farthest(polygon, size, x, y)
            value = max(value - slack, 0.0) if other <= cosine else value - slack
            size, least = cut(polygon, size, a, b, value - a * x - b * y)
            reach = min(reach, cosine - LOOSE * least / (opening * length))
        if size < 3 or sine <= RESOLVED or reach <= cosine + RESOLVED * sine:
            return cosine
        gain, sx, sy = reach - cosine, 0.0, 0.0
        if gain < 0.5 * previous and opening <= largest:
            two = other_derivatives(other, line, normal, opening, length, u, w, p, q)
            one = two
            if first < 1.0:
                one = own_derivatives(first, own_normal, unit, opening, u, w)
            sx, sy = step_to_equal(one, two)
        previous = gain
        if (sx != 0.0 or sy != 0.0) and stays_inside(polygon, size, x + sx, y + sy):
            x, y = x + sx, y + sy
        else:
            x, y = centroid(polygon, size)
    return cosine


@merged
def _mix(rows, weights, mixed):
    """Write combinations of three rows, one for each row of weights (3, 3)."""
    for i in range(3):
        copy(weighted_sum(weights[i], rows[0], rows[1], rows[2]), mixed[i])


@part
def best_on_bent_face(weights, cosine, lines, normals, own, limits, parts, polygon, nearest, part):
    """`best_on_face` of each part of a face whose edges are divided.

    Args:
        weights: Written (3,) where a contact was found.
        cosine: See `best_on_face`, as those that are not described here.
        lines: The same.
        normals: The same.
        own: The same.
        limits: The same.
        parts: Parts of each edge.
        polygon: Scratch.
        nearest: Scratch.
        part: Scratch: lines, normals and weights of a part's corners (3, 3) each, weights (3,).

    Returns:
        Cosine of the smallest critical angle found, or `cosine`.
    """
    part_lines, part_normals, corners, inside = part
    size = (1.0 - 3.0 * INSIDE) / parts
    for row in range(parts):
        for column in range(2 * (parts - row) - 1):
            i, up = column // 2, column % 2
            for c in range(3):
                # Corners (i, row), (i + 1, row), (i, row + 1), or the other half of the square.
                x = i + (c == 1) if up == 0 else i + (c != 2)
                y = row + (c == 2) if up == 0 else row + (c != 0)
                corners[c, 1], corners[c, 2] = INSIDE + size * x, INSIDE + size * y
                corners[c, 0] = 1.0 - corners[c, 1] - corners[c, 2]
            _mix(lines, corners, part_lines)
            _mix(normals, corners, part_normals)
            inside[0], inside[1], inside[2] = 1.0 / 3.0, 1.0 / 3.0, 1.0 / 3.0
            better = best_on_face(
                inside, cosine, part_lines, part_normals, own, limits, polygon, nearest
            )
            if better > cosine:
                cosine = better
                for k in range(3):
                    weights[k] = 0.0
                    for c in range(3):
                        weights[k] += inside[c] * corners[c, k]
    return cosine
