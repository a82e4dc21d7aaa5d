"""Branch and bound for opposing contacts: no direction is left out because no ray went there.

Rays sample the directions in which a vertex sees the surface. A good opposing contact on a thin
feature or near the edge of a flat face is seen under a small solid angle, between the rays. Here a
tree over the faces bounds from below the cost of every grasp of a vertex with its second contact on
the faces of a node; nodes that cannot improve the vertex's grasp are left out.

It is for fingers that squeeze: every point where a line leaves the object may be an opposing
contact, whatever lies between, so that a pair of points is a grasp without tracing a ray.
"""

import math

import numpy as np

from grasp3d._kernels.compiling.decorators import kernel, merged, part
from grasp3d._kernels.search.antipodal_candidates import evaluate_pair
from grasp3d._kernels.search.face_contacts import (
    NONE,
    aim,
    cosine_at,
    move_on_face,
    read_face,
    read_own,
    turning_speed,
    upper_bound,
)

MOST_FACES = 2000
"""Faces on which a contact is computed, per vertex, before the best one so far is taken: a bound on
the time where very many are equally good, as at the limit of openings on a ball."""

STACK = 128
"""Nodes that wait at most: fewer than two for each level of the tree."""


@merged
def evaluate(v, face, weights, surface, sets, grasps, found):
    """Evaluate the grasp of a vertex and a point inside a face, as rays do."""
    points, own = surface.points, surface.points[v]
    x, y, z = 0.0, 0.0, 0.0
    for k in range(3):
        corner = surface.faces[face, k]
        x += weights[k] * points[corner, 0]
        y += weights[k] * points[corner, 1]
        z += weights[k] * points[corner, 2]
    partner = x, y, z
    x, y, z = x - own[0], y - own[1], z - own[2]
    opening = math.sqrt(x * x + y * y + z * z)
    evaluate_pair(
        v,
        1,
        partner,
        opening,
        face,
        (weights[0], weights[1], weights[2]),
        surface,
        sets,
        grasps,
        found,
    )


@part
def _best_on_surface(
    v,
    worst,
    limit,
    tree,
    centres,
    surface,
    sets,
    limits,
    nodes,
    highs,
    lines,
    normals,
    own,
    weights,
    best,
):
    """Search for a grasp of a vertex with a cost below a limit; returns its face or -1.

    Its barycentric coordinates are written to `best`; the other arrays are scratch.
    """
    size, depth = tree.order.shape[0], tree.depth
    first_leaf = (1 << depth) - 1
    least = math.cos(limit)
    count = read_own(v, sets, own)
    best_face, face_count = -1, 0
    nodes[0], highs[0], top = 0, 1.0, 1
    while top > 0:
        top -= 1
        node = nodes[top]
        if highs[top] <= least:
            continue
        if node < first_leaf:
            one, two = 2 * node + 1, 2 * node + 2
            high = upper_bound(one, v, own, count, worst, tree, surface, limits, least)
            low = upper_bound(two, v, own, count, worst, tree, surface, limits, least)
            if high < low:
                one, two, high, low = two, one, low, high
            # The more promising half is searched first: it lowers the limit for the other.
            nodes[top], highs[top] = two, low
            nodes[top + 1], highs[top + 1] = one, high
            top += 2
            continue
        leaf = node - first_leaf
        for i in range(size * leaf >> depth, size * (leaf + 1) >> depth):
            face = tree.order[i]
            face_count += 1
            if not aim(face, v, centres, surface, weights):
                continue
            read_face(face, v, surface, lines, normals)
            w0, w1, w2 = weights[0], weights[1], weights[2]
            cosine = cosine_at(w0, w1, w2, lines, normals, own, count, worst, limits)
            if cosine > NONE:
                turning = turning_speed(
                    weights, lines, normals, tree.bounds[node, 7], limits.location
                )
                cosine = move_on_face(
                    weights, cosine, turning, limit, lines, normals, own, count, worst, limits
                )
            if cosine > least:
                limit, least, best_face = math.acos(min(cosine, 1.0)), cosine, face
                for k in range(3):
                    best[k] = weights[k]
            if face_count == MOST_FACES:
                top = 0
    return best_face


@kernel
def descend(vertices, worst, gain, cone, tree, centres, surface, sets, limits, grasps):
    """Search the whole surface for a clearly better opposing contact of each vertex.

    Args:
        vertices: Vertices (n,).
        worst: Whether the angle over the worst normals of the vertex is minimised, or that over its
            best normals.
        gain: Least decrease of the cost that is searched for [rad].
        cone: Largest cost that is searched for [rad].
        tree: `FaceTree`.
        centres: Centre of each vertex's set of normals (V, 3).
        surface: `Surface`.
        sets: `ContactNormals`.
        limits: `PairLimits`.
        grasps: `BestPairs`; written.
    """
    nodes, highs = np.empty(STACK, dtype=np.int64), np.empty(STACK)
    weights, best_weights, found = np.empty(3), np.empty(3), np.empty((2, 3))
    lines, normals = np.empty((3, 3)), np.empty((3, 3))
    most = 0
    for v in range(sets.counts.shape[0]):
        most = max(most, sets.counts[v])
    own = np.empty((most, 12))
    for v in vertices:
        if worst and sets.counts[v] == 0:
            continue  # among all directions the worst normal has no grasp
        limit = min(cone, grasps.worst[v] if worst else grasps.best[v]) - gain
        if limit <= 0.0:
            continue
        face = _best_on_surface(
            v,
            worst,
            limit,
            tree,
            centres,
            surface,
            sets,
            limits,
            nodes,
            highs,
            lines,
            normals,
            own,
            weights,
            best_weights,
        )
        if face >= 0:
            evaluate(v, face, best_weights, surface, sets, grasps, found)
