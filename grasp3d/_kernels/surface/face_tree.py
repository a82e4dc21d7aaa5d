"""A tree over the faces of a surface: bounds of positions and contact normals; walks over trees.

Each node covers half of the faces of its parent. Node i has the children 2 i + 1 and 2 i + 2, and
its faces are consecutive in the tree's order, so no links are stored.
"""

import math
from typing import NamedTuple

import numpy as np

from grasp3d._kernels.compiling import Floats2, Ints1, kernel, merged, part
from grasp3d._kernels.surface.surface_contacts import least_turn

LEAF = 1
"""Most faces in a leaf; more take less memory and more time."""

STACK = 128
"""Most nodes that can wait: fewer than two for each level of any tree."""

NO_NODE = -1
"""Value that stands for no node."""

GO_ON, CHANGED, STOP = 0, 1, 2
"""Outcome of a visit to a node: the walk continues; it continues, but waiting nodes are stale as
what decides about them has changed; the walk ends."""

NORMAL_SCALE = 0.3
"""Length, in object sizes, that weighs as much as a difference of 1 between unit normals when faces
are divided: about the distance of opposing contacts, at which it tilts their line by 1 rad."""


class FaceTree(NamedTuple):
    """Bounds of the faces of each node, in the frame of the surface."""

    order: Ints1
    """Faces in the order of the leaves (F,)."""
    depth: int
    """Number of divisions from the root to a leaf."""
    bounds: Floats2
    """For each node: centre and radius of a ball that contains its faces; axis, and cosine and sine
    of the half-angle, of a cone that contains its inward normals (half-angle pi for any direction);
    largest coordinate of its faces along that axis; least turn on its faces [rad] (N, 11)."""


@merged
def walk(visit, state, nodes):
    """Visit the nodes of a tree, depth first from the root.

    Args:
        visit: Kernel, called with a node, the position at which it waited, whether it is stale, and
            the state. It returns the child to visit later and the one to visit next, NO_NODE for
            none, and GO_ON, CHANGED or STOP. The children wait at the position of their node and
            at the following one.
        state: Tuple that is passed to `visit`.
        nodes: Scratch (STACK,).

    Returns:
        Whether a visit ended the walk.
    """
    nodes[0], top, stale = 0, 1, 0
    while top > 0:
        top -= 1
        later, sooner, event = visit(nodes[top], top, top < stale, state)
        stale = top if event == CHANGED else min(stale, top)
        if event == STOP:
            return True
        for node in (later, sooner):
            if node != NO_NODE:
                nodes[top] = node
                top += 1
    return False


@merged
def below(node, depth):
    """The two children of a node; NO_NODE for a leaf."""
    if node >= (1 << depth) - 1:
        return NO_NODE, NO_NODE
    return 2 * node + 1, 2 * node + 2


@merged
def faces_of_leaf(node, depth, size):
    """(first, last), a leaf's positions in the tree's order of faces; (0, 0) if not a leaf."""
    leaf = node - ((1 << depth) - 1)
    return (size * leaf >> depth, size * (leaf + 1) >> depth) if leaf >= 0 else (0, 0)


@kernel()
def divide(order, keys, depth):
    """Reorder the faces so that each node's halves differ as much as possible, in place."""
    size = order.shape[0]
    for level in range(depth):
        for node in range(1 << level):
            first, last = size * node >> level, size * (node + 1) >> level
            middle = size * (2 * node + 1) >> (level + 1)
            widest = _widest(order, keys, first, last)
            _select(order, keys, widest, first, last, middle)


@kernel()
def _widest(order, keys, first, last):
    """Column in which the keys of the faces from `first` to `last` differ most."""
    widest, extent = 0, -1.0
    for k in range(keys.shape[1]):
        low, high = math.inf, -math.inf
        for i in range(first, last):
            key = keys[order[i], k]
            low, high = min(low, key), max(high, key)
        if high - low > extent:
            widest, extent = k, high - low
    return widest


@part
def _select(order, keys, k, first, last, middle):
    """Quickselect: move the faces with smaller keys before `middle`, the others after it."""
    low, high = first, last - 1
    while low < high:
        pivot = keys[order[(low + high) // 2], k]
        i, j = low, high
        while i <= j:
            while keys[order[i], k] < pivot:
                i += 1
            while keys[order[j], k] > pivot:
                j -= 1
            if i <= j:
                order[i], order[j] = order[j], order[i]
                i += 1
                j -= 1
        if middle <= j:
            high = j
        elif middle >= i:
            low = i
        else:
            return


@part
def _bound_node(first, last, order, surface, bounds):
    """Write the bounds of the faces from `first` to `last`, as in `FaceTree`."""
    points, faces = surface.points, surface.faces
    corners, normals = surface.corners, surface.normals
    low, axis, high = 0, 4, 7  # first columns; the box's corners until its centre is known
    for k in range(3):
        bounds[low + k], bounds[high + k], bounds[axis + k] = math.inf, -math.inf, 0.0
    for i in range(first, last):
        for c in range(3):
            vertex, row = faces[order[i], c], corners[order[i], c]
            for k in range(3):
                bounds[low + k] = min(bounds[low + k], points[vertex, k])
                bounds[high + k] = max(bounds[high + k], points[vertex, k])
                bounds[axis + k] += normals[row, k]
    length = math.sqrt(bounds[4] ** 2 + bounds[5] ** 2 + bounds[6] ** 2)
    if length < 1e-12:  # any axis serves, as for the whole of a closed surface
        bounds[6], length = 1.0, 1.0
    for k in range(3):
        bounds[k], bounds[4 + k] = (
            0.5 * (bounds[low + k] + bounds[high + k]),
            bounds[axis + k] / length,
        )
    square, cosine, farthest = 0.0, 1.0, -math.inf
    for i in range(first, last):
        for c in range(3):
            vertex, row = faces[order[i], c], corners[order[i], c]
            distance, product, height = 0.0, 0.0, 0.0
            for k in range(3):
                distance += (points[vertex, k] - bounds[k]) ** 2
                product += bounds[4 + k] * normals[row, k]
                height += bounds[4 + k] * points[vertex, k]
            square, cosine = max(square, distance), min(cosine, product)
            farthest = max(farthest, height)
    bounds[3] = math.sqrt(square)
    bounds[9] = farthest
    # A cone beyond a hemisphere need not contain the interpolated normals.
    bounds[7] = min(cosine, 1.0) if cosine > 0.0 else -1.0
    bounds[8] = math.sqrt(1.0 - bounds[7] ** 2)
    bounds[10] = least_turn(order[first:last], surface.turns)


@kernel("Surface")
def face_tree(surface):
    """Divide the faces of a surface into a tree.

    Args:
        surface: `Surface`.

    Returns:
        The `FaceTree`.
    """
    size = surface.faces.shape[0]
    depth = 0
    while (size >> depth) > LEAF:
        depth += 1
    keys = np.empty((size, 6))
    for face in range(size):
        for k in range(3):
            keys[face, k], keys[face, 3 + k] = 0.0, 0.0
            for c in range(3):
                keys[face, k] += surface.points[surface.faces[face, c], k] / 3.0
                keys[face, 3 + k] += surface.normals[surface.corners[face, c], k] / 3.0
            keys[face, 3 + k] *= NORMAL_SCALE
    order = np.arange(size)
    divide(order, keys, depth)
    nodes = (2 << depth) - 1
    bounds = np.empty((nodes, 11))
    for level in range(depth + 1):
        for j in range(1 << level):
            first, last = size * j >> level, size * (j + 1) >> level
            _bound_node(first, last, order, surface, bounds[(1 << level) - 1 + j])
    return FaceTree(order, depth, bounds)
