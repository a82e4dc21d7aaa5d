"""Search for the best grasps of three fingers and more through the vertices of a surface."""

import math

import numpy as np

from grasp3d._kernels.compiling.decorators import inlined, merged, scratch_kernel
from grasp3d._kernels.search.multifinger_contacts import (
    NO_CONTACT,
    distances_allowed,
    set_contact,
    set_vertex_contact,
)
from grasp3d._kernels.search.multifinger_evaluation import RIGHT_ANGLE, evaluate
from grasp3d._kernels.search.multifinger_grasps import STARTS, load_grasp, set_finger, store_grasp
from grasp3d._kernels.search.multifinger_refinement import exchange_fingers, refine
from grasp3d._kernels.search.multifinger_seeding import first_pair, list_reachable, seed_pairs
from grasp3d._kernels.surface.surface_walks import random_fraction


@merged
def _try_neighbours(v, n, domain, limits, previous, grasps, workspace, planar, hull):
    """Evaluate the other contacts of neighbouring vertices' grasps: (best neighbour, angle)."""
    candidate, angle, chosen = workspace.candidate, grasps.angles[v], NO_CONTACT
    if angle <= limits.target:
        return chosen, angle
    for k in range(domain.neighbour_start[v], domain.neighbour_start[v + 1]):
        other = domain.neighbours[k]
        if not previous.angles[other] < math.inf:
            continue
        fits = True
        for j in range(1, n):
            element, weights = previous.elements[other, j - 1], previous.weights[other, j - 1]
            # No shortcut: all contacts must be set for the distances.
            fits = set_contact(j, element, weights, domain, workspace) and fits
        for j in range(1, n):
            fits = fits and distances_allowed(candidate, j, j, limits)
        workspace.evaluated[0] += fits
        threshold = min(angle - limits.margin, limits.max_angle)
        if fits and threshold > 0.0:
            found = evaluate(
                candidate, planar, hull, n, threshold, limits.tolerance, limits.best_normals
            )
            if found < math.inf:
                chosen, angle = other, found
    return chosen, angle


@merged
def _seed_random(seed, v, stage, random_state):
    """Seed the random numbers of a vertex, independently of the order of vertices and threads."""
    random_state[0] = np.uint64(seed)
    for part in (v, stage):
        random_fraction(random_state)
        random_state[0] ^= np.uint64(part)
    random_fraction(random_state)


@merged
def _initial_grasps(v, own, n, domain, candidate_points, limits, previous, workspace, planar, hull):
    """Find starts of three fingers, or load the grasp of one finger less; returns their number."""
    count = list_reachable(
        v, own, limits.points_per_vertex, domain, candidate_points, limits, workspace
    )
    if hull is None:  # three fingers, in a branch that is not compiled for more
        seed_pairs(count, domain, candidate_points, limits, workspace, planar, hull)
        if workspace.angles[0] == math.inf and limits.max_angle >= RIGHT_ANGLE:
            first_pair(count, domain, candidate_points, limits, workspace, planar.plane)
        return STARTS
    workspace.angles[0] = math.inf
    if previous.angles[v] < math.inf:
        workspace.angles[0] = load_grasp(v, n - 1, previous, domain, workspace)
    return 1


@inlined
def _search(
    stage,
    vertices,
    own,
    n,
    domain,
    candidate_points,
    limits,
    seed,
    step,
    rounds,
    previous,
    grasps,
    workspace,
    planar,
    hull,
):
    """Search for grasps of n fingers; see `search_three_fingers` and `search_more_fingers`."""
    candidate = workspace.candidate
    for v in vertices:
        if not set_vertex_contact(0, v, domain, candidate):
            continue
        # Separating directions of another vertex's grasps would make results depend on the order.
        if hull is not None:
            hull.direction_use[0] = hull.direction_use[1] = 0
        _seed_random(seed, v, 16 * stage + n, workspace.random_state)
        # Later stages start from the best neighbour's grasp only where it improves this vertex.
        if stage > 0:
            other, workspace.angles[0] = _try_neighbours(
                v, n, domain, limits, previous, grasps, workspace, planar, hull
            )
            if other == NO_CONTACT:
                continue
            # The neighbour's other contacts with this vertex as the first.
            load_grasp(other, n, previous, domain, workspace)
            set_vertex_contact(0, v, domain, candidate)
            starts = 1
        else:
            starts = _initial_grasps(
                v, own[v], n, domain, candidate_points, limits, previous, workspace, planar, hull
            )
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
                if angle == math.inf:
                    continue
                if has_exchange:  # a start is a pair of candidate points, else it is loaded already
                    set_finger(1, workspace.start_points[k, 0], domain, candidate_points, workspace)
                    set_finger(2, workspace.start_points[k, 1], domain, candidate_points, workspace)
            if exchanging or (stage == 0 and n > 3):
                most = candidate_points.common_count if exchanging else limits.points_per_vertex
                count = list_reachable(v, own[v], most, domain, candidate_points, limits, workspace)
                angle = exchange_fingers(
                    n, not exchanging, angle, count, domain, candidate_points, limits, workspace,
                    planar, hull,
                )  # fmt: skip
            if angle < math.inf:
                angle = refine(n, angle, step, rounds, domain, limits, workspace, planar, hull)
            if angle < grasps.angles[v]:
                store_grasp(v, n, angle, grasps, workspace)


@scratch_kernel
def search_three_fingers(
    stage,
    vertices,
    own,
    domain,
    candidate_points,
    limits,
    seed,
    step,
    rounds,
    previous,
    grasps,
    workspace,
    planar,
):
    """Search for grasps of three fingers with the first contact at given vertices.

    All pairs of candidate points are evaluated and the best starts refined. Then the other fingers
    of the best grasp are moved one by one to the best of all candidate points, and the result is
    refined again.

    Args:
        stage: 0: start as above; from 1 on: evaluate and refine the grasps of neighbours.
        vertices: Vertices (m,).
        own: Candidate point that belongs to each vertex; NO_CONTACT: none (V,).
        domain: `ContactDomain`.
        candidate_points: `CandidatePoints`.
        limits: `SearchLimits`.
        seed: Seed of the random numbers.
        step: First step length of the refinement.
        rounds: Number of its steps.
        previous: `BestGrasps` at the beginning of the stage.
        grasps: `BestGrasps`; written.
        workspace: `SearchWorkspace`.
        planar: `PlaneScratch`.
    """
    _search(
        stage, vertices, own, 3, domain, candidate_points, limits, seed, step, rounds, previous,
        grasps, workspace, planar, None,
    )  # fmt: skip


@scratch_kernel
def search_more_fingers(
    stage,
    vertices,
    own,
    n,
    domain,
    candidate_points,
    limits,
    seed,
    step,
    rounds,
    previous,
    grasps,
    workspace,
    planar,
    hull,
):
    """Search for grasps of n fingers with the first contact at given vertices.

    The last finger is added at the best candidate point to the best grasp of one finger less. A
    force-closed grasp stays so with an additional finger, so a vertex never becomes worse.

    Args:
        stage: As for `search_three_fingers`.
        vertices: As for `search_three_fingers`.
        own: As for `search_three_fingers`.
        n: Fingers, 4 or more.
        domain: `ContactDomain`.
        candidate_points: `CandidatePoints`.
        limits: `SearchLimits`.
        seed: Seed of the random numbers.
        step: First step length of the refinement.
        rounds: Number of its steps.
        previous: `BestGrasps` of one finger less, or those at the beginning of the stage.
        grasps: `BestGrasps`; written.
        workspace: `SearchWorkspace`.
        planar: `PlaneScratch`.
        hull: `HullScratch`.
    """
    _search(
        stage, vertices, own, n, domain, candidate_points, limits, seed, step, rounds, previous,
        grasps, workspace, planar, hull,
    )  # fmt: skip
