"""Opposing contacts exactly on creases and corners, where the best of several normals counts.

A tree with the nodes of that over the faces bounds the creases and corners of the faces alone.
"""

import math

import numpy as np

from grasp3d._kernels.compiling import kernel, merged, part
from grasp3d._kernels.search.face_contacts import best_cosine, read_own, write_side
from grasp3d._kernels.search.rays import SMALLEST_OPENING
from grasp3d._kernels.surface.face_tree import NO_NODE, below, faces_of_leaf
from grasp3d._kernels.surface.surface_contacts import ANY_NORMAL, ON_EDGE
from grasp3d._kernels.surface.vectors import (
    combined,
    copy,
    difference,
    divided,
    dot,
    norm,
    scaled,
    squared_distance,
    triple,
)

GOLDEN = 0.5 * (math.sqrt(5.0) - 1.0)
STEPS = 36
"""Steps of the golden section, to 3e-8 of an edge."""


@merged
def _has_edge(face, k, surface):
    """Whether the edge opposite a corner is a crease that is searched with this face.

    It is one with the other face, too, whose normals at its ends are this one's twins.
    """
    corners, twins, faces = surface.corners, surface.twins, surface.faces
    if twins[face, k, 0] < 0:
        return twins[face, k, 0] == ANY_NORMAL
    i = 0 if faces[face, k - 2] < faces[face, k - 1] else 1
    one, two = corners[face, k - 2 + i], twins[face, k, i]
    if one == two:
        one, two = corners[face, k - 1 - i], twins[face, k, 1 - i]
    return one < two


def faces_of_corners(surface, sets):
    """For each vertex with several normals the face with which it is searched, -1 for others."""
    owners = np.full(len(sets.counts), -1)
    owners[surface.faces] = np.arange(len(surface.faces))[:, None]  # the last one of each vertex
    owners[sets.counts == 1] = -1
    return owners


@part
def _write_normals(face, owners, surface, sets, rows):
    """Write the normals of a face's creases and corners; returns their number, -1: any normal."""
    count = 0
    for k in range(3):
        vertex = surface.faces[face, k]
        if owners[vertex] == face:
            for i in range(sets.counts[vertex]):
                copy(sets.normals[sets.start[vertex] + i], rows[count])
                count += 1
            if sets.counts[vertex] == 0:
                return -1
        if _has_edge(face, k, surface):
            if surface.twins[face, k, 0] == ANY_NORMAL:
                return -1
            for i in range(2):
                copy(surface.normals[surface.twins[face, k, i]], rows[count])
                copy(surface.normals[surface.corners[face, k - 2 + i]], rows[count + 1])
                count += 2
    return count


@part
def _bound_face(face, owners, surface, sets, rows, bounds):
    """Write the bounds of a face's creases and corners, as in `FaceTree`; radius -inf: none."""
    count = _write_normals(face, owners, surface, sets, rows)
    bounds[3] = -math.inf
    if count == 0:
        return
    for k in range(3):
        bounds[k], bounds[4 + k] = 0.0, 0.0
        for c in range(3):
            bounds[k] += surface.points[surface.faces[face, c], k] / 3.0
        for i in range(count):
            bounds[4 + k] += rows[i, k]
    square = 0.0
    for c in range(3):
        square = max(square, squared_distance(surface.points[surface.faces[face, c]], bounds))
    bounds[3] = math.sqrt(square)
    axis = triple(bounds, 4)
    length = norm(axis)
    cosine = 1.0 if length > 1e-12 else -1.0
    for i in range(count):
        cosine = min(cosine, dot(rows[i], axis) / max(length, 1e-12))
    if count < 0 or cosine <= 0.0:  # any direction
        bounds[4], bounds[5], bounds[6], bounds[7], bounds[8] = 0.0, 0.0, 1.0, -1.0, 0.0
        return
    bounds[4], bounds[5], bounds[6] = divided(axis, length)
    bounds[7], bounds[8] = cosine, math.sqrt(1.0 - cosine * cosine)


@part
def _merge_balls(one, other):
    """Write the smallest ball that contains two of them over the first one."""
    distance = math.sqrt(squared_distance(other, one))
    if distance + other[3] <= one[3]:
        return
    if distance + one[3] <= other[3]:
        for k in range(4):
            one[k] = other[k]
        return
    radius = 0.5 * (distance + one[3] + other[3])
    part = (radius - one[3]) / distance
    copy(combined(1.0, one, part, difference(other, one)), one)
    one[3] = radius


@part
def _merge_cones(one, other):
    """Write the narrowest cone that contains two of them over the first one."""
    axis, other_axis = triple(one, 4), triple(other, 4)
    between = math.acos(max(min(dot(axis, other_axis), 1.0), -1.0))
    half, other_half = math.acos(one[7]), math.acos(other[7])
    if between + other_half <= half:
        return
    if between + half <= other_half:
        for k in range(4, 9):
            one[k] = other[k]
        return
    wide = 0.5 * (between + half + other_half) + 1e-7  # more than rounding errors of the angles
    if wide >= 0.5 * math.pi:
        one[7], one[8] = -1.0, 0.0
        return
    sine = math.sin(between)
    turn = min(max(wide - half, 0.0), between)
    if sine > 1e-12:
        axis = combined(math.sin(between - turn), axis, math.sin(turn), other_axis)
        one[4], one[5], one[6] = divided(axis, sine)
    one[7], one[8] = math.cos(wide), math.sin(wide)


@part
def _merge(one, other):
    """Write bounds of two nodes over those of the first one."""
    if other[3] < 0.0:
        return
    if one[3] < 0.0:
        for k in range(9):
            one[k] = other[k]
        return
    _merge_balls(one, other)
    _merge_cones(one, other)


@kernel("FaceTree, Ints1, Surface, ContactNormals")
def bound_creases(tree, owners, surface, sets):
    """Bound the creases and corners of each node of a tree, in place of the faces.

    Nodes without any get a radius of -inf, so that no contact is searched for in them.

    Args:
        tree: `FaceTree`; its bounds are replaced.
        owners: What `faces_of_corners` returns (V,).
        surface: `Surface`.
        sets: `ContactNormals`.
    """
    bounds = tree.bounds
    rows, one = np.empty((3 * max(sets.counts.max(), 4) + 12, 3)), np.empty(10)
    for node in range(bounds.shape[0] - 1, -1, -1):
        for k in range(9):
            bounds[node, k] = 0.0
        bounds[node, 3] = -math.inf
        first, last = faces_of_leaf(node, tree.depth, tree.order.shape[0])
        for i in range(first, last):
            _bound_face(tree.order[i], owners, surface, sets, rows, one)
            _merge(bounds[node], one)
        for child in below(node, tree.depth):
            if child != NO_NODE:
                _merge(bounds[node], bounds[child])
    for node in range(bounds.shape[0]):
        bounds[node, 9] = bounds[node, 3]
        for k in range(3):
            bounds[node, 9] += bounds[node, k] * bounds[node, 4 + k]


@merged
def _edge(face, k, surface):
    """Ends of the edge opposite a corner of a face."""
    start, end = surface.faces[face, k - 2], surface.faces[face, k - 1]
    return surface.points[start], surface.points[end]


@part
def _cosine_on_edge(t, face, k, v, surface, own, rows):
    """Cosine of the critical angle of a contact on the edge opposite a corner of a face."""
    normals, corners, twins = surface.normals, surface.corners[face], surface.twins[face, k]
    start, end = _edge(face, k, surface)
    line = difference(combined(1.0 - t, start, t, end), surface.points[v])
    if dot(line, line) < SMALLEST_OPENING * SMALLEST_OPENING:
        return -1.0
    result = best_cosine(own.rows, own.size, line)
    if twins[0] == ANY_NORMAL:
        return result
    one = combined(1.0 - t, normals[corners[k - 2]], t, normals[corners[k - 1]])
    other = combined(1.0 - t, normals[twins[0]], t, normals[twins[1]])
    copy(divided(one, max(norm(one), 1e-12)), rows[0])
    copy(divided(other, max(norm(other), 1e-12)), rows[1])
    write_side(rows, 0, 1)
    return min(result, best_cosine(rows, 2, scaled(-1.0, line)))


@part
def _within_reach(face, k, v, surface, largest):
    """Ends of the part of an edge that is not farther from a vertex than the largest opening."""
    start, end = _edge(face, k, surface)
    edge, line = difference(end, start), difference(start, surface.points[v])
    square, along, near = dot(edge, edge), dot(edge, line), dot(line, line)
    low, high = 2.0 * ON_EDGE, 1.0 - 2.0 * ON_EDGE  # farther out the contact is at a corner
    if largest < math.inf:
        root = along * along - square * (near - largest * largest)
        if root <= 0.0:
            return 1.0, 0.0
        root = math.sqrt(root)
        low, high = max(low, (-along - root) / square), min(high, (root - along) / square)
    return low, high


@part
def _is_useless(face, k, v, cosine, surface, own, rows):
    """Whether no contact on an edge can be above a cosine, from the angle at its middle.

    Half the edge turns the line by at most asin(half / distance). It turns the ends of the arc of
    normals by half their difference, and its middle by less than twice that.
    """
    cosine_at_middle = _cosine_on_edge(0.5, face, k, v, surface, own, rows)
    start, end = _edge(face, k, surface)
    near = squared_distance(combined(0.5, start, 0.5, end), surface.points[v])
    square = 0.25 * squared_distance(start, end)
    if square >= near:
        return False
    turn = math.asin(math.sqrt(square / near))
    twins, normals = surface.twins[face, k], surface.normals
    if twins[0] != ANY_NORMAL:
        corners = surface.corners[face]
        one = squared_distance(normals[corners[k - 2]], normals[corners[k - 1]])
        other = squared_distance(normals[twins[0]], normals[twins[1]])
        turn += math.sqrt(max(one, other))
    return math.acos(max(min(cosine_at_middle, 1.0), -1.0)) - turn > math.acos(cosine)


@part
def _best_on_edge(face, k, v, cosine, surface, own, largest, rows):
    """Golden section over an edge, whose contacts within any limit form an interval.

    Returns:
        (cosine, fraction of the edge), the fraction below 0 where none is above the given cosine.
    """
    low, high = _within_reach(face, k, v, surface, largest)
    if low >= high or _is_useless(face, k, v, cosine, surface, own, rows):
        return cosine, -1.0
    one, other = high - GOLDEN * (high - low), low + GOLDEN * (high - low)
    at_one = _cosine_on_edge(one, face, k, v, surface, own, rows)
    at_other = _cosine_on_edge(other, face, k, v, surface, own, rows)
    for _ in range(STEPS):
        if at_one > at_other:
            high, other, at_other = other, one, at_one
            one = high - GOLDEN * (high - low)
            at_one = _cosine_on_edge(one, face, k, v, surface, own, rows)
        else:
            low, one, at_one = one, other, at_other
            other = low + GOLDEN * (high - low)
            at_other = _cosine_on_edge(other, face, k, v, surface, own, rows)
    if not max(at_one, at_other) > cosine:
        return cosine, -1.0
    return (at_one, one) if at_one > at_other else (at_other, other)


@part
def _cosine_at_corner(vertex, v, surface, sets, own, largest, rows):
    """Cosine of the critical angle of a contact at another vertex; -1: there is none."""
    line = difference(surface.points[vertex], surface.points[v])
    if not SMALLEST_OPENING <= norm(line) <= largest:
        return -1.0
    there = best_cosine(rows, read_own(vertex, sets, rows), scaled(-1.0, line))
    return min(best_cosine(own.rows, own.size, line), there)


@part
def best_on_creases(face, v, cosine, owners, own, domain, rows, weights):
    """Find the best contact of a vertex on the creases and corners of a face.

    Args:
        face: The face.
        v: The vertex.
        cosine: Cosine of the limit, not below 0.
        owners: What `faces_of_corners` returns (V,).
        own: `OwnNormals`, of which the best one counts.
        domain: `PairDomain`.
        rows: Scratch like those of `own`, two at least.
        weights: Barycentric coordinates of the contact, written where one was found (3,).

    Returns:
        Cosine of the smallest critical angle, or `cosine`.
    """
    surface, sets, largest = domain.surface, domain.sets, domain.limits.largest
    for k in range(3):
        vertex = surface.faces[face, k]
        if owners[vertex] == face:
            better = _cosine_at_corner(vertex, v, surface, sets, own, largest, rows)
            if better > cosine:
                cosine = better
                weights[0], weights[1], weights[2] = 0.0, 0.0, 0.0
                weights[k] = 1.0
        ends = surface.faces[face, k - 2], surface.faces[face, k - 1]
        if _has_edge(face, k, surface) and ends[0] != v and ends[1] != v:
            cosine, t = _best_on_edge(face, k, v, cosine, surface, own, largest, rows)
            if t >= 0.0:
                weights[k], weights[(k + 1) % 3], weights[(k + 2) % 3] = 0.0, 1.0 - t, t
    return cosine
