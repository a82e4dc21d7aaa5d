"""Improving a grasp of three fingers and more: by moving its fingers, and by exchanging them."""

import math

from grasp3d._kernels.compiling.decorators import merged
from grasp3d._kernels.search.multifinger_contacts import (
    NO_CONTACT,
    distances_allowed,
    set_contact,
    set_point_contact,
)
from grasp3d._kernels.search.multifinger_evaluation import evaluate
from grasp3d._kernels.search.multifinger_grasps import set_finger
from grasp3d._kernels.surface.surface_walks import random_fraction, walk

STEP_GROWTH, STEP_SHRINKAGE = 1.6, 0.88
"""Factors of the step length after a step that improved the grasp, and after one that did not."""

SINGLE_FINGER_FRACTION = 0.5
"""Fraction of the steps that move one finger only."""

CREASE_WEIGHT = 1e-12
"""Factor of the squared distance for points with too many normals: an idle finger, which the grasp
does not need, is placed there only where no other point is allowed."""

MAX_EDGES = 8
"""Most edges that a finger moves along in one step, where contacts are vertices."""


@merged
def _move_finger(j, step, domain, limits, workspace):
    """Write a random variation of finger j of the current grasp, up to two steps away."""
    elements, weights, random_state = workspace.elements, workspace.weights, workspace.random_state
    length = 2.0 * step * random_fraction(random_state)
    # A random walk over edges, or a straight walk in a random direction.
    if domain.on_vertices:
        vertex = elements[0, j]
        # The step in edges: shorter than one edge still moves the finger.
        hops = min(MAX_EDGES, 1 + int(length / limits.edge_length))
        for _ in range(hops):
            first, last = domain.neighbour_start[vertex], domain.neighbour_start[vertex + 1]
            if last > first:
                vertex = domain.neighbours[
                    first + int(random_fraction(random_state) * (last - first))
                ]
        elements[1, j] = vertex
        return
    for c in range(3):
        weights[1, j, c] = weights[0, j, c]
    surface = domain.surface
    elements[1, j] = walk(
        elements[0, j], weights[1, j], 2.0 * math.pi * random_fraction(random_state), length,
        surface.points, surface.faces, domain.adjacent_faces,
    )  # fmt: skip


@merged
def refine(n, angle, step, rounds, domain, limits, workspace, planar, hull):
    """Improve the current grasp by random steps of its fingers.

    An evolution strategy with success-based step lengths (Rechenberg 1973). The critical angle is a
    maximum over directions, hence not differentiable: moving one finger at a time would stop at
    creases of the function that only several fingers together can leave.

    Returns:
        The critical angle of the refined grasp [rad].
    """
    candidate = workspace.candidate
    for _ in range(rounds):
        # On vertices every step moves a finger by one edge at least, however short it is.
        if angle <= limits.target or (step < limits.shortest_step and not domain.on_vertices):
            break
        moved = 0  # all fingers
        if random_fraction(workspace.random_state) < SINGLE_FINGER_FRACTION:
            moved = 1 + int(random_fraction(workspace.random_state) * (n - 1))
        fits = True
        for j in range(1, n):
            if moved in (0, j):
                _move_finger(j, step, domain, limits, workspace)
                fits = (
                    set_contact(
                        j, workspace.elements[1, j], workspace.weights[1, j], domain, workspace
                    )
                    and fits
                )
        for j in range(1, n):  # contacts 0 to j - 1, so every pair once
            fits = fits and distances_allowed(candidate, j, j, limits)
        threshold = angle - limits.margin
        workspace.evaluated[0] += fits
        found = math.inf
        if fits and threshold > 0.0:
            found = evaluate(
                candidate, planar, hull, n, threshold, limits.tolerance, limits.best_normals
            )
        # The step grows after a success and shrinks after a failure, such that it stays constant
        # at a success rate of about 1/5, which is nearly optimal (Rechenberg 1973).
        better = found < math.inf
        if better:
            angle = found
        step *= STEP_GROWTH if better else STEP_SHRINKAGE
        for j in range(1, n):
            if moved in (0, j):
                if better:
                    workspace.elements[0, j] = workspace.elements[1, j]
                    for c in range(3):
                        workspace.weights[0, j, c] = workspace.weights[1, j, c]
                else:  # the candidate must again be the current grasp
                    set_contact(
                        j, workspace.elements[0, j], workspace.weights[0, j], domain, workspace
                    )
    return angle


@merged
def _best_point(i, n, angle, count, domain, candidate_points, limits, workspace, planar, hull):
    """The candidate point of finger i with the best grasp: (point or NO_CONTACT, angle)."""
    candidate, chosen = workspace.candidate, NO_CONTACT
    for s in range(count):
        point, threshold = workspace.reachable[s], angle - limits.margin
        if threshold <= 0.0:
            break
        if not (
            set_point_contact(i, point, domain, candidate_points, candidate)
            and distances_allowed(candidate, i, n, limits)
        ):
            continue
        workspace.evaluated[0] += 1
        found = evaluate(
            candidate, planar, hull, n, threshold, limits.tolerance, limits.best_normals
        )
        if found < math.inf:
            chosen, angle = point, found
    return chosen, angle


@merged
def _most_distant_point(i, n, count, domain, candidate_points, limits, workspace):
    """The reachable point farthest from the other contacts, for a finger that improves nothing."""
    candidate, chosen, widest = workspace.candidate, NO_CONTACT, 0.0
    for s in range(count):
        point = workspace.reachable[s]
        fits = set_point_contact(i, point, domain, candidate_points, candidate)
        if not (candidate.counts[i] > 0 and distances_allowed(candidate, i, n, limits)):
            continue
        least = math.inf
        for j in range(n):
            if j != i:
                x = candidate.points[i, 0] - candidate.points[j, 0]
                y = candidate.points[i, 1] - candidate.points[j, 1]
                z = candidate.points[i, 2] - candidate.points[j, 2]
                least = min(least, x * x + y * y + z * z)
        least *= 1.0 if fits else CREASE_WEIGHT
        if least > widest:
            chosen, widest = point, least
    return chosen


@merged
def exchange_fingers(
    n, added, angle, count, domain, candidate_points, limits, workspace, planar, hull
):
    """Move one finger after the other to the reachable candidate point with the best grasp.

    Args:
        n: Fingers.
        added: Whether the last finger is new: it is placed first, even where it improves nothing.
        angle: Critical angle of the current grasp, without the new finger [rad].
        count: Number of reachable candidate points.
        domain: `ContactDomain`.
        candidate_points: `CandidatePoints`.
        limits: `SearchLimits`.
        workspace: `SearchWorkspace`.
        planar: As for `evaluate`.
        hull: As for `evaluate`.

    Returns:
        The critical angle [rad]; inf where the new finger cannot be placed.
    """
    for turn in range(1, n):
        i = turn
        if added:
            i = n - 1 if turn == 1 else turn - 1
        point, first = NO_CONTACT, added and turn == 1
        if angle > limits.target:
            point, angle = _best_point(
                i, n, angle, count, domain, candidate_points, limits, workspace, planar, hull
            )
        # An added finger never hurts, even if it exerts no force.
        if first and point == NO_CONTACT:
            point = _most_distant_point(i, n, count, domain, candidate_points, limits, workspace)
            if point == NO_CONTACT:
                return math.inf
        if point != NO_CONTACT:
            set_finger(i, point, domain, candidate_points, workspace)
        elif angle > limits.target:
            set_contact(i, workspace.elements[0, i], workspace.weights[0, i], domain, workspace)
    return angle
