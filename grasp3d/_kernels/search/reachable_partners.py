"""The best opposing contacts of a vertex that a gripper reaches.

The tree of faces is searched best first: of all nodes and contacts that wait, the one with the
smallest bound of the critical angle comes next, so that contacts come in the order of their
critical angles. Each is tested with the gripper until enough are reached. Contacts near one that
was tested would end alike, and are passed over.
"""

import math

import numpy as np

from grasp3d._kernels.compiling.decorators import kernel, part
from grasp3d._kernels.jaws.gripper_parts import BLOCKED, NONE, REACHED, RESULTS
from grasp3d._kernels.jaws.reaching import reach_pair
from grasp3d._kernels.search.antipodal_candidates import evaluate_on_face
from grasp3d._kernels.search.face_contacts import (
    OwnNormals,
    aim,
    cosine_at,
    move_on_face,
    read_face,
    read_own,
    upper_bound,
)
from grasp3d._kernels.surface.face_tree import NO_NODE, below, faces_of_leaf
from grasp3d._kernels.surface.normal_sets import smallest_angle
from grasp3d._kernels.surface.surface_contacts import point_on_face, write_normals
from grasp3d._kernels.surface.vectors import (
    copy,
    difference,
    divided,
    norm,
    scaled,
    squared_distance,
    triple,
)

MOST_WAITING = 2048
"""Nodes and contacts that wait at most; further ones are passed over."""

MOST_STEPS = 6000
"""Nodes and contacts that are taken at most, per vertex."""

ACCURATE = -math.cos(0.005)
"""Key of the critical angle up to which a contact is not moved on its face to make it smaller."""

EXPLAIN = True
"""Whether `reach_pair` shall distinguish TABLE and BLOCKED exactly."""


@part
def _push(keys, entries, size, key, entry):
    """Insert an entry into a binary heap; returns the new size."""
    i = size
    while i > 0:
        above = (i - 1) // 2
        if keys[above] <= key:
            break
        keys[i], entries[i] = keys[above], entries[above]
        i = above
    keys[i], entries[i] = key, entry
    return size + 1


@part
def _pop(keys, entries, size):
    """Remove the smallest entry from a binary heap; returns the new size."""
    size -= 1
    key, entry = keys[size], entries[size]
    i = 0
    while 2 * i + 1 < size:
        below = 2 * i + 1
        if below + 1 < size and keys[below + 1] < keys[below]:
            below += 1
        if keys[below] >= key:
            break
        keys[i], entries[i] = keys[below], entries[below]
        i = below
    keys[i], entries[i] = key, entry
    return size


@part
def _is_near(point, radius, others, count, spacing):
    """Whether a ball is within a distance of one of the first `count` points."""
    for i in range(count):
        if math.sqrt(squared_distance(point, others[i])) + radius < spacing:
            return True
    return False


@part
def _test(v, sign, face, weights, explain, domain, reaching, scratch):
    """Test the grasp of a vertex and a point on a face; (code, free angles) of `reach_pair`."""
    shape, limits, tree, workspace = reaching
    points, normals, set_normals, result = scratch
    surface, sets, centres = domain.surface, domain.sets, domain.centres
    copy(surface.points[v], points[0])
    copy(centres[v], normals[0])
    copy(point_on_face(face, weights, surface), points[1])
    count, vertex = write_normals(face, triple(weights, 0), surface, sets, set_normals)
    if vertex >= 0:
        copy(centres[vertex], normals[1])
    else:
        copy(set_normals[0], normals[1])
        if count == 2:
            for k in range(3):
                normals[1, k] += set_normals[1, k]
    for i in range(2):
        length = norm(normals[i])
        if length < 1e-12:
            return BLOCKED, NONE
        copy(divided(normals[i], length), normals[i])
    return reach_pair(points, normals, sign, shape, limits, explain, tree, workspace, result)


@kernel
def _make_scratch():
    """Scratch arrays of `_test`: contacts, their normals, a set of normals, a result."""
    return np.empty((2, 3)), np.empty((2, 3)), np.empty((2, 3)), np.empty(RESULTS)


@kernel
def keep_reached(vertices, signs, faces, weights, domain, reaching, grasps, results):
    """Keep the given grasps that are reached, where they are better than those known.

    Args:
        vertices: Vertices (n,).
        signs: +1 squeeze, -1 expand (n,).
        faces: Faces of the opposing contacts, -1: none (n,).
        weights: Barycentric coordinates (n, 3).
        domain: `PairDomain`.
        reaching: (shape, limits, tree, workspace), as `reach_pair` takes them.
        grasps: `BestPairs` of reached grasps; written.
        results: `ReachResults` of their grasps of `worst`, a row per vertex; written.
    """
    scratch, surface, sets = _make_scratch(), domain.surface, domain.sets
    point, set_normals, result = scratch[0][1], scratch[2], scratch[3]
    for i in range(len(vertices)):
        v, sign, face, own = vertices[i], np.int64(signs[i]), faces[i], weights[i]
        if face < 0:
            continue
        copy(point_on_face(face, own, surface), point)
        line = difference(point, surface.points[v])
        opening = norm(line)
        if opening < 1e-9:
            continue
        # A lower bound of both angles: no grasp is tested that would not be kept.
        x, y, z = scaled(sign / opening, line)
        low = smallest_angle(sets.normals, sets.start[v], sets.counts[v], x, y, z)
        if low >= grasps.worst[v] and low >= grasps.best[v]:
            continue
        code, free = _test(v, sign, face, own, not EXPLAIN, domain, reaching, scratch)
        if code == REACHED:
            before = grasps.worst[v]
            evaluate_on_face(v, sign, face, own, surface, sets, grasps, set_normals)
            if grasps.worst[v] < before:
                results.codes[v], results.free[v] = code, free
                for k in range(RESULTS):
                    results.found[v, k] = result[k]


@kernel
def explain_pairs(vertices, signs, faces, weights, domain, reaching, codes):
    """Find why grasps of vertices and points on faces are not reached.

    Args:
        vertices: Vertices (n,).
        signs: +1 squeeze, -1 expand (n,).
        faces: Faces of the opposing contacts (n,).
        weights: Barycentric coordinates (n, 3).
        domain: `PairDomain`.
        reaching: (shape, limits, tree, workspace), as `reach_pair` takes them.
        codes: Written, a row per vertex (V,).
    """
    scratch = _make_scratch()
    for i in range(len(vertices)):
        v, sign = vertices[i], np.int64(signs[i])
        codes[v], _ = _test(v, sign, faces[i], weights[i], EXPLAIN, domain, reaching, scratch)


@kernel
def search_reachable(vertices, worst, cone, spacing, wanted, most_failed, domain, reaching):
    """Find the opposing contacts of each vertex with the smallest costs that are reached.

    For fingers that squeeze.

    Args:
        vertices: Vertices (n,).
        worst: Whether contacts are ordered by the angle over the worst normals of the vertex, or
            by that over its best normals.
        cone: Largest cost [rad].
        spacing: Distance from which contacts are different.
        wanted: Contacts wanted of each vertex, k.
        most_failed: Contacts of each vertex that are tested and not reached, before it ends.
        domain: `PairDomain`.
        reaching: (shape, limits, tree, workspace), as `reach_pair` takes them.

    Returns:
        Faces (n, k), -1: none, and barycentric coordinates (n, k, 3) of the contacts, best first.
    """
    surface, sets, limits, tree = domain.surface, domain.sets, domain.limits, domain.tree
    least = math.cos(cone)
    # The heap has the smallest key at the top: keys are cosines with the sign turned.
    keys, entries = np.empty(MOST_WAITING), np.empty(MOST_WAITING, dtype=np.int64)
    partner_faces = np.full((len(vertices), wanted), -1, dtype=np.int64)
    partner_weights = np.zeros((len(vertices), wanted, 3))
    contact_faces = np.empty(MOST_STEPS, dtype=np.int64)
    contact_weights, weights = np.empty((MOST_STEPS, 3)), np.empty(3)
    tested = np.empty((most_failed + wanted, 3))
    lines, corner_normals = np.empty((3, 3)), np.empty((3, 3))
    rows = np.empty((max(sets.counts.max(), 1), 12))
    scratch = _make_scratch()
    point = scratch[0][1]
    for row in range(len(vertices)):
        v = vertices[row]
        if worst and sets.counts[v] == 0:
            continue  # among all directions the worst normal has no grasp
        own = OwnNormals(rows, read_own(v, sets, rows), worst)
        contacts, failed, reached = 0, 0, 0
        waiting = _push(keys, entries, 0, -1.0, 0)
        for _ in range(MOST_STEPS):
            if waiting == 0 or failed == most_failed or reached == wanted:
                break
            entry, key = entries[0], keys[0]
            waiting = _pop(keys, entries, waiting)
            if entry < 0:
                face, chosen = contact_faces[-1 - entry], contact_weights[-1 - entry]
                copy(point_on_face(face, chosen, surface), point)
                if _is_near(point, 0.0, tested, failed + reached, spacing):
                    continue
                if key > ACCURATE:
                    read_face(face, v, surface, lines, corner_normals)
                    move_on_face(chosen, -key, math.inf, 0.0, lines, corner_normals, own, limits)
                    copy(point_on_face(face, chosen, surface), point)
                copy(point, tested[failed + reached])
                code, _ = _test(v, 1, face, chosen, not EXPLAIN, domain, reaching, scratch)
                if code == REACHED:
                    partner_faces[row, reached] = face
                    copy(chosen, partner_weights[row, reached])
                    reached += 1
                else:
                    failed += 1
                continue
            ball = tree.bounds[entry]
            if _is_near(ball, ball[3], tested, failed + reached, spacing):
                continue  # of a contact that was tested after it began to wait
            for child in below(entry, tree.depth):
                if child == NO_NODE:
                    continue
                high = upper_bound(child, v, own, domain, least)
                if high <= least or waiting == MOST_WAITING:
                    continue
                ball = tree.bounds[child]
                if not _is_near(ball, ball[3], tested, failed + reached, spacing):
                    waiting = _push(keys, entries, waiting, -high, child)
            first, last = faces_of_leaf(entry, tree.depth, tree.order.shape[0])
            for i in range(first, last):
                face = tree.order[i]
                if contacts == MOST_STEPS or not aim(face, v, domain.centres, surface, weights):
                    continue
                copy(point_on_face(face, weights, surface), point)
                if _is_near(point, 0.0, tested, failed + reached, spacing):
                    continue
                read_face(face, v, surface, lines, corner_normals)
                cosine = cosine_at(triple(weights, 0), lines, corner_normals, own, limits)
                if cosine > least and waiting < MOST_WAITING:
                    contact_faces[contacts] = face
                    copy(weights, contact_weights[contacts])
                    contacts += 1
                    waiting = _push(keys, entries, waiting, -cosine, -contacts)
    return partner_faces, partner_weights
