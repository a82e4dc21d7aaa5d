"""The surface of an object that hands touch: nearest points, signs and normals, in metres."""

import math
from typing import NamedTuple

import numpy as np

from grasp3d._kernels.compiling import (
    Float32s2,
    Float32s3,
    Floats1,
    Floats2,
    Int32s3,
    Ints2,
    kernel,
    merged,
    part,
)
from grasp3d._kernels.surface.box_tree import (
    HEIGHT,
    NORMAL,
    RADIUS,
    THICKNESS,
    BoxTree,
    leaf_rows,
    triangle_distance,
)
from grasp3d._kernels.surface.face_tree import STACK, below
from grasp3d._kernels.surface.vectors import (
    combined,
    copy,
    difference,
    dot,
    norm,
    triple,
    weighted_sum,
)


class TouchedSurface(NamedTuple):
    """Triangles in the order of a tree's leaves, and signed distances at the nodes of a grid."""

    tree: BoxTree
    boxes: Float32s2
    """Boxes of the tree in single precision, slightly enlarged (N, COLUMNS)."""
    closed: bool
    """Whether the surface bounds a volume; otherwise distances have no sign."""
    corners: Ints2
    """Vertices of each triangle (F, 3)."""
    across: Ints2
    """Triangle across the edge opposite each corner, -1 for none (F, 3)."""
    outward: Floats2
    """Outward normals of the face, of its three edges and of its three vertices, which separate
    outside from inside (Baerentzen & Aanaes 2005) (F, 21)."""
    inward: Floats2
    """Inward unit normals at the corners, separate on each side of a crease (F, 9)."""
    box: Floats1
    """Centre and half lengths of the bounding box (6,)."""
    origin: Floats1
    """Position of node (0, 0, 0) of the grid (3,)."""
    step: float
    values: Float32s3
    """Signed distance at each node (x, y, z)."""
    slots: Int32s3
    """Nearest triangle of each node (x, y, z)."""


@merged
def _box_square(p, box):
    """Squared distance of a point from a box whose row begins with its centre and half lengths."""
    x = max(abs(p[0] - box[0]) - box[3], 0.0)
    y = max(abs(p[1] - box[1]) - box[4], 0.0)
    z = max(abs(p[2] - box[2]) - box[5], 0.0)
    return x * x + y * y + z * z


@merged
def _disc_square(p, box):
    """Lower bound of a point's squared distance from what lies in a node's ball and slab."""
    r = difference(p, box)
    height = dot(triple(box, NORMAL), r)
    aside = math.sqrt(max(dot(r, r) - height * height, 0.0)) - box[RADIUS]
    off = max(abs(height - box[HEIGHT]) - box[THICKNESS], 0.0)
    return off * off + max(aside, 0.0) ** 2


@merged
def _slot_near(p, surface):
    """A triangle near a point: the one nearest to the closest node of the grid."""
    slots, origin, step = surface.slots, surface.origin, surface.step
    i = int(min(max((p[0] - origin[0]) / step + 0.5, 0.0), slots.shape[0] - 1.0))
    j = int(min(max((p[1] - origin[1]) / step + 0.5, 0.0), slots.shape[1] - 1.0))
    k = int(min(max((p[2] - origin[2]) / step + 0.5, 0.0), slots.shape[2] - 1.0))
    return slots[i, j, k]


@part
def nearest_triangle(p, reach, surface, nodes, bounds):
    """Find the triangle nearest to a point.

    Args:
        p: The point (3,).
        reach: Square of the largest distance.
        surface: `TouchedSurface`.
        nodes: Scratch (STACK,).
        bounds: Scratch (STACK,).

    Returns:
        The triangle, -1 if all are farther away, and its squared distance.
    """
    tree, best, slot = surface.tree, -1, _slot_near(p, surface)
    square = triangle_distance(p, tree.triangles[slot])
    if square <= reach:
        best, reach = slot, square
    nodes[0], bounds[0], top = 0, 0.0, 1
    while top > 0:
        top -= 1
        if bounds[top] >= reach:
            continue
        node = nodes[top]
        first, last = leaf_rows(node, tree)
        if last > first and _disc_square(p, surface.boxes[node]) >= reach:
            continue
        for i in range(first, last):
            square = triangle_distance(p, tree.triangles[i])
            if square < reach:
                best, reach = i, square
        one, other = below(node, tree.depth)
        if one < 0:
            continue
        near, far = _box_square(p, surface.boxes[one]), _box_square(p, surface.boxes[other])
        if near > far:
            one, other, near, far = other, one, far, near
        if far < reach:
            nodes[top], bounds[top] = other, far
            top += 1
        if near < reach:
            nodes[top], bounds[top] = one, near
            top += 1
    return best, reach


@merged
def _along(r, u):
    uu = dot(u, u)
    return min(max(dot(u, r) / uu, 0.0), 1.0) if uu > 0.0 else 0.0


@part
def nearest_weights(p, triangle):
    """Barycentric coordinates of the point of a triangle nearest to a given point."""
    a, b, c = triple(triangle, 0), triple(triangle, 3), triple(triangle, 6)
    r, u, w = difference(p, a), difference(b, a), difference(c, a)
    ur, wr, uu, uw, ww = dot(u, r), dot(w, r), dot(u, u), dot(u, w), dot(w, w)
    area = uu * ww - uw * uw
    s, t = ww * ur - uw * wr, uu * wr - uw * ur
    if area > 0.0 and s > 0.0 and t > 0.0 and s + t < area:
        return 1.0 - (s + t) / area, s / area, t / area
    s = _along(r, u)
    between = combined(1.0, r, -s, u)
    least, weights = dot(between, between), (1.0 - s, s, 0.0)
    s = _along(r, w)
    between = combined(1.0, r, -s, w)
    if dot(between, between) < least:
        least, weights = dot(between, between), (1.0 - s, 0.0, s)
    r, u = difference(p, b), difference(c, b)
    s = _along(r, u)
    between = combined(1.0, r, -s, u)
    if dot(between, between) < least:
        weights = (0.0, 1.0 - s, s)
    return weights


@merged
def point_of(weights, triangle):
    """Point of a triangle at given barycentric coordinates."""
    return weighted_sum(weights, triple(triangle, 0), triple(triangle, 3), triple(triangle, 6))


@merged
def side_of(weights):
    """0 for a point within a triangle, 1 to 3 on the edge opposite a corner, 4 to 6 at a corner."""
    zero, last, positive = 0, 0, 0
    for i in range(3):
        if weights[i] > 0.0:
            zero, positive = zero + 1, i
        else:
            last = i
    return 0 if zero == 3 else (1 + last if zero == 2 else 4 + positive)


@part
def is_inside(p, slot, weights, surface):
    """Whether a point is inside, given its nearest triangle and the nearest point's weights."""
    if not surface.closed:
        return False
    between = difference(p, point_of(weights, surface.tree.triangles[slot]))
    return dot(between, triple(surface.outward[slot], 3 * side_of(weights))) < 0.0


@merged
def inward_at(slot, weights, surface):
    """Inward unit normal at a point of a triangle."""
    row = surface.inward[slot]
    n = weighted_sum(weights, triple(row, 0), triple(row, 3), triple(row, 6))
    length = norm(n)
    if length < 1e-6:
        n = triple(surface.outward[slot], 0)
        return -n[0], -n[1], -n[2]
    return n[0] / length, n[1] / length, n[2] / length


@part
def least_distance(p, surface):
    """Lower bound of a point's signed distance from a surface, from the grid.

    Returns:
        (that bound, an upper bound of the unsigned distance).
    """
    values, origin, step = surface.values, surface.origin, surface.step
    i = int(min(max((p[0] - origin[0]) / step + 0.5, 0.0), values.shape[0] - 1.0))
    j = int(min(max((p[1] - origin[1]) / step + 0.5, 0.0), values.shape[1] - 1.0))
    k = int(min(max((p[2] - origin[2]) / step + 0.5, 0.0), values.shape[2] - 1.0))
    x = p[0] - origin[0] - i * step
    y = p[1] - origin[1] - j * step
    z = p[2] - origin[2] - k * step
    away = math.sqrt(x * x + y * y + z * z) + 1e-6 * step
    bound, most = values[i, j, k] - away, abs(values[i, j, k]) + away
    outside = _box_square(p, surface.box)
    return (max(bound, math.sqrt(outside)) if outside > 0.0 else bound), most


@part
def faces_away(p, outward, surface):
    """Whether a direction leads away from the surface nearest to a point, according to the grid.

    True only beyond doubt: the grid's distances rise at 0.9 or more per unit, in one direction.
    """
    values, origin, step = surface.values, surface.origin, surface.step
    i = int(min(max((p[0] - origin[0]) / step + 0.5, 1.0), values.shape[0] - 2.0))
    j = int(min(max((p[1] - origin[1]) / step + 0.5, 1.0), values.shape[1] - 2.0))
    k = int(min(max((p[2] - origin[2]) / step + 0.5, 1.0), values.shape[2] - 2.0))
    x = values[i + 1, j, k] - values[i - 1, j, k]
    y = values[i, j + 1, k] - values[i, j - 1, k]
    z = values[i, j, k + 1] - values[i, j, k - 1]
    rise, along = math.sqrt(x * x + y * y + z * z), dot(outward, (x, y, z))
    return surface.closed and rise > 1.8 * step and along > 0.2 * rise


@kernel("TouchedSurface")
def fill_grid(surface):
    """Write the signed distance and the nearest triangle at each node of a surface's grid.

    Args:
        surface: `TouchedSurface`, whose `values` and `slots` are written.
    """
    nodes, bounds, p = np.empty(STACK, np.int64), np.empty(STACK), np.empty(3)
    values, slot = surface.values, 0
    for i in range(values.shape[0]):
        for j in range(values.shape[1]):
            for k in range(values.shape[2]):
                copy((float(i), float(j), float(k)), p)
                for c in range(3):
                    p[c] = surface.origin[c] + p[c] * surface.step
                surface.slots[i, j, k] = slot  # initial guess: that of the previous node
                slot, square = nearest_triangle(p, math.inf, surface, nodes, bounds)
                weights = nearest_weights(p, surface.tree.triangles[slot])
                inside, surface.slots[i, j, k] = is_inside(p, slot, weights, surface), slot
                values[i, j, k] = -math.sqrt(square) if inside else math.sqrt(square)
