"""Rays through a tree of boxes, in 64 bits: the first face that each ray meets."""

import numpy as np

from grasp3d._kernels.compiling import kernel, merged
from grasp3d._kernels.surface.box_tree import corner_and_edges, leaf_rows
from grasp3d._kernels.surface.face_tree import STACK
from grasp3d._kernels.surface.vectors import cross, difference, dot

BORDER = 1e-12
"""Widening of a face beyond its borders, in its sides: no ray passes between two faces."""

STEEPEST = 1e-300
"""Smallest component of a direction that a box is met with, so that none is divided by zero."""


@merged
def _entry(start, inverse, box, far):
    """Distance at which a ray enters a box, or `far` where it does not before."""
    low, high = 0.0, far
    for k in range(3):
        one = (box[k] - box[3 + k] - start[k]) * inverse[k]
        other = (box[k] + box[3 + k] - start[k]) * inverse[k]
        low, high = max(low, min(one, other)), min(high, max(one, other))
    return low if low <= high else far


@merged
def _distance(start, direction, triangle, far):
    """Distance at which a ray meets a triangle, or `far` (Moeller & Trumbore 1997)."""
    a, u, w = corner_and_edges(triangle)
    across = cross(direction, w)
    volume = dot(u, across)
    if volume == 0.0:
        return far
    r = difference(start, a)
    s = dot(r, across) / volume
    if not -BORDER <= s <= 1.0 + BORDER:
        return far
    turned = cross(r, u)
    t = dot(direction, turned) / volume
    if not (t >= -BORDER and s + t <= 1.0 + BORDER):
        return far
    distance = dot(w, turned) / volume
    return distance if 0.0 <= distance < far else far


@kernel("Float32s2, Float32s2, Float32s1, int, int, BoxTree, Int32s1, Float32s1")
def first_faces(origins, directions, lengths, first, last, tree, faces, far):
    """Find the first face that each of some rays meets.

    Args:
        origins: Where the rays start (n, 3).
        directions: Their unit vectors (n, 3).
        lengths: Where they end (n,); inf: nowhere.
        first: First of the rays that are traced.
        last: The one after the last.
        tree: The `BoxTree` of the faces.
        faces: Written: the face of each ray, -1: it meets none, (n,).
        far: Written: its distance, else the length of the ray, (n,).
    """
    nodes, entries = np.empty(STACK, np.int64), np.empty(STACK)
    boxes, order, triangles = tree.boxes, tree.order, tree.triangles
    for i in range(first, last):
        start = (float(origins[i, 0]), float(origins[i, 1]), float(origins[i, 2]))
        x, y, z = float(directions[i, 0]), float(directions[i, 1]), float(directions[i, 2])
        direction = (x, y, z)
        inverse = (
            1.0 / (x if abs(x) > STEEPEST else STEEPEST),
            1.0 / (y if abs(y) > STEEPEST else STEEPEST),
            1.0 / (z if abs(z) > STEEPEST else STEEPEST),
        )
        nearest, face = float(lengths[i]), -1
        count, nodes[0], entries[0] = 1, 0, 0.0
        while count:
            count -= 1
            node = nodes[count]
            if entries[count] >= nearest:
                continue
            begin, end = leaf_rows(node, tree)
            for row in range(begin, end):
                distance = _distance(start, direction, triangles[row], nearest)
                if distance < nearest:
                    nearest, face = distance, order[row]
            if end > begin:
                continue
            near, other = 2 * node + 1, 2 * node + 2
            one = _entry(start, inverse, boxes[near], nearest)
            two = _entry(start, inverse, boxes[other], nearest)
            if two < one:
                near, other, one, two = other, near, two, one
            if two < nearest:
                nodes[count], entries[count] = other, two
                count += 1
            if one < nearest:
                nodes[count], entries[count] = near, one
                count += 1
        faces[i], far[i] = face, nearest
