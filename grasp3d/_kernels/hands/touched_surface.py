"""The surface of an object that hands touch: nearest points with signs and normals, in metres."""

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
    """Those of the tree in few bytes, and a little larger (N, COLUMNS)."""
    closed: bool
    """Whether it bounds a volume; else distances have no sign."""
    corners: Ints2
    """Vertices of each triangle (F, 3)."""
    across: Ints2
    """Triangle beyond the edge opposite each corner, -1: none (F, 3)."""
    outward: Floats2
    """Normals of the face, of its three edges and of its three vertices, which tell outside from
    inside (Baerentzen & Aanaes 2005), outward (F, 21)."""
    inward: Floats2
    """Inward unit normals at the corners, apart at creases (F, 9)."""
    box: Floats1
    """Centre and half lengths of the box around it (6,)."""
    origin: Floats1
    """Node (0, 0, 0) of the grid (3,)."""
    step: float
    values: Float32s3
    """Signed distance at each node (x, y, z)."""
    slots: Int32s3
    """Nearest triangle of each node (x, y, z)."""


@merged
def _box_square(p, box):
    """Squared distance of a point from a box of which the row begins with centre and halves."""
    x = max(abs(p[0] - box[0]) - box[3], 0.0)
    y = max(abs(p[1] - box[1]) - box[4], 0.0)
    z = max(abs(p[2] - box[2]) - box[5], 0.0)
    return x * x + y * y + z * z


@merged
def _disc_square(p, box):
    """Lower bound of the squared distance from what is in a node's ball and in its slab."""
    r = difference(p, box)
    height = dot(triple(box, NORMAL), r)
    aside = math.sqrt(max(dot(r, r) - height * height, 0.0)) - box[RADIUS]
    off = max(abs(height - box[HEIGHT]) - box[THICKNESS], 0.0)
    return off * off + max(aside, 0.0) ** 2


@merged
def _slot_near(p, surface):
    """A triangle near a point: that which is nearest to a node of the grid."""
    slots, origin, step = surface.slots, surface.origin, surface.step
    i = int(min(max((p[0] - origin[0]) / step + 0.5, 0.0), slots.shape[0] - 1.0))
    j = int(min(max((p[1] - origin[1]) / step + 0.5, 0.0), slots.shape[1] - 1.0))
    k = int(min(max((p[2] - origin[2]) / step + 0.5, 0.0), slots.shape[2] - 1.0))
    return slots[i, j, k]


@part
def nearest_triangle(p, reach, surface, nodes, bounds):
    """The triangle that is nearest to a point.

    Args:
        p: The point (3,).
        reach: Square of the largest distance.
        surface: `TouchedSurface`.
        nodes: Scratch (STACK,).
        bounds: Scratch (STACK,).

    Returns:
        The triangle, -1: all are farther away; and its squared distance.
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
    """Barycentric coordinates of the point of a triangle that is nearest to a point."""
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
    """The point of a triangle with barycentric coordinates."""
    return weighted_sum(weights, triple(triangle, 0), triple(triangle, 3), triple(triangle, 6))


@merged
def side_of(weights):
    """0: a point lies in a triangle; 1 to 3: on the edge opposite a corner; 4 to 6: at a corner."""
    zero, last, positive = 0, 0, 0
    for i in range(3):
        if weights[i] > 0.0:
            zero, positive = zero + 1, i
        else:
            last = i
    return 0 if zero == 3 else (1 + last if zero == 2 else 4 + positive)


@part
def is_inside(p, slot, weights, surface):
    """Whether a point is inside, by its nearest triangle and its nearest point there."""
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
    """Lower bound of the signed distance of a point from a surface, from the grid.

    Returns:
        (the bound, an upper bound of the distance without its sign).
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
    """Whether a direction leads away from the surface that is nearest to a point, by the grid.

    Only where that is beyond doubt: distances rise by at least 0.9 of the way, in one direction.
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
    """Write the signed distances at the nodes of a surface's grid.

    Args:
        surface: `TouchedSurface`, of which `values` and `slots` are written.
    """
    nodes, bounds, p = np.empty(STACK, np.int64), np.empty(STACK), np.empty(3)
    values, slot = surface.values, 0
    for i in range(values.shape[0]):
        for j in range(values.shape[1]):
            for k in range(values.shape[2]):
                copy((float(i), float(j), float(k)), p)
                for c in range(3):
                    p[c] = surface.origin[c] + p[c] * surface.step
                surface.slots[i, j, k] = slot  # that of the node before, to begin with
                slot, square = nearest_triangle(p, math.inf, surface, nodes, bounds)
                weights = nearest_weights(p, surface.tree.triangles[slot])
                inside, surface.slots[i, j, k] = is_inside(p, slot, weights, surface), slot
                values[i, j, k] = -math.sqrt(square) if inside else math.sqrt(square)
