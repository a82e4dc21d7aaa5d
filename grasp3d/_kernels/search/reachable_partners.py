"""The best opposing contact of a vertex that a gripper reaches.

The tree of faces is searched best first: among all waiting nodes and contacts, the one with the
smallest bound of the critical angle comes next, so contacts come in the order of their critical
angles. Each is tested with the gripper until one is reached. Contacts near a tested one usually
have the same outcome, so those that are little worse are passed over. The contact that is reached
is moved toward the better one near it.
"""

import math

import numpy as np

from grasp3d._kernels.compiling import kernel, part
from grasp3d._kernels.jaws.gripper_parts import BLOCKED, NONE
from grasp3d._kernels.jaws.reaching import can_reach, reach_pair
from grasp3d._kernels.search.antipodal_candidates import evaluate_on_face
from grasp3d._kernels.search.face_contacts import (
    aim,
    cosine_at,
    move_on_face,
    read_face,
    upper_bound,
    write_nearest,
)
from grasp3d._kernels.surface.face_tree import NO_NODE, below, faces_of_leaf
from grasp3d._kernels.surface.surface_contacts import largest_angle, point_on_face, write_normals
from grasp3d._kernels.surface.vectors import (
    combined,
    copy,
    cross,
    difference,
    divided,
    norm,
    scaled,
    squared_distance,
    triple,
)

MOST_WAITING = 2048
"""Most nodes and contacts that can wait; further ones are passed over."""

MOST_STEPS = 6000
"""Most nodes and contacts that are taken per vertex."""

ACCURATE = -math.cos(0.005)
"""Key of the critical angle up to which a contact is not moved on its face to reduce it."""

GROWTH = 1.4
"""Factor by which the step near a contact grows with each failure there."""

BISECTIONS = 4
"""Most passed-over contacts that are tested if a worse one near them is reached."""

FIRST_KEY, LAST_KEY = -2.0, 2.0
"""Keys below and above those of all contacts."""


@part
def _push(keys, entries, size, key, entry):
    """Insert an entry into a binary heap; return the new size."""
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
    """Remove the smallest entry from a binary heap; return the new size."""
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
def _passes_over(point, radius, key, others, until, count, spacing):
    """Find the first tested contact due to which a ball is passed over for now, -1 if none.

    Args:
        point: Centre of the ball.
        radius: Radius of the ball.
        key: Smallest key that counts.
        others: Contacts that were tested (t, 3).
        until: Key up to which contacts near each tested one are passed over (t,).
        count: Number of tested contacts.
        spacing: Distance up to which contacts count as near.
    """
    for i in range(count):
        near = key < until[i] and math.sqrt(squared_distance(point, others[i])) + radius < spacing
        if near:
            return i
    return -1


@part
def _pass_over(key, point, step, others, until, steps, count, spacing):
    """Record that a contact was tested and not reached; contacts near it follow in wider steps.

    Contacts near it that are about as good are usually not reached either.
    """
    for i in range(count):
        if math.sqrt(squared_distance(point, others[i])) < spacing:
            step = max(step, GROWTH * steps[i])
    copy(point, others[count])
    steps[count] = step
    until[count] = math.inf
    if step < math.inf:
        until[count] = -math.cos(min(math.acos(min(max(-key, -1.0), 1.0)) + step, math.pi))


@part
def _write_pair(v, face, weights, domain, scratch):
    """Write the contacts of a vertex and a point on a face, and their normals.

    Returns:
        Whether both contacts have normals.
    """
    points, normals, set_normals = scratch
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
            return False
        copy(divided(normals[i], length), normals[i])
    return True


@part
def _is_reached(v, face, weights, domain, reaching, scratch):
    """Whether the grasp of a vertex and a point on a face is reached."""
    shape, limits, tree, workspace = reaching
    return _write_pair(v, face, weights, domain, scratch) and can_reach(
        scratch[0], scratch[1], 1, shape, limits, tree, workspace
    )


@kernel()
def _make_scratch():
    """Allocate the scratch arrays of `_write_pair`: contacts, their normals, a set of normals."""
    return np.empty((2, 3)), np.empty((2, 3)), np.empty((2, 3))


@kernel(
    "Ints1, Ints1, Floats2, PairDomain, "
    "tuple[GripperShape, ApproachLimits, BoxTree, ReachWorkspace], BestPairs"
)
def keep_reached(vertices, faces, weights, domain, reaching, grasps):
    """Keep those given grasps that are reached and better than the known ones.

    Args:
        vertices: Vertices (n,).
        faces: Faces of the opposing contacts, -1 for none (n,).
        weights: Barycentric coordinates (n, 3).
        domain: `PairDomain`.
        reaching: (shape, limits, tree, workspace), as for `can_reach`.
        grasps: `BestPairs` of reached grasps; written.
    """
    scratch, surface, sets = _make_scratch(), domain.surface, domain.sets
    point, set_normals = scratch[0][1], scratch[2]
    for i in range(len(vertices)):
        v, face, own = vertices[i], faces[i], weights[i]
        if face < 0:
            continue
        copy(point_on_face(face, own, surface), point)
        line = difference(point, surface.points[v])
        opening = norm(line)
        if opening < 1e-9:
            continue
        # With a lower bound of the angle, only grasps that would be kept are tested.
        x, y, z = scaled(1.0 / opening, line)
        low = largest_angle(sets.normals, sets.start[v], sets.counts[v], x, y, z)
        if low >= grasps.worst[v]:
            continue
        if _is_reached(v, face, own, domain, reaching, scratch):
            evaluate_on_face(v, 1, face, own, surface, sets, grasps, set_normals)


@kernel(
    "Ints1, Ints1, Floats2, PairDomain, "
    "tuple[GripperShape, ApproachLimits, BoxTree, ReachWorkspace], ReachResults"
)
def reach_partners(vertices, faces, weights, domain, reaching, results):
    """Find how grasps of vertices and points on faces are reached, or why not.

    Args:
        vertices: Vertices (n,).
        faces: Faces of the opposing contacts (n,).
        weights: Barycentric coordinates (n, 3).
        domain: `PairDomain`.
        reaching: (shape, limits, tree, workspace), as for `can_reach`.
        results: `ReachResults`, one row per vertex; written.
    """
    scratch, (shape, limits, tree, workspace) = _make_scratch(), reaching
    for i in range(len(vertices)):
        v = vertices[i]
        results.codes[v], results.free[v] = BLOCKED, NONE
        if _write_pair(v, faces[i], weights[i], domain, scratch):
            results.codes[v], results.free[v] = reach_pair(
                scratch[0], scratch[1], 1, shape, limits, tree, workspace, results.found[v]
            )


@kernel(
    "Ints1, Floats1, float, float, int, PairDomain, "
    "tuple[GripperShape, ApproachLimits, BoxTree, ReachWorkspace]"
)
def search_reachable(vertices, limit, step, spacing, most_failed, domain, reaching):
    """Find, for each vertex, the opposing contact with the smallest angle that is reached.

    It is for fingers that squeeze.

    Args:
        vertices: Vertices (n,).
        limit: Angle to be improved, for each vertex [rad] (n,).
        step: Difference of angles after which contacts near one that is not reached are tested
            [rad]; inf to test none of them.
        spacing: Distance up to which contacts count as near.
        most_failed: Number of tested contacts not reached at which a vertex's search ends.
        domain: `PairDomain`.
        reaching: (shape, limits, tree, workspace), as for `can_reach`.

    Returns:
        Faces (n,), -1 for none, and barycentric coordinates (n, 3) of the contacts.
    """
    surface, sets, tree = domain.surface, domain.sets, domain.tree
    # The smallest key is at the top of the heap: keys are negative cosines.
    keys, entries = np.empty(MOST_WAITING), np.empty(MOST_WAITING, dtype=np.int64)
    partner_faces = np.full(len(vertices), -1, dtype=np.int64)
    partner_weights = np.zeros((len(vertices), 3))
    contact_faces = np.empty(MOST_STEPS, dtype=np.int64)
    contact_weights, weights = np.empty((MOST_STEPS, 3)), np.empty(3)
    passed = np.empty(MOST_STEPS, dtype=np.int64)
    tested, until = np.empty((most_failed, 3)), np.empty(most_failed)
    steps = np.empty(most_failed)
    lines, corner_normals = np.empty((3, 3)), np.empty((3, 3))
    room = weights, lines, corner_normals
    scratch = _make_scratch()
    point = scratch[0][1]
    for row in range(len(vertices)):
        v, least = vertices[row], math.cos(min(limit[row], math.pi))
        own = sets.normals[sets.start[v] : sets.start[v] + sets.counts[v]]
        contacts, failed, passes = 0, 0, 0
        waiting = _push(keys, entries, 0, -1.0, 0)
        for _ in range(MOST_STEPS):
            if waiting == 0 or failed == most_failed:
                break
            entry, key = entries[0], keys[0]
            waiting = _pop(keys, entries, waiting)
            if entry < 0:
                contact = -1 - entry
                face, chosen = contact_faces[contact], contact_weights[contact]
                copy(point_on_face(face, chosen, surface), point)
                if _passes_over(point, 0.0, key, tested, until, failed, spacing) >= 0:
                    passed[passes] = contact
                    passes += 1
                    continue
                beside = _passes_over(point, 0.0, FIRST_KEY, tested, until, failed, spacing)
                if key > ACCURATE and beside < 0:
                    read_face(face, v, surface, lines, corner_normals)
                    key = -move_on_face(chosen, -key, v, face, lines, corner_normals, own, domain)
                if _is_reached(v, face, chosen, domain, reaching, scratch):
                    if beside >= 0:
                        face = _bisect(
                            v, face, chosen, passed[:passes], contact_faces, tested[beside],
                            own, room, domain, reaching, scratch,
                        )  # fmt: skip
                    partner_faces[row] = face
                    copy(chosen, partner_weights[row])
                    break
                _pass_over(key, point, step, tested, until, steps, failed, spacing)
                failed += 1
                continue
            ball = tree.bounds[entry]
            if _passes_over(ball, ball[3], LAST_KEY, tested, until, failed, spacing) >= 0:
                continue  # near a contact that was tested while this node waited
            for half in below(entry, tree.depth):
                if half == NO_NODE:
                    continue
                one, other = below(half, tree.depth)  # two levels at once are faster
                for child in (half, NO_NODE) if one == NO_NODE else (one, other):
                    if child == NO_NODE:
                        continue
                    high = upper_bound(child, v, own, domain, least)
                    if high <= least or waiting == MOST_WAITING:
                        continue
                    ball = tree.bounds[child]
                    if _passes_over(ball, ball[3], LAST_KEY, tested, until, failed, spacing) < 0:
                        waiting = _push(keys, entries, waiting, -high, child)
            first, last = faces_of_leaf(entry, tree.depth, tree.order.shape[0])
            for i in range(first, last):
                face = tree.order[i]
                if contacts == MOST_STEPS or not aim(face, v, domain.centres, surface, weights):
                    continue
                copy(point_on_face(face, weights, surface), point)
                if _passes_over(point, 0.0, LAST_KEY, tested, until, failed, spacing) >= 0:
                    continue
                read_face(face, v, surface, lines, corner_normals)
                inside = triple(weights, 0)
                cosine = cosine_at(inside, v, face, lines, corner_normals, own, domain)
                if cosine > least and waiting < MOST_WAITING:
                    contact_faces[contacts] = face
                    copy(weights, contact_weights[contacts])
                    contacts += 1
                    waiting = _push(keys, entries, waiting, -cosine, -contacts)
    return partner_faces, partner_weights


@part
def _bisect(v, face, chosen, passed, faces, failing, own, room, domain, reaching, scratch):
    """Move a reached contact as far as possible toward a better one that is not reached.

    Args:
        v: The vertex.
        face: Face of the contact.
        chosen: Barycentric coordinates of the contact (3,); written.
        passed: Rows of contacts passed over (p,).
        faces: Faces of all contacts (c,).
        failing: The near contact that is not reached (3,).
        own: Normals of the vertex (k, 3).
        room: Scratch for weights, lines and normals.
        domain: `PairDomain`.
        reaching: As in `search_reachable`.
        scratch: As in `_write_pair`.

    Returns:
        Face of the contact.
    """
    surface = domain.surface
    weights, lines, normals = room
    low, high = triple(failing, 0), point_on_face(face, triple(chosen, 0), surface)
    read_face(face, v, surface, lines, normals)
    best = cosine_at(triple(chosen, 0), v, face, lines, normals, own, domain)
    for _ in range(BISECTIONS):
        middle = combined(0.5, low, 0.5, high)
        other, least = face, _place(face, middle, surface, weights)
        for i in range(len(passed)):
            square = _place(faces[passed[i]], middle, surface, weights)
            if square < least:
                other, least = faces[passed[i]], square
        _place(other, middle, surface, weights)
        read_face(other, v, surface, lines, normals)
        cosine = cosine_at(triple(weights, 0), v, other, lines, normals, own, domain)
        if cosine > best and _is_reached(v, other, weights, domain, reaching, scratch):
            face, best, high = other, cosine, point_on_face(other, triple(weights, 0), surface)
            copy(weights, chosen)
        else:
            low = middle
    return face


@part
def _place(face, point, surface, weights):
    """Write the point on a face approximately nearest to another; return their squared distance."""
    a = triple(surface.points[surface.faces[face, 0]], 0)
    b, c = surface.points[surface.faces[face, 1]], surface.points[surface.faces[face, 2]]
    u, w = difference(b, a), difference(c, a)
    write_nearest(difference(point, a), u, w, cross(u, w), weights)
    return squared_distance(point_on_face(face, triple(weights, 0), surface), point)
