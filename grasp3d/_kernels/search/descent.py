"""Branch and bound for opposing contacts: no direction is left out because no ray went there.

Rays sample the directions in which a vertex sees the surface. A good opposing contact on a thin
feature or near the edge of a flat face is seen under a small solid angle, between the rays. Here a
tree over the faces bounds from below the critical angle of every grasp of a vertex with its second
contact on the faces of a node; nodes that cannot improve the vertex's grasp are left out.

It is for fingers that squeeze: every point where a line leaves the object may be an opposing
contact, whatever lies between, so that a pair of points is a grasp without tracing a ray.

Vertices come in the order of the tree, so that the best face of one is nearly the best of the next:
with the limit that it gives, most of the search only proves that nothing is better. A node is left
out where no line to its ball is within the limit of the vertex's normal, or of the reversed normals
of the node; unlike angles, these cones cost a square root each.
"""

import math

import numpy as np

from grasp3d._kernels.compiling import kernel, merged, part
from grasp3d._kernels.search.antipodal_candidates import SMALLEST_OPENING, evaluate_on_face
from grasp3d._kernels.search.face_contacts import (
    INSIDE,
    aim,
    cosine_at,
    longest_difference,
    move_on_face,
    read_face,
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
from grasp3d._kernels.surface.turns import line_turn, turn_at_vertex
from grasp3d._kernels.surface.vectors import copy, difference, dot, norm, scaled, triple

MOST_FACES = 2000
"""Faces on which a contact is computed, per vertex, before the best one so far is taken: a bound on
the time where very many are equally good, as at the limit of openings on a ball."""


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
        own: Normals of the vertex (k, 3).
        domain: `PairDomain`.
        cosine: Cosine of the limit of the critical angle, not below 0.
        sine: Its sine.
    """
    bounds, limits = domain.tree.bounds[node], domain.limits
    radius, cos_spread, sin_spread = bounds[3], bounds[7], bounds[8]
    if own.shape[0] != 1 or domain.surface.turns.error > 0.0:
        return cosine - upper_bound(node, v, own, domain, cosine)
    normal, axis = triple(own[0], 0), scaled(-1.0, triple(bounds, 4))
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
    limited = limits.largest < math.inf or limits.smallest > SMALLEST_OPENING
    if result < 0.0 and limited and upper_bound(node, v, own, domain, cosine) <= cosine:
        return 0.0
    return result


@part
def best_of_face(face, v, cosine, own, domain, scratch):
    """Find the best contact of a vertex on a face; see `best_on_face`.

    With location errors it is the best of that for exact locations and of the lattice's points,
    moved on the face.

    Args:
        face: The face.
        v: The vertex.
        cosine: Cosine of the limit, not below 0.
        own: Normals of the vertex (k, 3).
        domain: `PairDomain`.
        scratch: What `make_scratch` returns; the first array holds the contact's weights.

    Returns:
        Cosine of the smallest critical angle, or `cosine`.
    """
    weights, lines, normals, polygon, nearest, part = scratch
    limits, turns, exact = domain.limits, domain.surface.turns, cosine
    if not aim(face, v, domain.centres, domain.surface, weights):
        return cosine
    read_face(face, v, domain.surface, lines, normals)
    if turns.error > 0.0:  # what is left of the limit for exact locations
        far = max(norm(lines[0]), norm(lines[1]), norm(lines[2]))
        one, other = turn_at_vertex(v, turns), turns.least[face]
        angle = math.acos(min(max(cosine, -1.0), 1.0)) - line_turn(far, turns)
        if angle <= max(one, other):
            return cosine
        exact = math.cos(angle - min(one, other))
    bend = longest_difference(normals)
    if bend <= BENT:
        better = best_on_face(weights, exact, lines, normals, own, limits, polygon, nearest)
    else:
        parts = int(min(bend / BENT + 1.0, MOST_PARTS))
        better = best_on_bent_face(
            weights, exact, lines, normals, own, limits, parts, polygon, nearest, part
        )
    if not turns.error > 0.0:
        return better
    return _best_of_lattice(face, v, cosine, own, domain, scratch) if better > exact else cosine


@part
def _best_of_lattice(face, v, limit, own, domain, scratch):
    """`best_of_face` with location errors, from its best contact for exact locations."""
    weights, lines, normals, _, nearest, _ = scratch
    parts = domain.surface.turns.levels[face]
    cosine = cosine_at(triple(weights, 0), v, face, lines, normals, own, domain)
    copy(weights, nearest)
    for j in range(parts + 1):
        for i in range(parts + 1 - j):
            y = INSIDE + (1.0 - 3.0 * INSIDE) * i / parts
            z = INSIDE + (1.0 - 3.0 * INSIDE) * j / parts
            place = 1.0 - y - z, y, z
            other = cosine_at(place, v, face, lines, normals, own, domain)
            if other > cosine:
                cosine = other
                copy(place, nearest)
    copy(nearest, weights)
    cosine = move_on_face(weights, cosine, v, face, lines, normals, own, domain)
    return max(cosine, limit)


@kernel()
def make_scratch():
    """Scratch arrays of `best_of_face`."""
    return (
        np.empty(3),
        np.empty((3, 3)),
        np.empty((3, 3)),
        np.empty((2 * REGION_CORNERS, 3)),
        np.empty(3),
        (np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3)), np.empty(3)),
    )


@merged
def _visit(node, _position, stale, state):
    """Visit a node of the tree; the better contacts found lower the limit."""
    v, own, domain, skipped, limit, best_face, scratch, best = state
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
        better = best_of_face(face, v, limit[0], own, domain, scratch)
        if better > limit[0]:
            best_face[0], angle, event = face, math.acos(min(better, 1.0)) - RESOLVED, CHANGED
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


@kernel("Ints1, float, PairDomain, BestPairs")
def descend(vertices, cone, domain, grasps):
    """Find the opposing contact of each vertex with the smallest critical angle.

    That over the worst normals of the vertex, and the worst locations. The result depends on the
    order of the vertices by less than `RESOLVED`; by more where more than `MOST_FACES` faces are
    about equally good, and with location errors, which are known at points only.

    Args:
        vertices: Vertices (n,), neighbours one after the other.
        cone: Largest angle that is searched for, at most pi / 2 [rad].
        domain: `PairDomain`.
        grasps: `BestPairs`; written.

    Returns:
        Number of faces on which a contact was computed.
    """
    surface, sets = domain.surface, domain.sets
    scratch, nodes = make_scratch(), np.empty(STACK, dtype=np.int64)
    best, at_contact = np.empty(3), np.empty((2, 3))
    limit, best_face = np.empty(2), np.zeros(2, dtype=np.int64)
    last, tried = domain.tree.order[0], 0  # any face will do for the first vertex
    for v in vertices:
        angle = min(cone, grasps.worst[v]) - RESOLVED
        if angle <= 0.0:
            continue
        own = sets.normals[sets.start[v] : sets.start[v] + sets.counts[v]]
        cosine = math.cos(angle)
        better = best_of_face(last, v, cosine, own, domain, scratch)
        tried += 1
        if better > cosine:
            _keep(v, last, scratch[0], surface, sets, grasps, at_contact)
            angle = math.acos(min(better, 1.0)) - RESOLVED
            if angle <= 0.0:
                continue
            cosine = math.cos(angle)
        limit[0], limit[1] = cosine, math.sqrt(max(1.0 - cosine * cosine, 0.0))
        best_face[0], best_face[1] = -1, 0
        walk(_visit, (v, own, domain, last, limit, best_face, scratch, best), nodes)
        tried += best_face[1]
        if best_face[0] >= 0:
            last = best_face[0]
            _keep(v, last, best, surface, sets, grasps, at_contact)
    return tried
