"""Branch and bound for opposing contacts: no direction is left out because no ray went there.

Rays sample the directions in which a vertex sees the surface. A good opposing contact on a thin
feature or near the edge of a flat face is seen under a small solid angle, between the rays. Here a
tree over the faces bounds from below the critical angle of every grasp of a vertex with its second
contact on the faces of a node; nodes that cannot improve the vertex's grasp are left out.

It is for fingers that squeeze: every point where a line leaves the object may be an opposing
contact, whatever lies between, so that a pair of points is a grasp without tracing a ray.

`descend` moves contacts over their faces in steps, where there is a smallest opening.
`descend_exactly` finds the smallest critical angle. Its vertices
come in the order of the tree, so that the best face of one is nearly the best of the next: with the
limit that it gives, most of the search only proves that nothing is better. A node is left out where
no line to its ball is within the limit of the vertex's normal, or of the reversed normals of the
node; unlike angles, these cones cost a square root each.
"""

import math

import numpy as np

from grasp3d._kernels.compiling import kernel, merged, part
from grasp3d._kernels.search.antipodal_candidates import evaluate_on_face
from grasp3d._kernels.search.crease_contacts import best_on_creases
from grasp3d._kernels.search.face_contacts import (
    INSIDE,
    NONE,
    OwnNormals,
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
    RESOLVED,
    best_on_bent_face,
    best_on_face,
)
from grasp3d._kernels.surface.face_tree import (
    CHANGED,
    GO_ON,
    NO_NODE,
    STACK,
    STOP,
    below,
    faces_of_leaf,
    walk,
)
from grasp3d._kernels.surface.polygons import REGION_CORNERS
from grasp3d._kernels.surface.vectors import copy, difference, dot, scaled, triple

MOST_FACES = 2000
"""Faces on which a contact is computed, per vertex, before the best one so far is taken: a bound on
the time where very many are equally good, as at the limit of openings on a ball."""


@merged
def _visit(node, position, _stale, state):
    """Visit a node of the tree; the better contacts found lower the limit."""
    v, domain, own, highs, limit, best_face, scratch, best = state
    surface, limits, tree = domain.surface, domain.limits, domain.tree
    weights, lines, normals = scratch
    if highs[position] <= limit[1]:
        return NO_NODE, NO_NODE, GO_ON
    later, sooner = below(node, tree.depth)
    if later != NO_NODE:
        one = upper_bound(later, v, own, domain, limit[1])
        other = upper_bound(sooner, v, own, domain, limit[1])
        # The more promising half is searched first: it lowers the limit for the other.
        if not one < other:
            later, sooner, one, other = sooner, later, other, one
        highs[position], highs[position + 1] = one, other
        return later, sooner, GO_ON
    event = GO_ON
    first, last = faces_of_leaf(node, tree.depth, tree.order.shape[0])
    for i in range(first, last):
        face = tree.order[i]
        best_face[1] += 1
        if not aim(face, v, domain.centres, surface, weights):
            continue
        read_face(face, v, surface, lines, normals)
        cosine = cosine_at(triple(weights, 0), lines, normals, own, limits)
        if cosine > NONE:
            turning = turning_speed(weights, lines, normals, tree.bounds[node, 7])
            cosine = move_on_face(weights, cosine, turning, limit[0], lines, normals, own, limits)
        if cosine > limit[1]:
            limit[0], limit[1], best_face[0] = math.acos(min(cosine, 1.0)), cosine, face
            copy(weights, best)
        if best_face[1] == MOST_FACES:
            event = STOP
    return NO_NODE, NO_NODE, event


@kernel("Ints1, bool, float, float, PairDomain, BestPairs")
def descend(vertices, worst, gain, cone, domain, grasps):
    """Search the whole surface for a clearly better opposing contact of each vertex.

    Args:
        vertices: Vertices (n,).
        worst: Whether the angle over the worst normals of the vertex is minimised, or that over its
            best normals.
        gain: Least decrease of the angle that is searched for [rad].
        cone: Largest angle that is searched for [rad].
        domain: `PairDomain`.
        grasps: `BestPairs`; written.
    """
    surface, sets = domain.surface, domain.sets
    nodes, highs = np.empty(STACK, dtype=np.int64), np.empty(STACK)
    scratch = np.empty(3), np.empty((3, 3)), np.empty((3, 3))
    best, at_contact = np.empty(3), np.empty((2, 3))
    limit, best_face = np.empty(2), np.empty(2, dtype=np.int64)
    rows = np.empty((max(sets.counts.max(), 1), 12))
    for v in vertices:
        if worst and sets.counts[v] == 0:
            continue  # among all directions the worst normal has no grasp
        limit[0] = min(cone, grasps.worst[v] if worst else grasps.best[v]) - gain
        if limit[0] <= 0.0:
            continue
        limit[1], highs[0], best_face[0], best_face[1] = math.cos(limit[0]), 1.0, -1, 0
        own = OwnNormals(rows, read_own(v, sets, rows), worst)
        walk(_visit, (v, domain, own, highs, limit, best_face, scratch, best), nodes)
        if best_face[0] >= 0:
            evaluate_on_face(v, 1, best_face[0], best, surface, sets, grasps, at_contact)


CREASE_GAIN = math.radians(0.25)
"""Decrease of an angle from which contacts on creases and corners are searched for [rad]."""

APPARENT = 0.1
"""Apparent size from which a face is divided where the best of several normals counts: for smaller
ones the angle is at most 0.2 degrees too large [rad]."""


@merged
def _outside(axis, cosine, sine, line):
    """Distance of a point from the inside of a cone about a unit vector, negative inside."""
    along = dot(axis, line)
    return cosine * math.sqrt(max(dot(line, line) - along * along, 0.0)) - sine * along


@merged
def rank(node, v, own, domain, cosine, sine):
    """Not negative where no contact of a node is within a limit; else the smaller the more likely.

    Args:
        node: The node.
        v: The vertex.
        own: `OwnNormals`.
        domain: `PairDomain`.
        cosine: Cosine of the limit of the critical angle, not below 0.
        sine: Its sine.
    """
    bounds = domain.tree.bounds[node]
    radius, cos_spread, sin_spread = bounds[3], bounds[7], bounds[8]
    if radius < 0.0:  # nothing in it
        return math.inf
    if own.size != 1:
        return cosine - upper_bound(node, v, own, domain, cosine)
    normal, axis = triple(own.rows[0], 0), scaled(-1.0, triple(bounds, 4))
    wide_cosine = cosine * cos_spread - sine * sin_spread
    wide_sine = sine * cos_spread + cosine * sin_spread
    if cos_spread > 0.0:  # else any normal is possible
        # Both angles add up to the angle between one normal and the reversed other one.
        least = wide_cosine * cosine - wide_sine * sine
        if wide_sine * cosine + wide_cosine * sine > 0.0 and dot(axis, normal) < least:
            return 0.0
    line = difference(bounds, domain.surface.points[v])
    result = _outside(normal, cosine, sine, line) - radius
    if result < 0.0 and cos_spread > 0.0 and wide_sine > 0.0:
        result = max(result, _outside(axis, wide_cosine, wide_sine, line) - radius)
    if (
        result < 0.0
        and domain.limits.largest < math.inf
        and upper_bound(node, v, own, domain, cosine) <= cosine
    ):
        return 0.0
    return result


@merged
def _apparent_size(lines):
    """Length of a face's longest edge relative to the distance of its nearest corner."""
    nearest = min(dot(lines[0], lines[0]), dot(lines[1], lines[1]), dot(lines[2], lines[2]))
    return longest_difference(lines) / max(math.sqrt(nearest), 1e-6)


@part
def best_of_face(face, v, cosine, own, domain, scratch):
    """Find the best contact of a vertex on a face; see `best_on_face`.

    Args:
        face: The face.
        v: The vertex.
        cosine: Cosine of the limit, not below 0.
        own: `OwnNormals`.
        domain: `PairDomain`.
        scratch: What `make_scratch` returns; the first array holds the contact's weights.

    Returns:
        Cosine of the smallest critical angle, or `cosine`.
    """
    weights, lines, normals, polygon, nearest, part, _ = scratch
    largest = domain.limits.largest
    if not aim(face, v, domain.centres, domain.surface, weights):
        return cosine
    read_face(face, v, domain.surface, lines, normals)
    bend = longest_difference(normals)
    # Directions near an arc or a polygon of normals form no convex region, either.
    if own.size != 1 and not own.worst:
        bend = max(bend, _apparent_size(lines) * BENT / APPARENT)
    if bend <= BENT:
        return best_on_face(weights, cosine, lines, normals, own, largest, polygon, nearest)
    parts = int(min(bend / BENT + 1.0, MOST_PARTS))
    return best_on_bent_face(
        weights, cosine, lines, normals, own, largest, parts, polygon, nearest, part
    )


@kernel()
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
def _best_there(face, v, cosine, owners, own, domain, scratch):
    """Cosine of the best contact of a vertex on a face, or on its creases and corners."""
    if owners.shape[0] > 0:
        return best_on_creases(face, v, cosine, owners, own, domain, scratch[6], scratch[0])
    return best_of_face(face, v, cosine, own, domain, scratch)


@merged
def _visit_exactly(node, _position, stale, state):
    """Visit a node of the tree; the better contacts found lower the limit."""
    v, owners, own, domain, skipped, gain, limit, best_face, scratch, best = state
    tree, cosine, sine = domain.tree, limit[0], limit[1]
    # Else it was ranked since a contact was found.
    if stale and rank(node, v, own, domain, cosine, sine) >= 0.0:
        return NO_NODE, NO_NODE, GO_ON
    later, sooner = below(node, tree.depth)
    if later != NO_NODE:
        one = rank(later, v, own, domain, cosine, sine)
        other = rank(sooner, v, own, domain, cosine, sine)
        # The more likely half is searched first: it lowers the limit for the other.
        if not other < one:
            later, sooner, one, other = sooner, later, other, one
        return later if one < 0.0 else NO_NODE, sooner if other < 0.0 else NO_NODE, GO_ON
    event = GO_ON
    first, last = faces_of_leaf(node, tree.depth, tree.order.shape[0])
    for i in range(first, last):
        face = tree.order[i]
        if face == skipped:
            continue
        best_face[1] += 1
        better = _best_there(face, v, limit[0], owners, own, domain, scratch)
        if better > limit[0]:
            best_face[0], angle, event = face, math.acos(min(better, 1.0)) - gain, CHANGED
            copy(scratch[0], best)
            if angle <= 0.0:
                return NO_NODE, NO_NODE, STOP
            limit[0], limit[1] = math.cos(angle), math.sin(angle)
        if best_face[1] == MOST_FACES:
            return NO_NODE, NO_NODE, STOP
    return NO_NODE, NO_NODE, event


@part
def _keep(v, face, weights, surface, sets, grasps, at_contact):
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
        evaluate_on_face(v, 1, face, weights, surface, sets, grasps, at_contact)
        weights[0], weights[1], weights[2] = inside


@kernel("Ints1, bool, Ints1, float, PairDomain, BestPairs")
def descend_exactly(vertices, worst, owners, cone, domain, grasps):
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
        domain: `PairDomain`, of whose limits the largest opening counts; for creases and corners
            its tree has the bounds of `bound_creases`.
        grasps: `BestPairs`; written.

    Returns:
        Number of faces on which a contact was computed.
    """
    gain = CREASE_GAIN if owners.shape[0] > 0 else RESOLVED
    surface, sets, most = domain.surface, domain.sets, max(domain.sets.counts.max(), 1)
    scratch, nodes = make_scratch(most), np.empty(STACK, dtype=np.int64)
    best, at_contact, rows = np.empty(3), np.empty((2, 3)), np.empty((most, 12))
    limit, best_face = np.empty(2), np.zeros(2, dtype=np.int64)
    last, tried = domain.tree.order[0], 0  # any face will do for the first vertex
    for v in vertices:
        if worst and sets.counts[v] == 0:
            continue  # among all directions the worst normal has no grasp
        angle = min(cone, grasps.worst[v] if worst else grasps.best[v]) - gain
        if angle <= 0.0:
            continue
        own, cosine = OwnNormals(rows, read_own(v, sets, rows), worst), math.cos(angle)
        better = _best_there(last, v, cosine, owners, own, domain, scratch)
        tried += 1
        if better > cosine:
            _keep(v, last, scratch[0], surface, sets, grasps, at_contact)
            angle = math.acos(min(better, 1.0)) - gain
            if angle <= 0.0:
                continue
            cosine = math.cos(angle)
        limit[0], limit[1] = cosine, math.sqrt(max(1.0 - cosine * cosine, 0.0))
        best_face[0], best_face[1] = -1, 0
        state = v, owners, own, domain, last, gain, limit, best_face, scratch, best
        walk(_visit_exactly, state, nodes)
        tried += best_face[1]
        if best_face[0] >= 0:
            last = best_face[0]
            _keep(v, last, best, surface, sets, grasps, at_contact)
    return tried
