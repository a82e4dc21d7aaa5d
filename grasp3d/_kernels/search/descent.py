"""Branch and bound for opposing contacts: no direction is left out because no ray went there.

Rays sample the directions in which a vertex sees the surface. A good opposing contact on a thin
feature or near the edge of a flat face is seen under a small solid angle, between the rays. Here a
tree over the faces bounds from below the cost of every grasp of a vertex with its second contact on
the faces of a node; nodes that cannot improve the vertex's grasp are left out.

It is for fingers that squeeze: every point where a line leaves the object may be an opposing
contact, whatever lies between, so that a pair of points is a grasp without tracing a ray.

`descend` moves contacts over their faces in steps, where contacts or normals are uncertain.
`descend_exactly` finds the smallest critical angle of contacts that are known exactly. Its vertices
come in the order of the tree, so that the best face of one is nearly the best of the next: with the
limit that it gives, most of the search only proves that nothing is better. A node is left out where
no line to its ball is within the limit of the vertex's normal, or of the reversed normals of the
node; unlike angles, these cones cost a square root each.
"""

import math

import numpy as np

from grasp3d._kernels.compiling.decorators import kernel, merged, part
from grasp3d._kernels.search.antipodal_candidates import evaluate_pair
from grasp3d._kernels.search.crease_contacts import best_on_creases
from grasp3d._kernels.search.face_contacts import (
    INSIDE,
    NONE,
    aim,
    cosine_at,
    longest_difference,
    move_on_face,
    read_face,
    read_own,
    turning_speed,
    upper_bound,
)
from grasp3d._kernels.search.face_minimum import (
    BENT,
    MOST_PARTS,
    MOST_POINTS,
    RESOLVED,
    best_on_bent_face,
    best_on_face,
)
from grasp3d._kernels.surface.polygons import REGION_CORNERS

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
def _best_by_steps(
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
        face = _best_by_steps(
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


CREASE_GAIN = math.radians(0.25)
"""Decrease of an angle from which contacts on creases and corners are searched for [rad]."""

APPARENT = 0.1
"""Apparent size from which a face is divided where the best of several normals counts: for smaller
ones the angle is at most 0.2 degrees too large [rad]."""


@merged
def _outside(ax, ay, az, cosine, sine, x, y, z, square):
    """Distance of a point from the inside of a cone about a unit vector, negative inside."""
    along = ax * x + ay * y + az * z
    return cosine * math.sqrt(max(square - along * along, 0.0)) - sine * along


@merged
def rank(node, v, own, count, worst, tree, surface, limits, cosine, sine):
    """Not negative where no contact of a node is within a limit; else the smaller the more likely.

    Args:
        node: The node.
        v: The vertex.
        own: Its normals, see `read_own`.
        count: Their number.
        worst: Whether the worst one counts, or the best one.
        tree: `FaceTree`.
        surface: `Surface`.
        limits: `PairLimits`.
        cosine: Cosine of the limit of the critical angle, not below 0.
        sine: Its sine.
    """
    if tree.bounds[node, 3] < 0.0:  # nothing in it
        return math.inf
    if count != 1:
        bound = upper_bound(node, v, own, count, worst, tree, surface, limits, cosine)
        return cosine - bound
    bounds, points = tree.bounds, surface.points
    nx, ny, nz = own[0, 0], own[0, 1], own[0, 2]
    ax, ay, az = bounds[node, 4], bounds[node, 5], bounds[node, 6]
    radius, cos_spread, sin_spread = bounds[node, 3], bounds[node, 7], bounds[node, 8]
    wide_cosine = cosine * cos_spread - sine * sin_spread
    wide_sine = sine * cos_spread + cosine * sin_spread
    if cos_spread > 0.0:  # else any normal is possible
        # Both angles add up to the angle between one normal and the reversed other one.
        least = wide_cosine * cosine - wide_sine * sine
        if wide_sine * cosine + wide_cosine * sine > 0.0 and -(ax * nx + ay * ny + az * nz) < least:
            return 0.0
    x, y = bounds[node, 0] - points[v, 0], bounds[node, 1] - points[v, 1]
    z = bounds[node, 2] - points[v, 2]
    square = x * x + y * y + z * z
    result = _outside(nx, ny, nz, cosine, sine, x, y, z, square) - radius
    if result < 0.0 and cos_spread > 0.0 and wide_sine > 0.0:
        other = _outside(-ax, -ay, -az, wide_cosine, wide_sine, x, y, z, square)
        result = max(result, other - radius)
    if result < 0.0 and limits.largest < math.inf:
        bound = upper_bound(node, v, own, count, worst, tree, surface, limits, cosine)
        if bound <= cosine:
            return 0.0
    return result


@merged
def _apparent_size(lines):
    """Length of a face's longest edge relative to the distance of its nearest corner."""
    nearest = math.inf
    for i in range(3):
        nearest = min(nearest, lines[i, 0] ** 2 + lines[i, 1] ** 2 + lines[i, 2] ** 2)
    return longest_difference(lines) / max(math.sqrt(nearest), 1e-6)


@part
def best_of_face(face, v, cosine, worst, centres, surface, own, count, largest, scratch):
    """Find the best contact of a vertex on a face; see `best_on_face`.

    Args:
        face: The face.
        v: The vertex.
        cosine: Cosine of the limit, not below 0.
        worst: Whether the worst normal of the vertex counts, or the best one.
        centres: Centre of each vertex's set of normals (V, 3).
        surface: `Surface`.
        own: The vertex's normals, see `read_own`.
        count: Their number.
        largest: Largest opening.
        scratch: What `make_scratch` returns; the first array holds the contact's weights.

    Returns:
        Cosine of the smallest critical angle, or `cosine`.
    """
    weights, lines, normals, polygon, nearest, part, _ = scratch
    if not aim(face, v, centres, surface, weights):
        return cosine
    read_face(face, v, surface, lines, normals)
    bend, found = longest_difference(normals), cosine
    # Directions near an arc or a polygon of normals form no convex region, either.
    several = count != 1 and not worst
    if several:
        bend = max(bend, _apparent_size(lines) * BENT / APPARENT)
    if bend <= BENT or not several:
        most = MOST_POINTS if bend <= BENT else 1
        found, resolved = best_on_face(
            weights, cosine, lines, normals, own, count, worst, largest, most, polygon, nearest
        )
        if bend <= BENT or (resolved and found == cosine):
            return found
    parts = int(min(bend / BENT + 1.0, MOST_PARTS))
    return best_on_bent_face(
        weights, found, lines, normals, own, count, worst, largest, parts, polygon, nearest, part
    )


@kernel
def make_scratch(most):
    """Scratch arrays of `best_of_face`, for vertices with at most so many normals."""
    return (
        np.empty(3),
        np.empty((3, 3)),
        np.empty((3, 3)),
        np.empty((2 * REGION_CORNERS, 3)),
        np.empty(3),
        (np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3)), np.empty(3)),
        np.empty((max(most, 2), 12)),
    )


@part
def _best_there(
    face, v, cosine, worst, owners, centres, surface, sets, own, count, largest, scratch
):
    """Cosine of the best contact of a vertex on a face, or on its creases and corners."""
    if owners.shape[0] > 0:
        rows, weights = scratch[6], scratch[0]
        return best_on_creases(
            face, v, cosine, owners, surface, sets, own, count, largest, rows, weights
        )
    return best_of_face(face, v, cosine, worst, centres, surface, own, count, largest, scratch)


@part
def _best_on_surface(
    v, cosine, gain, worst, owners, skipped, tree, centres, surface, sets, own, count, limits,
    nodes, scratch, best,
):  # fmt: skip
    """Search for a contact of a vertex above a cosine; (its face or -1, faces tried).

    Its barycentric coordinates are written to `best`; `skipped` is a face that is left out.
    """
    size, depth = tree.order.shape[0], tree.depth
    first_leaf = (1 << depth) - 1
    sine = math.sqrt(max(1.0 - cosine * cosine, 0.0))
    best_face, face_count = -1, 0
    nodes[0], top, stale = 0, 1, 0
    while top > 0:
        top -= 1
        node = nodes[top]
        if top < stale:  # it was ranked before a contact was found
            stale = top
            if rank(node, v, own, count, worst, tree, surface, limits, cosine, sine) >= 0.0:
                continue
        if node < first_leaf:
            one, two = 2 * node + 1, 2 * node + 2
            low = rank(one, v, own, count, worst, tree, surface, limits, cosine, sine)
            high = rank(two, v, own, count, worst, tree, surface, limits, cosine, sine)
            if high < low:
                one, two, low, high = two, one, high, low
            # The more likely half is searched first: it lowers the limit for the other.
            if high < 0.0:
                nodes[top] = two
                top += 1
            if low < 0.0:
                nodes[top] = one
                top += 1
            continue
        leaf = node - first_leaf
        for i in range(size * leaf >> depth, size * (leaf + 1) >> depth):
            face = tree.order[i]
            if face == skipped:
                continue
            face_count += 1
            found = _best_there(
                face, v, cosine, worst, owners, centres, surface, sets, own, count, limits.largest,
                scratch,
            )  # fmt: skip
            if found > cosine:
                best_face, angle = face, math.acos(min(found, 1.0)) - gain
                for k in range(3):
                    best[k] = scratch[0][k]
                if angle <= 0.0:
                    return best_face, face_count
                cosine, sine, stale = math.cos(angle), math.sin(angle), top
            if face_count == MOST_FACES:
                return best_face, face_count
    return best_face, face_count


@part
def _keep(v, face, weights, surface, sets, grasps, found):
    """Evaluate a contact; one beside an edge or corner of its face on that first.

    Where the surface is smooth there the two are the same, but for rounding.
    """
    inside = weights[0], weights[1], weights[2]
    beside = min(inside) < 2.0 * INSIDE
    if beside:
        for k in range(3):
            if weights[k] < 2.0 * INSIDE:
                weights[k] = 0.0
        total = weights[0] + weights[1] + weights[2]
        for k in range(3):
            weights[k] /= total
    for _ in range(2 if beside else 1):
        evaluate(v, face, weights, surface, sets, grasps, found)
        weights[0], weights[1], weights[2] = inside


@kernel
def descend_exactly(
    vertices, worst, owners, cone, most, tree, centres, surface, sets, limits, grasps
):
    """Find the opposing contact of each vertex with the smallest critical angle.

    The result depends on the order of the vertices by less than `RESOLVED`, for creases by less
    than `CREASE_GAIN`; by more where more than `MOST_FACES` faces are about equally good.

    Args:
        vertices: Vertices (n,), neighbours one after the other.
        worst: Whether the angle over the worst normals of the vertex is minimised, or that over its
            best normals.
        owners: Empty for contacts inside faces; what `faces_of_corners` returns (V,) for contacts
            exactly on creases and corners, over the best normals.
        cone: Largest angle that is searched for, at most pi / 2 [rad].
        most: Largest number of normals of a vertex, 1 at least.
        tree: `FaceTree`; for creases and corners with the bounds of `bound_creases`.
        centres: Centre of each vertex's set of normals (V, 3).
        surface: `Surface`.
        sets: `ContactNormals`.
        limits: `PairLimits`, of which the largest opening counts.
        grasps: `BestPairs`; written.

    Returns:
        Number of faces on which a contact was computed.
    """
    gain = CREASE_GAIN if owners.shape[0] > 0 else RESOLVED
    scratch, nodes = make_scratch(most), np.empty(STACK, dtype=np.int64)
    best, found, own = np.empty(3), np.empty((2, 3)), np.empty((most, 12))
    last, tried = tree.order[0], 0  # any face will do for the first vertex
    for v in vertices:
        if worst and sets.counts[v] == 0:
            continue  # among all directions the worst normal has no grasp
        limit = min(cone, grasps.worst[v] if worst else grasps.best[v]) - gain
        if limit <= 0.0:
            continue
        count, cosine = read_own(v, sets, own), math.cos(limit)
        better = _best_there(
            last, v, cosine, worst, owners, centres, surface, sets, own, count, limits.largest,
            scratch,
        )  # fmt: skip
        tried += 1
        if better > cosine:
            _keep(v, last, scratch[0], surface, sets, grasps, found)
            limit = math.acos(min(better, 1.0)) - gain
            if limit <= 0.0:
                continue
            cosine = math.cos(limit)
        face, faces = _best_on_surface(
            v, cosine, gain, worst, owners, last, tree, centres, surface, sets, own, count, limits,
            nodes, scratch, best,
        )  # fmt: skip
        tried += faces
        if face >= 0:
            _keep(v, face, best, surface, sets, grasps, found)
            last = face
    return tried
