"""Distances of segments from faces: balls that move along a segment."""

import math

from grasp3d._kernels.compiling.decorators import merged, part
from grasp3d._kernels.surface.box_tree import THICKNESS, height_above, leaf_rows, triangle_distance


@merged
def _clamped(value):
    return min(max(value, 0.0), 1.0)


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
    if radius <= 0.0:
        return True
    half = 0.5 * math.sqrt(
        (end[0] - start[0]) ** 2 + (end[1] - start[1]) ** 2 + (end[2] - start[2]) ** 2
    )
    px, py, pz = 0.5 * (start[0] + end[0]), 0.5 * (start[1] + end[1]), 0.5 * (start[2] + end[2])
    first_leaf = (1 << tree.depth) - 1
    nodes[0], top = 0, 1
    while top > 0:
        top -= 1
        node = nodes[top]
        box = tree.boxes[node]
        x = max(abs(px - box[0]) - box[3], 0.0)
        y = max(abs(py - box[1]) - box[4], 0.0)
        z = max(abs(pz - box[2]) - box[5], 0.0)
        if x * x + y * y + z * z >= (radius + half) ** 2:
            continue
        one = height_above(start[0], start[1], start[2], box)
        two = height_above(end[0], end[1], end[2], box)
        if one * two > 0.0 and min(abs(one), abs(two)) - box[THICKNESS] >= radius:
            continue
        if node < first_leaf:
            nodes[top], nodes[top + 1] = 2 * node + 1, 2 * node + 2
            top += 2
            continue
        first, last = leaf_rows(node, tree)
        for i in range(first, last):
            if segment_distance(start, end, tree.triangles[i]) < radius * radius:
                return False
    return True
