"""A tree of boxes over the faces of a surface: what is near a ball or a capsule.

Like `face_tree`, but with boxes along the axes, with slabs across the mean normals, which are thin
about smooth parts in any position, and with the faces' corners in the order of the leaves, which
are read one after the other. A capsule is what a ball covers that moves along a segment.
"""

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from grasp3d._kernels.compiling.decorators import kernel, merged, part
from grasp3d._kernels.surface.face_tree import (
    GO_ON,
    NO_NODE,
    STOP,
    below,
    divide,
    faces_of_leaf,
    walk,
)

LEAF = 2
"""Most faces of a leaf."""

RADIUS, NORMAL, HEIGHT, THICKNESS, COLUMNS = 6, 7, 10, 11, 12
"""Columns of `BoxTree.boxes` behind the centre and the half sizes; and their number."""


class BoxTree(NamedTuple):
    """Boxes around the faces of each node; node i has the children 2 i + 1 and 2 i + 2."""

    depth: int
    """Divisions from the root to a leaf."""
    triangles: npt.NDArray[np.float64]
    """Corners of the faces, in the order of the leaves (F, 9)."""
    boxes: npt.NDArray[np.float64]
    """Of the faces of each node: centre and half sizes of the box around them, radius of the ball
    about that centre; the slab across their mean normal, as this unit vector, the height of its
    middle above the centre, and half its thickness (N, COLUMNS)."""


@kernel
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
    return BoxTree(depth, triangles, boxes)


@kernel
def _bound(triangles, box):
    """Write the bounds of some faces; they contain them in spite of rounding."""
    for k in range(3):
        low, high = math.inf, -math.inf
        for i in range(triangles.shape[0]):
            for c in range(3):
                low, high = min(low, triangles[i, 3 * c + k]), max(high, triangles[i, 3 * c + k])
        box[k] = 0.5 * (low + high)
        box[3 + k] = 0.5 * (high - low) + 1e-12
    nx, ny, nz = _mean_normal(triangles)
    low, high, square = math.inf, -math.inf, 0.0
    for i in range(triangles.shape[0]):
        for c in range(3):
            x, y = triangles[i, 3 * c] - box[0], triangles[i, 3 * c + 1] - box[1]
            z = triangles[i, 3 * c + 2] - box[2]
            height = nx * x + ny * y + nz * z
            low, high = min(low, height), max(high, height)
            square = max(square, x * x + y * y + z * z)
    box[RADIUS] = math.sqrt(square) + 1e-12
    box[NORMAL], box[NORMAL + 1], box[NORMAL + 2] = nx, ny, nz
    box[HEIGHT], box[THICKNESS] = 0.5 * (low + high), 0.5 * (high - low) + 1e-12


@kernel
def _mean_normal(triangles):
    """Unit vector along the sum of some faces' areas, or any one where that is zero."""
    x, y, z = 0.0, 0.0, 0.0
    for i in range(triangles.shape[0]):
        face = triangles[i]
        ux, uy, uz = face[3] - face[0], face[4] - face[1], face[5] - face[2]
        wx, wy, wz = face[6] - face[0], face[7] - face[1], face[8] - face[2]
        x, y, z = x + uy * wz - uz * wy, y + uz * wx - ux * wz, z + ux * wy - uy * wx
    length = math.sqrt(x * x + y * y + z * z)
    if length < 1e-100:
        return 1.0, 0.0, 0.0
    return x / length, y / length, z / length


@merged
def height_above(px, py, pz, box):
    """Signed height of a point above the middle of a node's slab."""
    return (
        box[NORMAL] * (px - box[0])
        + box[NORMAL + 1] * (py - box[1])
        + box[NORMAL + 2] * (pz - box[2])
        - box[HEIGHT]
    )


@merged
def leaf_rows(node, tree):
    """(first, last): rows of `triangles` of a leaf; (0, 0): the node is no leaf."""
    return faces_of_leaf(node, tree.depth, tree.triangles.shape[0])


@merged
def _clamped(value):
    return min(max(value, 0.0), 1.0)


@part
def triangle_distance(px, py, pz, triangle):
    """Squared distance of a point from a triangle, nine numbers (Ericson 2005, Sec. 5.1.5)."""
    ax, ay, az = triangle[0], triangle[1], triangle[2]
    ux, uy, uz = triangle[3] - ax, triangle[4] - ay, triangle[5] - az
    wx, wy, wz = triangle[6] - ax, triangle[7] - ay, triangle[8] - az
    rx, ry, rz = px - ax, py - ay, pz - az
    d1, d2 = ux * rx + uy * ry + uz * rz, wx * rx + wy * ry + wz * rz
    uu, uw, ww = (
        ux * ux + uy * uy + uz * uz, ux * wx + uy * wy + uz * wz, wx * wx + wy * wy + wz * wz
    )  # fmt: skip
    area = uu * ww - uw * uw
    s, t = ww * d1 - uw * d2, uu * d2 - uw * d1
    if area > 0.0 and s >= 0.0 and t >= 0.0 and s + t <= area:
        s, t = s / area, t / area
        x, y, z = rx - s * ux - t * wx, ry - s * uy - t * wy, rz - s * uz - t * wz
        return x * x + y * y + z * z
    # Else the nearest point lies on an edge.
    s = _clamped(d1 / uu) if uu > 0.0 else 0.0
    x, y, z = rx - s * ux, ry - s * uy, rz - s * uz
    least = x * x + y * y + z * z
    s = _clamped(d2 / ww) if ww > 0.0 else 0.0
    x, y, z = rx - s * wx, ry - s * wy, rz - s * wz
    least = min(least, x * x + y * y + z * z)
    ex, ey, ez = wx - ux, wy - uy, wz - uz
    ee = ex * ex + ey * ey + ez * ez
    x, y, z = rx - ux, ry - uy, rz - uz
    s = _clamped((ex * x + ey * y + ez * z) / ee) if ee > 0.0 else 0.0
    x, y, z = x - s * ex, y - s * ey, z - s * ez
    return min(least, x * x + y * y + z * z)


@merged
def _visit_with_ball(node, _position, _stale, state):
    """Visit a node; the walk ends at a face that is nearer to a point than a radius."""
    px, py, pz, radius, tree = state
    box, limit = tree.boxes[node], radius * radius
    x = max(abs(px - box[0]) - box[3], 0.0)
    y = max(abs(py - box[1]) - box[4], 0.0)
    z = max(abs(pz - box[2]) - box[5], 0.0)
    if x * x + y * y + z * z >= limit:
        return NO_NODE, NO_NODE, GO_ON
    if abs(height_above(px, py, pz, box)) - box[THICKNESS] >= radius:
        return NO_NODE, NO_NODE, GO_ON
    first, last = leaf_rows(node, tree)
    for i in range(first, last):
        if triangle_distance(px, py, pz, tree.triangles[i]) < limit:
            return NO_NODE, NO_NODE, STOP
    later, sooner = below(node, tree.depth)
    return later, sooner, GO_ON


@part
def ball_is_free(px, py, pz, radius, tree, nodes):
    """Whether no face is nearer to a point than a radius.

    Args:
        px: The centre of the ball.
        py: Its second coordinate.
        pz: Its third one.
        radius: Radius of the ball.
        tree: `BoxTree`.
        nodes: Scratch (STACK,).
    """
    state = px, py, pz, radius, tree
    return radius <= 0.0 or not walk(_visit_with_ball, state, nodes)


@part
def _segments_distance(rx, ry, rz, ux, uy, uz, vx, vy, vz):
    """Squared distance of the segment s u from the segment r + t v (Ericson 2005, Sec. 5.1.9)."""
    uu, vv = ux * ux + uy * uy + uz * uz, vx * vx + vy * vy + vz * vz
    uv = ux * vx + uy * vy + uz * vz
    ur, vr = ux * rx + uy * ry + uz * rz, vx * rx + vy * ry + vz * rz
    area = uu * vv - uv * uv
    s = _clamped((ur * vv - vr * uv) / area) if area > 1e-12 * uu * vv else 0.0
    t = _clamped((s * uv - vr) / vv) if vv > 0.0 else 0.0
    s = _clamped((ur + t * uv) / uu) if uu > 0.0 else 0.0
    x, y, z = rx + t * vx - s * ux, ry + t * vy - s * uy, rz + t * vz - s * uz
    return x * x + y * y + z * z


@part
def _crosses(start, end, triangle):
    """Whether a segment crosses a triangle."""
    ax, ay, az = triangle[0], triangle[1], triangle[2]
    ux, uy, uz = triangle[3] - ax, triangle[4] - ay, triangle[5] - az
    wx, wy, wz = triangle[6] - ax, triangle[7] - ay, triangle[8] - az
    nx, ny, nz = uy * wz - uz * wy, uz * wx - ux * wz, ux * wy - uy * wx
    one = nx * (start[0] - ax) + ny * (start[1] - ay) + nz * (start[2] - az)
    two = nx * (end[0] - ax) + ny * (end[1] - ay) + nz * (end[2] - az)
    if not ((one < 0.0 < two) or (two < 0.0 < one)):
        return False  # a segment in the plane of the face is near one of its edges or ends
    t = one / (one - two)
    rx = start[0] + t * (end[0] - start[0]) - ax
    ry = start[1] + t * (end[1] - start[1]) - ay
    rz = start[2] + t * (end[2] - start[2]) - az
    b1 = (ry * wz - rz * wy) * nx + (rz * wx - rx * wz) * ny + (rx * wy - ry * wx) * nz
    b2 = (uy * rz - uz * ry) * nx + (uz * rx - ux * rz) * ny + (ux * ry - uy * rx) * nz
    return b1 >= 0.0 and b2 >= 0.0 and b1 + b2 <= nx * nx + ny * ny + nz * nz


@part
def segment_distance(start, end, triangle):
    """Squared distance of a segment from a triangle of nine numbers."""
    if _crosses(start, end, triangle):
        return 0.0
    least = min(
        triangle_distance(start[0], start[1], start[2], triangle),
        triangle_distance(end[0], end[1], end[2], triangle),
    )
    ux, uy, uz = end[0] - start[0], end[1] - start[1], end[2] - start[2]
    for i in range(3):
        j, k = 3 * i, (3 * i + 3) % 9
        least = min(
            least,
            _segments_distance(
                triangle[j] - start[0], triangle[j + 1] - start[1], triangle[j + 2] - start[2],
                ux, uy, uz,
                triangle[k] - triangle[j], triangle[k + 1] - triangle[j + 1],
                triangle[k + 2] - triangle[j + 2],
            ),
        )  # fmt: skip
    return least


@merged
def _visit_with_capsule(node, _position, _stale, state):
    """Visit a node; the walk ends at a face that is nearer to a segment than a radius."""
    start, end, (px, py, pz), half, radius, tree = state
    box = tree.boxes[node]
    x = max(abs(px - box[0]) - box[3], 0.0)
    y = max(abs(py - box[1]) - box[4], 0.0)
    z = max(abs(pz - box[2]) - box[5], 0.0)
    if x * x + y * y + z * z >= (radius + half) ** 2:
        return NO_NODE, NO_NODE, GO_ON
    one = height_above(start[0], start[1], start[2], box)
    two = height_above(end[0], end[1], end[2], box)
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
        radius: The radius.
        tree: `BoxTree`.
        nodes: Scratch (STACK,).
    """
    half = 0.5 * math.sqrt(
        (end[0] - start[0]) ** 2 + (end[1] - start[1]) ** 2 + (end[2] - start[2]) ** 2
    )
    middle = 0.5 * (start[0] + end[0]), 0.5 * (start[1] + end[1]), 0.5 * (start[2] + end[2])
    state = start, end, middle, half, radius, tree
    return radius <= 0.0 or not walk(_visit_with_capsule, state, nodes)
