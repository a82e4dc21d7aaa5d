"""Grasps of three fingers and more: where fingers are placed, and the best grasps so far."""

import math
from typing import NamedTuple

import numpy as np

from grasp3d._kernels.array_types import (
    FixedFloats1,
    FixedFloats2,
    Floats1,
    Floats2,
    Floats3,
    Ints1,
    Ints2,
    UInt64s1,
)
from grasp3d._kernels.compiling import merged
from grasp3d._kernels.search.multifinger_evaluation import Candidate, evaluate, make_candidate
from grasp3d._kernels.surface.surface_contacts import (
    ContactNormals,
    Surface,
    point_on_face,
    walk,
    write_normals,
)
from grasp3d._kernels.surface.turns import turn_at_vertex, turn_on_face
from grasp3d._kernels.surface.vectors import copy, squared_distance, triple

NO_CONTACT = -1
"""Element or point of a finger without a contact."""


class CandidatePoints(NamedTuple):
    """Points that the other fingers are placed at.

    First those spread over the surface, of which every beginning is evenly spread, for all
    vertices; then points that belong to one vertex each.
    """

    common_count: int
    """Number of points for all vertices."""
    points: Floats2
    """Positions (P, 3)."""
    elements: Ints1
    """Face or vertex of each point (P,)."""
    weights: Floats2
    """Barycentric coordinates (P, 3)."""
    normals: FixedFloats2
    """Inward unit normals (P, 3); unused where contacts are vertices."""
    own: Ints1
    """The point that belongs to each vertex; NO_CONTACT: none (V,)."""


class ContactDomain(NamedTuple):
    """The surface on which fingers are placed, with its normals and neighbourhoods."""

    surface: Surface
    sets: ContactNormals
    adjacent_faces: Ints2
    """Face across the edge opposite each corner (F, 3); -1: none, or several."""
    centres: FixedFloats2
    """Centre of each vertex's set of normals (V, 3)."""
    radii: FixedFloats1
    """Largest angle from the centre to a normal [rad] (V,); negative: there is none."""
    neighbour_start: Ints1
    """First neighbour of each vertex in `neighbours` (V + 1,)."""
    neighbours: Ints1
    """Vertices around each vertex; on a surface also those around these, and itself."""
    on_vertices: bool
    """Whether contacts are vertices; an element is then a vertex, otherwise a face."""
    candidates: CandidatePoints


class SearchLimits(NamedTuple):
    """Conditions on grasps and settings of the search; lengths as in `ContactDomain`."""

    min_distance: float
    """Smallest distance between two contacts."""
    max_distance: float
    """Largest distance between two contacts."""
    max_angle: float
    """Largest critical angle that counts [rad]."""
    tolerance: float
    """Width of the bracket of a critical angle [rad]."""
    margin: float
    """Smallest improvement of a critical angle that counts [rad]."""
    target: float
    """Critical angle below which a grasp is not improved further [rad]."""
    points_per_vertex: int
    """Candidate points that are paired at each vertex."""
    edge_length: float
    """Mean edge length."""
    shortest_step: float
    """Step length below which a refinement ends."""


@merged
def set_vertex_contact(i, vertex, domain, candidate):
    """Place contact i of a candidate at a vertex; returns whether the vertex has a normal."""
    candidate.radii[i] = domain.radii[vertex] + turn_at_vertex(vertex, domain.surface.turns)
    copy(domain.surface.points[vertex], candidate.points[i])
    copy(domain.centres[vertex], candidate.normals[i])
    return domain.radii[vertex] >= 0.0


@merged
def set_face_contact(i, face, weights, domain, candidate, face_normals):
    """Place contact i of a candidate on a face; returns whether the surface is smooth there."""
    weights = triple(weights, 0)
    count, vertex = write_normals(face, weights, domain.surface, domain.sets, face_normals)
    candidate.radii[i] = turn_on_face(face, weights, domain.surface.turns)
    copy(face_normals[0], candidate.normals[i])
    copy(point_on_face(face, weights, domain.surface), candidate.points[i])
    return count == 1 and vertex < 0


@merged
def set_contact(i, element, weights, domain, workspace):
    """Place contact i of a candidate on an element; returns whether a finger may stay there."""
    if domain.on_vertices:
        return set_vertex_contact(i, element, domain, workspace.candidate)
    return set_face_contact(
        i, element, weights, domain, workspace.candidate, workspace.face_normals
    )


@merged
def set_point_contact(i, point, domain, candidate):
    """Place contact i of a candidate at a candidate point; returns whether it may stay there."""
    if domain.on_vertices:
        return set_vertex_contact(i, domain.candidates.elements[point], domain, candidate)
    # Points are precomputed: neither interpolation nor crease tests in the innermost loops.
    element, weights = domain.candidates.elements[point], domain.candidates.weights[point]
    candidate.radii[i] = turn_on_face(element, weights, domain.surface.turns)
    copy(domain.candidates.points[point], candidate.points[i])
    copy(domain.candidates.normals[point], candidate.normals[i])
    return True


@merged
def is_allowed(one, other, limits):
    """Whether the distance between two contacts is within the limits."""
    square = squared_distance(one, other)
    smallest, largest = limits.min_distance, limits.max_distance
    return smallest * smallest <= square <= largest * largest


@merged
def distances_allowed(candidate, i, n, limits):
    """Whether the distances of contact i to the others of the first n are within the limits."""
    for j in range(n):
        if j != i and not is_allowed(candidate.points[i], candidate.points[j], limits):
            return False
    return True


STARTS = 3
"""Grasps of a vertex, without a common candidate point, that are refined."""


class BestGrasps(NamedTuple):
    """The best grasps found so far, a row per vertex; written in place."""

    angles: Floats1
    """Critical angles [rad]; inf: none (V,)."""
    elements: Ints2
    """Face or vertex of every other finger; NO_CONTACT: no grasp (V, n - 1)."""
    weights: Floats3
    """Barycentric coordinates on the faces (V, n - 1, 3)."""
    stages: Ints1
    """Stage of the search in which each was found (V,)."""


class SearchWorkspace(NamedTuple):
    """Scratch arrays for one thread.

    Those of `evaluate` are passed beside it: where a kernel reads a tuple, LLVM takes all of it
    apart, which is most of the time that it needs for kernels with many arrays.
    """

    candidate: Candidate
    face_normals: Floats2
    """Normals at a surface point (2, 3)."""
    reachable: Ints1
    """Candidate points at allowed distances from the vertex (common_count + 1,)."""
    angles: Floats1
    """Critical angles of the starts [rad] (STARTS,)."""
    start_points: Ints2
    """Candidate points of their second and third fingers (STARTS, 2)."""
    elements: Ints2
    """Faces or vertices of the fingers: row 0 the current grasp, row 1 its variation (2, n)."""
    weights: Floats3
    """Their barycentric coordinates (2, n, 3)."""
    residuals: Floats2
    """Derivatives of what three contacts miss balance by, and that itself (5, 4)."""
    equations: Floats2
    """Linear equations for a step, with their right sides (4, 5)."""
    random_state: UInt64s1
    """State of the random number generator (1,)."""
    evaluated: Ints1
    """Number of candidate grasps evaluated so far (1,)."""


def make_best_grasps(vertices: int, others: int) -> BestGrasps:
    """Allocate grasps, none found yet, with `others` fingers besides the first."""
    return BestGrasps(
        angles=np.full(vertices, math.inf),
        elements=np.full((vertices, others), NO_CONTACT, dtype=np.int64),
        weights=np.zeros((vertices, others, 3)),
        stages=np.zeros(vertices, dtype=np.int64),
    )


def make_search_workspace(fingers: int, common_count: int) -> SearchWorkspace:
    """Allocate scratch arrays for so many fingers and candidate points."""
    return SearchWorkspace(
        candidate=make_candidate(fingers),
        face_normals=np.zeros((2, 3)),
        reachable=np.zeros(common_count + 1, dtype=np.int64),
        angles=np.zeros(STARTS),
        start_points=np.zeros((STARTS, 2), dtype=np.int64),
        elements=np.zeros((2, fingers), dtype=np.int64),
        weights=np.zeros((2, fingers, 3)),
        residuals=np.zeros((5, 4)),
        equations=np.zeros((4, 5)),
        random_state=np.zeros(1, dtype=np.uint64),
        evaluated=np.zeros(1, dtype=np.int64),
    )


@merged
def set_current(j, domain, workspace):
    """Place contact j of the candidate as in the current grasp; returns as `set_contact`."""
    return set_contact(j, workspace.elements[0, j], workspace.weights[0, j], domain, workspace)


@merged
def walk_finger(j, angle, length, domain, workspace):
    """Vary the current grasp by a straight walk of finger j; returns as `set_contact`."""
    elements, weights, surface = workspace.elements, workspace.weights, domain.surface
    copy(weights[0, j], weights[1, j])
    elements[1, j] = walk(
        elements[0, j], weights[1, j], angle, length,
        surface.points, surface.faces, domain.adjacent_faces,
    )  # fmt: skip
    return set_contact(j, elements[1, j], weights[1, j], domain, workspace)


@merged
def keep_or_undo(keep, moved, n, domain, workspace):
    """Make the variation the current grasp, or the candidate the current grasp again.

    Args:
        keep: Whether the variation is better.
        moved: The finger that was moved; 0: all.
        n: Contacts.
        domain: `ContactDomain`.
        workspace: `SearchWorkspace`.
    """
    for j in range(1, n):
        if moved in (0, j):
            if keep:
                workspace.elements[0, j] = workspace.elements[1, j]
                copy(workspace.weights[1, j], workspace.weights[0, j])
            else:
                set_current(j, domain, workspace)


@merged
def evaluate_if_allowed(fits, n, threshold, limits, workspace, plane, hull):
    """Evaluate the candidate, if all its fingers fit and its distances are within the limits."""
    for j in range(1, n):  # contacts 0 to j - 1, so every pair once
        fits = fits and distances_allowed(workspace.candidate, j, j, limits)
    workspace.evaluated[0] += fits
    if not fits or threshold <= 0.0:
        return math.inf
    return evaluate(workspace.candidate, plane, hull, n, threshold, limits.tolerance)


@merged
def load_grasp(v, n, grasps, domain, workspace):
    """Make the best grasp of a vertex so far the current one; returns its critical angle."""
    set_vertex_contact(0, v, domain, workspace.candidate)
    # The first contact is the vertex itself and is not stored.
    for j in range(1, n):
        workspace.elements[0, j] = grasps.elements[v, j - 1]
        copy(grasps.weights[v, j - 1], workspace.weights[0, j])
        set_current(j, domain, workspace)
    return grasps.angles[v]


@merged
def store_grasp(v, n, angle, stage, grasps, workspace):
    """Store the current grasp as the best of a vertex."""
    grasps.angles[v], grasps.stages[v] = angle, stage
    for j in range(1, n):
        grasps.elements[v, j - 1] = workspace.elements[0, j]
        copy(workspace.weights[0, j], grasps.weights[v, j - 1])


@merged
def set_finger(i, point, domain, workspace):
    """Move finger i of the current grasp to a candidate point."""
    workspace.elements[0, i] = domain.candidates.elements[point]
    copy(domain.candidates.weights[point], workspace.weights[0, i])
    set_point_contact(i, point, domain, workspace.candidate)
