"""Search for the best grasps of three or more fingers through the vertices of a surface.

The first grasps of three fingers combine the vertex with pairs of candidate points; those of more
fingers extend grasps of one finger less. They are improved by moving and by exchanging fingers.

Grasps of three fingers are also moved by steps toward balance without friction.
Three normals balance if they lie in the plane through the contacts and meet in a point. These are
four equations for two contacts on a surface, each with two coordinates. So most smooth surfaces
have such grasps through every point. Newton's method finds the one near a start in a few steps,
where random steps would have to shrink by a constant factor each.
"""

import math

import numpy as np

from grasp3d._kernels.compiling import merged, scratch_kernel
from grasp3d._kernels.search.coplanar_contacts import set_contact_plane
from grasp3d._kernels.search.multifinger_grasps import (
    NO_CONTACT,
    RIGHT_ANGLE,
    STARTS,
    distances_allowed,
    evaluate,
    evaluate_if_allowed,
    is_allowed,
    keep_or_undo,
    load_grasp,
    set_contact,
    set_current,
    set_finger,
    set_point_contact,
    set_vertex_contact,
    store_grasp,
    walk_finger,
)
from grasp3d._kernels.surface.surface_contacts import random_fraction
from grasp3d._kernels.surface.vectors import cross, difference, divided, dot, norm, squared_distance

STEPS = 8
"""Most steps toward balance."""

NUDGE = 1e-3
"""Length of the steps for derivatives, less than an edge because normals are smooth only between
creases."""

DAMPING = 1e-4
"""Term added to the diagonal of the normal equations, relative to their trace: on flat parts of the
surface some steps change nothing."""

LONGEST = 0.3
"""Longest step of a finger."""

SHORTENING, TRIES = 0.3, 3
"""Factor by which a step without improvement is shortened, and number of steps tried."""

TINY = 1e-12


@merged
def _write_residuals(candidate, residuals):
    """Write the elevations of the normals over the plane and how far they miss a common point (4,).

    The latter is the moment of multiples of the normals whose forces balance, for multiples and
    lever arms of about 1.
    """
    points, normals = candidate.points, candidate.normals
    a, b = difference(points[1], points[0]), difference(points[2], points[0])
    up = cross(a, b)
    up = divided(up, max(norm(up), TINY))
    for i in range(3):
        residuals[i] = dot(normals[i], up)
    second = dot(cross(normals[2], normals[0]), up)
    third = dot(cross(normals[0], normals[1]), up)
    moment = second * dot(cross(a, normals[1]), up) + third * dot(cross(b, normals[2]), up)
    residuals[3] = moment / max(abs(second) * norm(a) + abs(third) * norm(b), TINY)


@merged
def _write_step(domain, workspace):
    """Write the two fingers' Gauss-Newton step toward balance in the last column."""
    residuals, equations = workspace.residuals, workspace.equations
    _write_residuals(workspace.candidate, residuals[4])
    for c in range(4):
        j = 1 + c // 2
        walk_finger(j, 0.5 * math.pi * (c % 2), NUDGE, domain, workspace)
        _write_residuals(workspace.candidate, residuals[c])
        set_current(j, domain, workspace)
        for k in range(4):
            residuals[c, k] = (residuals[c, k] - residuals[4, k]) / NUDGE
    trace = 0.0
    for r in range(4):
        for c in range(5):
            equations[r, c] = 0.0
            for k in range(4):
                equations[r, c] += residuals[r, k] * residuals[c, k]
        trace += equations[r, r]
    for r in range(4):
        equations[r, r] += DAMPING * trace + TINY
    # Positive definite, so pivoting is unnecessary.
    for k in range(4):
        for r in range(4):
            if r != k:
                factor = equations[r, k] / equations[k, k]
                for c in range(k + 1, 5):
                    equations[r, c] -= factor * equations[k, c]
    for r in range(4):
        equations[r, 4] /= -equations[r, r]


@merged
def may_balance(v, domain):
    """Whether fingers move freely and the vertex has a single normal: caps do not balance."""
    return not domain.on_vertices and domain.radii[v] == 0.0


@merged
def balance(angle, domain, limits, workspace, plane, hull):
    """Improve the current grasp of three fingers by steps toward balance without friction.

    Returns:
        The critical angle of the improved grasp [rad].
    """
    equations = workspace.equations
    for _ in range(STEPS):
        if angle <= limits.target:
            break
        _write_step(domain, workspace)
        share = 1.0
        for r in (0, 2):
            share = min(
                share, LONGEST / max(math.hypot(equations[r, 4], equations[r + 1, 4]), TINY)
            )
        changed = math.inf
        for _ in range(TRIES):
            fits = True
            for j in range(1, 3):
                x, y = equations[2 * j - 2, 4], equations[2 * j - 1, 4]
                length = share * math.hypot(x, y)
                fits = walk_finger(j, math.atan2(y, x), length, domain, workspace) and fits
            changed = evaluate_if_allowed(
                fits, 3, angle - limits.margin, limits, workspace, plane, hull
            )
            if changed < math.inf:
                break
            share *= SHORTENING
        keep_or_undo(changed < math.inf, 0, 3, domain, workspace)
        if changed == math.inf:
            break
        angle = changed
    return angle


MAX_PAIRINGS = 128
"""Number of following points with which a candidate point is paired: consecutive points are well
spread, and the work grows linearly with the number of points."""


@merged
def list_reachable(v, most, domain, limits, workspace):
    """List candidate points at allowed distances from a vertex, its own point first.

    Each vertex starts elsewhere in the list, so that neighbours find grasps from different points.

    Returns:
        Their number, at most `most` + 1.
    """
    candidates, count = domain.candidates, 0
    if candidates.own[v] != NO_CONTACT:
        workspace.reachable[0] = candidates.own[v]
        count = 1
    for k in range(candidates.common_count):
        if count > most:
            break
        s = (k + v * most) % candidates.common_count
        if is_allowed(candidates.points[s], domain.surface.points[v], limits):
            workspace.reachable[count] = s
            count += 1
    return count


@merged
def _keep_start(angle, one, two, workspace):
    """Insert a pair into the sorted list of the best starts, which share no points.

    A better pair that shares a point with a start replaces it. Starts that differ in both points
    lead the refinement to different optima.
    """
    angles, pairs = workspace.angles, workspace.start_points
    row = STARTS - 1
    for k in range(STARTS):
        shared = one in (pairs[k, 0], pairs[k, 1]) or two in (pairs[k, 0], pairs[k, 1])
        if angles[k] < math.inf and shared:
            if angle >= angles[k]:
                return
            row = k
            break
    if angle >= angles[row]:
        return
    while row > 0 and angle < angles[row - 1]:
        angles[row] = angles[row - 1]
        pairs[row, 0], pairs[row, 1] = pairs[row - 1, 0], pairs[row - 1, 1]
        row -= 1
    angles[row] = angle
    pairs[row, 0], pairs[row, 1] = one, two


@merged
def seed_pairs(count, most, domain, limits, workspace, plane, hull):
    """Evaluate pairs of reachable candidate points as second and third contacts of a vertex."""
    candidate = workspace.candidate
    for k in range(STARTS):
        workspace.angles[k] = math.inf
    for a in range(count):
        one = workspace.reachable[a]
        if not set_point_contact(1, one, domain, candidate):
            continue
        # The vertex's own point, its opposing contact for two fingers, is paired with all others.
        last = count if a == 0 else min(count, a + 1 + MAX_PAIRINGS)
        for b in range(a + 1, last):
            two = workspace.reachable[b]
            if not (
                set_point_contact(2, two, domain, candidate)
                and distances_allowed(candidate, 2, 2, limits)
            ):
                continue
            workspace.evaluated[0] += 1
            threshold = min(workspace.angles[STARTS - 1] - limits.margin, most)
            if threshold > 0.0:
                angle = evaluate(candidate, plane, hull, 3, threshold, limits.tolerance)
                if angle < math.inf:
                    _keep_start(angle, one, two, workspace)


@merged
def first_pair(count, domain, limits, workspace, plane):
    """Take the first allowed pair of candidate points, if any critical angle is accepted."""
    candidate = workspace.candidate
    for a in range(count):
        for b in range(a + 1, count):
            one, two = workspace.reachable[a], workspace.reachable[b]
            if workspace.angles[0] == math.inf and (
                set_point_contact(1, one, domain, candidate)
                and set_point_contact(2, two, domain, candidate)
                and distances_allowed(candidate, 2, 2, limits)
                and set_contact_plane(candidate.points, plane)
            ):
                workspace.angles[0] = RIGHT_ANGLE
                workspace.start_points[0, 0], workspace.start_points[0, 1] = one, two


STEP_GROWTH, STEP_SHRINKAGE = 1.6, 0.88
"""Factors of the step length after a step that improves the grasp, and after one that does not."""

SINGLE_FINGER_FRACTION = 0.5
"""Fraction of the steps that move only one finger."""

MAX_EDGES = 8
"""Most edges that a finger moves along in one step if contacts are vertices."""


@merged
def _move_finger(j, step, domain, limits, workspace):
    """Vary finger j of the current grasp at random, by up to two steps; return as `set_contact`."""
    elements, random_state = workspace.elements, workspace.random_state
    length = 2.0 * step * random_fraction(random_state)
    # A random walk along edges, or a straight walk in a random direction.
    if not domain.on_vertices:
        angle = 2.0 * math.pi * random_fraction(random_state)
        return walk_finger(j, angle, length, domain, workspace)
    vertex = elements[0, j]
    # The step in edges: even one shorter than an edge moves the finger.
    hops = min(MAX_EDGES, 1 + int(length / limits.edge_length))
    for _ in range(hops):
        first, last = domain.neighbour_start[vertex], domain.neighbour_start[vertex + 1]
        if last > first:
            vertex = domain.neighbours[first + int(random_fraction(random_state) * (last - first))]
    elements[1, j] = vertex
    return set_contact(j, vertex, workspace.weights[1, j], domain, workspace)


@merged
def refine(n, angle, step, rounds, domain, limits, workspace, plane, hull):
    """Improve the current grasp by random steps of its fingers.

    An evolution strategy with success-based step lengths (Rechenberg 1973). The critical angle is a
    maximum over directions and hence not differentiable: moving one finger at a time would stop at
    creases of the function that only several fingers together can leave.

    Returns:
        The critical angle of the refined grasp [rad].
    """
    for _ in range(rounds):
        # On vertices, every step moves a finger by at least one edge, however short it is.
        if angle <= limits.target or (step < limits.shortest_step and not domain.on_vertices):
            break
        moved = 0  # all fingers
        if random_fraction(workspace.random_state) < SINGLE_FINGER_FRACTION:
            moved = 1 + int(random_fraction(workspace.random_state) * (n - 1))
        fits = True
        for j in range(1, n):
            if moved in (0, j):
                fits = _move_finger(j, step, domain, limits, workspace) and fits
        changed = evaluate_if_allowed(
            fits, n, angle - limits.margin, limits, workspace, plane, hull
        )
        # The step grows after a success and shrinks after a failure, which keeps it constant at a
        # success rate of about 1/5, nearly the optimum (Rechenberg 1973).
        better = changed < math.inf
        if better:
            angle = changed
        step *= STEP_GROWTH if better else STEP_SHRINKAGE
        keep_or_undo(better, moved, n, domain, workspace)
    return angle


@merged
def _best_point(i, n, angle, count, domain, limits, workspace, plane, hull):
    """Find the candidate point of finger i with the best grasp: (point or NO_CONTACT, angle)."""
    candidate, chosen = workspace.candidate, NO_CONTACT
    for s in range(count):
        point, threshold = workspace.reachable[s], angle - limits.margin
        if threshold <= 0.0:
            break
        if not (
            set_point_contact(i, point, domain, candidate)
            and distances_allowed(candidate, i, n, limits)
        ):
            continue
        workspace.evaluated[0] += 1
        changed = evaluate(candidate, plane, hull, n, threshold, limits.tolerance)
        if changed < math.inf:
            chosen, angle = point, changed
    return chosen, angle


@merged
def _most_distant_point(i, n, count, domain, limits, workspace):
    """Find the reachable point farthest from the other contacts, for a finger without benefit."""
    candidate, chosen, widest = workspace.candidate, NO_CONTACT, 0.0
    for s in range(count):
        point = workspace.reachable[s]
        if not (
            set_point_contact(i, point, domain, candidate)
            and distances_allowed(candidate, i, n, limits)
        ):
            continue
        least = math.inf
        for j in range(n):
            if j != i:
                least = min(least, squared_distance(candidate.points[i], candidate.points[j]))
        if least > widest:
            chosen, widest = point, least
    return chosen


@merged
def exchange_fingers(n, added, angle, count, domain, limits, workspace, plane, hull):
    """Move one finger after the other to the reachable candidate point with the best grasp.

    Args:
        n: Number of fingers.
        added: Whether the last finger is new; it is placed first, even without improvement.
        angle: Critical angle of the current grasp without the new finger [rad].
        count: Number of reachable candidate points.
        domain: `ContactDomain`.
        limits: `SearchLimits`.
        workspace: `SearchWorkspace`.
        plane: As for `evaluate`.
        hull: As for `evaluate`.

    Returns:
        The critical angle [rad]; inf if the new finger cannot be placed.
    """
    for turn in range(1, n):
        i = turn
        if added:
            i = n - 1 if turn == 1 else turn - 1
        point, first = NO_CONTACT, added and turn == 1
        if angle > limits.target:
            point, angle = _best_point(i, n, angle, count, domain, limits, workspace, plane, hull)
        # An added finger never hurts, even if it exerts no force.
        if first and point == NO_CONTACT:
            point = _most_distant_point(i, n, count, domain, limits, workspace)
            if point == NO_CONTACT:
                return math.inf
        if point != NO_CONTACT:
            set_finger(i, point, domain, workspace)
        elif angle > limits.target:
            set_current(i, domain, workspace)
    return angle


@merged
def _try_neighbours(v, n, stage, most, domain, limits, previous, grasps, workspace, plane, hull):
    """Store the best grasp with the other contacts of grasps that the last stage found nearby.

    Returns:
        Whether one improves the vertex's grasp, for three fingers after some steps to balance.
    """
    improved, balancing = False, hull is None and may_balance(v, domain)
    for k in range(domain.neighbour_start[v], domain.neighbour_start[v + 1]):
        if grasps.angles[v] <= limits.target:
            break
        other = domain.neighbours[k]
        if previous.stages[other] != stage - 1 or previous.angles[other] == math.inf:
            continue
        load_grasp(other, n, previous, domain, workspace)
        fits = set_vertex_contact(0, v, domain, workspace.candidate)
        threshold = most if balancing else min(grasps.angles[v] - limits.margin, most)
        angle = evaluate_if_allowed(fits, n, threshold, limits, workspace, plane, hull)
        if balancing and angle < math.inf:
            angle = balance(angle, domain, limits, workspace, plane, hull)
        if angle < grasps.angles[v] - limits.margin:
            store_grasp(v, n, angle, stage, grasps, workspace)
            improved = True
    return improved


@merged
def _seed_random(seed, v, stage, random_state):
    """Seed a vertex's random numbers, independently of the order of vertices and threads."""
    random_state[0] = np.uint64(seed)
    for part in (v, stage):
        random_fraction(random_state)
        random_state[0] ^= np.uint64(part)
    random_fraction(random_state)


@merged
def _initial_grasps(v, n, most, domain, limits, previous, workspace, plane, hull):
    """Find starts of three fingers, or load the grasp of one finger less; return their number."""
    count = list_reachable(v, limits.points_per_vertex, domain, limits, workspace)
    if hull is None:  # three fingers; this branch is not compiled for more
        seed_pairs(count, most, domain, limits, workspace, plane, hull)
        if workspace.angles[0] == math.inf and most >= RIGHT_ANGLE:
            first_pair(count, domain, limits, workspace, plane)
        return STARTS
    workspace.angles[0] = math.inf
    if previous.angles[v] < math.inf:
        workspace.angles[0] = load_grasp(v, n - 1, previous, domain, workspace)
    return 1


@scratch_kernel(
    "int, Ints1, int, ContactDomain, SearchLimits, int, float, int, BestGrasps, BestGrasps, "
    "SearchWorkspace, Plane, HullScratch | None"
)
def search_fingers(
    stage, vertices, fingers, domain, limits, seed, step, rounds, previous, grasps, workspace,
    plane, hull,
):  # fmt: skip
    """Search for grasps of several fingers with the first contact at given vertices.

    For three fingers, all pairs of candidate points are evaluated and the best starts refined. Then
    the other fingers of the best grasp are moved one by one to the best of all candidate points,
    and the result is refined again. Refinement takes a few steps toward balance, then random ones.

    For more fingers, the last one is added to the best grasp of one finger less at the best
    candidate point. A force-closed grasp stays so with another finger, so no vertex becomes worse.

    Args:
        stage: 0 to start as above; from 1 on, evaluate and refine the grasps of neighbours.
        vertices: Vertices (m,).
        fingers: Number of fingers, at least 3.
        domain: `ContactDomain`.
        limits: `SearchLimits`.
        seed: Seed of the random numbers.
        step: First step length of the refinement.
        rounds: Number of steps of the refinement.
        previous: `BestGrasps` at the start of the stage; in stage 0 those of one finger less, if
            these have at least three.
        grasps: `BestGrasps`; written.
        workspace: `SearchWorkspace`.
        plane: `Plane`.
        hull: `HullScratch`; None for three fingers, for which no hull is compiled.
    """
    n = fingers
    if hull is None:  # a constant in the machine code for three fingers
        n = 3
    candidate = workspace.candidate
    for v in vertices:
        if not set_vertex_contact(0, v, domain, candidate):
            continue
        # Separating directions from another vertex's grasps would make results depend on the order.
        if hull is not None:
            hull.direction_use[0] = hull.direction_use[1] = 0
        _seed_random(seed, v, 16 * stage + n, workspace.random_state)
        # Within a wider cone about the centre, one of the normals may still have a good grasp.
        most = limits.max_angle
        if domain.radii[v] > 0.0:
            most = max(most, min(most + 2.0 * domain.radii[v], RIGHT_ANGLE))
        # Later stages refine the best neighbour's grasp only if it improves this vertex.
        if stage > 0:
            if not _try_neighbours(
                v, n, stage, most, domain, limits, previous, grasps, workspace, plane, hull
            ):
                continue
            workspace.angles[0] = load_grasp(v, n, grasps, domain, workspace)
            starts = 1
        else:
            starts = _initial_grasps(v, n, most, domain, limits, previous, workspace, plane, hull)
        # Three fingers: after all starts, exchange the fingers of the best grasp and refine again.
        has_exchange = stage == 0 and n == 3
        for k in range(starts + has_exchange):
            exchanging = has_exchange and k == starts
            if exchanging:
                angle = load_grasp(v, n, grasps, domain, workspace)
                if not limits.target < angle < math.inf:
                    break
            else:
                angle = workspace.angles[k]
                if angle == math.inf or grasps.angles[v] <= limits.target:
                    continue
                if has_exchange:  # a start is a pair of candidate points, else it is loaded already
                    set_finger(1, workspace.start_points[k, 0], domain, workspace)
                    set_finger(2, workspace.start_points[k, 1], domain, workspace)
            if exchanging or (stage == 0 and n > 3):
                size = domain.candidates.common_count if exchanging else limits.points_per_vertex
                count = list_reachable(v, size, domain, limits, workspace)
                added = not exchanging
                angle = exchange_fingers(
                    n, added, angle, count, domain, limits, workspace, plane, hull
                )
            if hull is None and angle < math.inf and may_balance(v, domain):
                angle = balance(angle, domain, limits, workspace, plane, hull)
            if angle < math.inf:
                angle = refine(n, angle, step, rounds, domain, limits, workspace, plane, hull)
            if angle < grasps.angles[v]:
                store_grasp(v, n, angle, stage, grasps, workspace)
