"""Both cosines of the grasps of a vertex with the points of a face, and their derivatives.

The line to a point of the face, and the normal there before it has unit length, are linear in two
of the point's barycentric coordinates.
"""

import math

from grasp3d._kernels.compiling.decorators import merged, part
from grasp3d._kernels.surface.vectors import dot


@part
def _nearest_normal(own, count, x, y, z, nearest):
    """Write the normal of a polygon that is nearest to a unit vector; returns their cosine."""
    greatest, inside = -2.0, True
    for i in range(1 if count == 2 else count):
        height = own[i, 3] * x + own[i, 4] * y + own[i, 5] * z
        if count > 2 and height >= 0.0:  # inside a polygon all its sides are passed on the left
            continue
        inside = False
        after = own[i, 6] * x + own[i, 7] * y + own[i, 8] * z
        before = own[i, 9] * x + own[i, 10] * y + own[i, 11] * z
        if after >= 0.0 and before >= 0.0:
            cosine = math.sqrt(max(1.0 - height * height, 1e-300))
            if cosine > greatest:
                greatest = cosine
                nearest[0] = (x - height * own[i, 3]) / cosine
                nearest[1] = (y - height * own[i, 4]) / cosine
                nearest[2] = (z - height * own[i, 5]) / cosine
            continue
        for j in (i, (i + 1) % count):
            cosine = own[j, 0] * x + own[j, 1] * y + own[j, 2] * z
            if cosine > greatest:
                greatest = cosine
                nearest[0], nearest[1], nearest[2] = own[j, 0], own[j, 1], own[j, 2]
    return 1.0 if inside else greatest


@part
def decisive_normal(own, count, worst, x, y, z, nearest):
    """Write the vertex's normal that decides about a unit vector; returns their cosine.

    Args:
        own: The vertex's normals, see `read_own`.
        count: Their number.
        worst: Whether the farthest normal decides, or the nearest one.
        x: The vector.
        y: Its second coordinate.
        z: Its third one.
        nearest: Written (3,), unless the vector is between the normals or there are none.
    """
    if count == 0:
        return 1.0
    if not worst and count != 1:
        return _nearest_normal(own, count, x, y, z, nearest)
    least, row = 2.0, 0
    for i in range(count):
        cosine = own[i, 0] * x + own[i, 1] * y + own[i, 2] * z
        if cosine < least:
            least, row = cosine, i
    nearest[0], nearest[1], nearest[2] = own[row, 0], own[row, 1], own[row, 2]
    return least


@merged
def moved(start, one, other, x, y):
    """Start + x one + y other."""
    return (
        start[0] + x * one[0] + y * other[0],
        start[1] + x * one[1] + y * other[1],
        start[2] + x * one[2] + y * other[2],
    )


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
