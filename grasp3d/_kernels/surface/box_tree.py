"""A tree of boxes over the faces of a surface: what is near a point, a ball or a capsule.

It is like `face_tree`, but has boxes along the axes; slabs across the mean normals, which are thin
around smooth parts in any position; and the faces' corners in the order of the leaves, to be read
consecutively. A capsule is what a ball covers that moves along a segment.
"""

import math
from typing import NamedTuple

import numpy as np

from grasp3d._kernels.compiling import Floats2, Ints1, kernel, merged, part
from grasp3d._kernels.surface.face_tree import (
    GO_ON,
    NO_NODE,
    STACK,
    STOP,
    below,
    divide,
    faces_of_leaf,
    walk,
)
from grasp3d._kernels.surface.vectors import (
    combined,
    cross,
    difference,
    divided,
    dot,
    in_triangle,
    norm,
    triple,
    weighted_sum,
)

LEAF = 2
"""Most faces in a leaf."""

EQUALLY_NEAR = 1e-12
"""Difference of distances due to rounding: among equally near faces the first one counts."""

RADIUS, NORMAL, HEIGHT, THICKNESS, COLUMNS = 6, 7, 10, 11, 12
"""Columns of `BoxTree.boxes` after the centre and the half sizes; and the number of columns."""


class BoxTree(NamedTuple):
    """Boxes around the faces of each node; node i has the children 2 i + 1 and 2 i + 2."""

    depth: int
    """Number of divisions from the root to a leaf."""
    order: Ints1
    """Faces in the order of the leaves (F,)."""
    triangles: Floats2
    """Corners of the faces, in the order of the leaves (F, 9)."""
    boxes: Floats2
    """For the faces of each node: centre and half sizes of their box, radius of the ball about that
    centre; the slab across their mean normal, as this unit vector, the height of its middle above
    the centre, and half its thickness (N, COLUMNS)."""


@kernel("FixedFloats2, FixedInts2")
def box_tree(points, faces):
    """Divide the faces of a surface into a tree.

    Args:
        points: Positions of the vertices (V, 3).
        faces: Vertices of each face (F, 3), at least one.

    Returns:
        The `BoxTree`.
    """
    size = faces.shape[0]
    depth = 0
    while size > (LEAF << depth):
        depth += 1
    centroids = np.empty((size, 3))
    for face in range(size):
        for k in range(3):
            centroids[face, k] = (
                points[faces[face, 0], k] + points[faces[face, 1], k] + points[faces[face, 2], k]
            ) / 3.0
    order = np.arange(size)
    divide(order, centroids, depth)
    triangles = np.empty((size, 9))
    for i in range(size):
        for c in range(3):
            for k in range(3):
                triangles[i, 3 * c + k] = points[faces[order[i], c], k]
    boxes = np.empty(((2 << depth) - 1, COLUMNS))
    for level in range(depth + 1):
        for j in range(1 << level):
            first, last = size * j >> level, size * (j + 1) >> level
            _bound(triangles[first:last], boxes[(1 << level) - 1 + j])
    return BoxTree(depth, order, triangles, boxes)


@kernel()
def _bound(triangles, box):
    """Write bounds that contain some faces in spite of rounding."""
    for k in range(3):
        low, high = math.inf, -math.inf
        for i in range(triangles.shape[0]):
            for c in range(3):
                low, high = min(low, triangles[i, 3 * c + k]), max(high, triangles[i, 3 * c + k])
        box[k] = 0.5 * (low + high)
        box[3 + k] = 0.5 * (high - low) + 1e-12
    normal = _mean_normal(triangles)
    low, high, square = math.inf, -math.inf, 0.0
    for i in range(triangles.shape[0]):
        for c in range(3):
            corner = difference(triple(triangles[i], 3 * c), box)
            height = dot(normal, corner)
            low, high = min(low, height), max(high, height)
            square = max(square, dot(corner, corner))
    box[RADIUS] = math.sqrt(square) + 1e-12
    box[NORMAL], box[NORMAL + 1], box[NORMAL + 2] = normal
    box[HEIGHT], box[THICKNESS] = 0.5 * (low + high), 0.5 * (high - low) + 1e-12


@kernel()
def _mean_normal(triangles):
    """Unit vector along the sum of some faces' area vectors, or any unit vector if that is zero."""
    x, y, z = 0.0, 0.0, 0.0
    for i in range(triangles.shape[0]):
        _, u, w = corner_and_edges(triangles[i])
        x = x + u[1] * w[2] - u[2] * w[1]
        y = y + u[2] * w[0] - u[0] * w[2]
        z = z + u[0] * w[1] - u[1] * w[0]
    length = norm((x, y, z))
    return divided((x, y, z), length) if length >= 1e-100 else (1.0, 0.0, 0.0)


@merged
def height_above(p, box):
    """Signed height of a point above the middle of a node's slab."""
    return dot(triple(box, NORMAL), difference(p, box)) - box[HEIGHT]


@merged
def leaf_rows(node, tree):
    """(first, last), the rows of a leaf in `triangles`; (0, 0) if the node is not a leaf."""
    return faces_of_leaf(node, tree.depth, tree.triangles.shape[0])


@merged
def _clamped(value):
    return min(max(value, 0.0), 1.0)


@merged
def corner_and_edges(triangle):
    """First corner of a triangle of nine numbers, and the edges from it to the other two."""
    a = triple(triangle, 0)
    return a, difference(triple(triangle, 3), a), difference(triple(triangle, 6), a)


@merged
def distance_to_edge(r, u):
    """Squared distance of the point r from the segment from 0 to u."""
    uu = dot(u, u)
    s = _clamped(dot(u, r) / uu) if uu > 0.0 else 0.0
    between = combined(1.0, r, -s, u)
    return dot(between, between)


@merged
def _distance_to_box(p, box):
    """Squared distance of a point from the box of a node."""
    x = max(abs(p[0] - box[0]) - box[3], 0.0)
    y = max(abs(p[1] - box[1]) - box[4], 0.0)
    z = max(abs(p[2] - box[2]) - box[5], 0.0)
    return x * x + y * y + z * z


@part
def triangle_distance(p, triangle):
    """Squared distance of a point from a triangle, nine numbers (Ericson 2005, Sec. 5.1.5)."""
    a, u, w = corner_and_edges(triangle)
    r = difference(p, a)
    ur, wr, uu, uw, ww = dot(u, r), dot(w, r), dot(u, u), dot(u, w), dot(w, w)
    area = uu * ww - uw * uw
    s, t = ww * ur - uw * wr, uu * wr - uw * ur
    if area > 0.0 and s >= 0.0 and t >= 0.0 and s + t <= area:
        between = weighted_sum((1.0, -(s / area), -(t / area)), r, u, w)
        return dot(between, between)
    # Otherwise the nearest point lies on an edge.
    least = min(distance_to_edge(r, u), distance_to_edge(r, w))
    return min(least, distance_to_edge(difference(r, u), difference(w, u)))


@merged
def _visit_with_ball(node, _position, _stale, state):
    """Visit a node; end the walk at a face nearer to a point than a radius."""
    p, radius, tree = state
    box, limit = tree.boxes[node], radius * radius
    if _distance_to_box(p, box) >= limit or abs(height_above(p, box)) - box[THICKNESS] >= radius:
        return NO_NODE, NO_NODE, GO_ON
    first, last = leaf_rows(node, tree)
    for i in range(first, last):
        if triangle_distance(p, tree.triangles[i]) < limit:
            return NO_NODE, NO_NODE, STOP
    later, sooner = below(node, tree.depth)
    return later, sooner, GO_ON


@part
def ball_is_free(px, py, pz, radius, tree, nodes):
    """Whether no face is nearer to a point than a radius.

    Args:
        px: First coordinate of the ball's centre.
        py: Second coordinate.
        pz: Third coordinate.
        radius: Radius of the ball.
        tree: `BoxTree`.
        nodes: Scratch (STACK,).
    """
    state = (px, py, pz), radius, tree
    return radius <= 0.0 or not walk(_visit_with_ball, state, nodes)


@kernel("Floats2, float, int, int, BoxTree, Ints1")
def nearest_faces(points, limit, first, last, tree, found):
    """Find the face nearest to each point.

    Args:
        points: In the frame of the tree (k, 3).
        limit: Largest distance.
        first: First point.
        last: One past the last point.
        tree: `BoxTree`.
        found: Written, the nearest face, the first one if several are equally near; -1 if all are
            farther away (k,).
    """
    nodes = np.empty(STACK, np.int64)
    for k in range(first, last):
        p = triple(points[k], 0)
        least, reach, face = limit, limit * limit, -1
        nodes[0], top = 0, 1
        while top > 0:
            top -= 1
            node = nodes[top]
            if _distance_to_box(p, tree.boxes[node]) > reach:
                continue
            low, high = leaf_rows(node, tree)
            for i in range(low, high):
                square = triangle_distance(p, tree.triangles[i])
                if square > reach:
                    continue
                distance = math.sqrt(square)
                if face < 0 or distance < least - EQUALLY_NEAR or tree.order[i] < face:
                    face = tree.order[i]
                least = min(least, distance)
                reach = (least + EQUALLY_NEAR) ** 2
            one, other = below(node, tree.depth)
            if one == NO_NODE:
                continue
            farther = _distance_to_box(p, tree.boxes[one]) > _distance_to_box(p, tree.boxes[other])
            nodes[top], nodes[top + 1] = (one, other) if farther else (other, one)
            top += 2
        found[k] = face


@part
def _segments_distance(r, u, v):
    """Squared distance of the segment s u from the segment r + t v (Ericson 2005, Sec. 5.1.9)."""
    uu, vv, uv = dot(u, u), dot(v, v), dot(u, v)
    ur, vr = dot(u, r), dot(v, r)
    area = uu * vv - uv * uv
    s = _clamped((ur * vv - vr * uv) / area) if area > 1e-12 * uu * vv else 0.0
    t = _clamped((s * uv - vr) / vv) if vv > 0.0 else 0.0
    s = _clamped((ur + t * uv) / uu) if uu > 0.0 else 0.0
    between = weighted_sum((1.0, t, -s), r, v, u)
    return dot(between, between)


@part
def _crosses(start, end, triangle):
    """Whether a segment crosses a triangle."""
    a, u, w = corner_and_edges(triangle)
    n = cross(u, w)
    one, two = dot(n, difference(start, a)), dot(n, difference(end, a))
    if not ((one < 0.0 < two) or (two < 0.0 < one)):
        return False  # a segment in the plane of the face is near one of its edges or ends
    point = combined(1.0, start, one / (one - two), difference(end, start))
    b1, b2 = in_triangle(difference(point, a), u, w, n)
    return b1 >= 0.0 and b2 >= 0.0 and b1 + b2 <= dot(n, n)


@part
def segment_distance(start, end, triangle):
    """Squared distance of a segment from a triangle of nine numbers."""
    if _crosses(start, end, triangle):
        return 0.0
    least = min(triangle_distance(start, triangle), triangle_distance(end, triangle))
    along = difference(end, start)
    for i in range(3):
        one, other = triple(triangle, 3 * i), triple(triangle, (3 * i + 3) % 9)
        edge = difference(other, one)
        least = min(least, _segments_distance(difference(one, start), along, edge))
    return least


@merged
def _visit_with_capsule(node, _position, _stale, state):
    """Visit a node; end the walk at a face nearer to a segment than a radius."""
    start, end, middle, half, radius, tree = state
    box = tree.boxes[node]
    if _distance_to_box(middle, box) >= (radius + half) ** 2:
        return NO_NODE, NO_NODE, GO_ON
    one, two = height_above(start, box), height_above(end, box)
    if one * two > 0.0 and min(abs(one), abs(two)) - box[THICKNESS] >= radius:
        return NO_NODE, NO_NODE, GO_ON
    first, last = leaf_rows(node, tree)
    for i in range(first, last):
        if segment_distance(start, end, tree.triangles[i]) < radius * radius:
            return NO_NODE, NO_NODE, STOP
    later, sooner = below(node, tree.depth)
    return later, sooner, GO_ON


@part
def capsule_is_free(start, end, radius, tree, nodes):
    """Whether no face is nearer to a segment than a radius.

    Args:
        start: One end of the segment (3,).
        end: The other end (3,).
        radius: Radius of the capsule.
        tree: `BoxTree`.
        nodes: Scratch (STACK,).
    """
    one, other = triple(start, 0), triple(end, 0)
    middle, half = combined(0.5, one, 0.5, other), 0.5 * norm(difference(other, one))
    state = one, other, middle, half, radius, tree
    return radius <= 0.0 or not walk(_visit_with_capsule, state, nodes)
