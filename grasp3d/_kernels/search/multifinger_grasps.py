"""The best grasps of three fingers and more so far, and the scratch arrays of their search."""

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from grasp3d._kernels.compiling.decorators import merged
from grasp3d._kernels.search.multifinger_contacts import (
    NO_CONTACT,
    set_contact,
    set_point_contact,
    set_vertex_contact,
)
from grasp3d._kernels.search.multifinger_evaluation import Candidate, make_candidate

STARTS = 3
"""Grasps of a vertex, without a common candidate point, that are refined."""


class BestGrasps(NamedTuple):
    """The best grasps found so far, a row per vertex; written in place."""

    angles: npt.NDArray[np.float64]
    """Critical angles [rad]; inf: none (V,)."""
    elements: npt.NDArray[np.int64]
    """Face or vertex of every other finger; NO_CONTACT: no grasp (V, n - 1)."""
    weights: npt.NDArray[np.float64]
    """Barycentric coordinates on the faces (V, n - 1, 3)."""


class SearchWorkspace(NamedTuple):
    """Scratch arrays for one thread.

    Those of `evaluate` are passed beside it: where a kernel reads a tuple, LLVM takes all of it
    apart, which is most of the time that it needs for kernels with many arrays.
    """

    candidate: Candidate
    face_normals: npt.NDArray[np.float64]
    """Normals at a surface point (2, 3)."""
    reachable: npt.NDArray[np.int64]
    """Candidate points at allowed distances from the vertex (common_count + 1,)."""
    angles: npt.NDArray[np.float64]
    """Critical angles of the starts [rad] (STARTS,)."""
    start_points: npt.NDArray[np.int64]
    """Candidate points of their second and third fingers (STARTS, 2)."""
    elements: npt.NDArray[np.int64]
    """Faces or vertices of the fingers: row 0 the current grasp, row 1 its variation (2, n)."""
    weights: npt.NDArray[np.float64]
    """Their barycentric coordinates (2, n, 3)."""
    random_state: npt.NDArray[np.uint64]
    """State of the random number generator (1,)."""
    evaluated: npt.NDArray[np.int64]
    """Number of candidate grasps evaluated so far (1,)."""


def make_best_grasps(vertices: int, others: int) -> BestGrasps:
    """Allocate grasps, none found yet, with `others` fingers besides the first."""
    return BestGrasps(
        angles=np.full(vertices, math.inf),
        elements=np.full((vertices, others), NO_CONTACT, dtype=np.int64),
        weights=np.zeros((vertices, others, 3)),
    )


def make_search_workspace(fingers: int, normals: int, common_count: int) -> SearchWorkspace:
    """Allocate scratch arrays for so many fingers, normals per contact and candidate points."""
    return SearchWorkspace(
        candidate=make_candidate(fingers, normals),
        face_normals=np.zeros((2, 3)),
        reachable=np.zeros(common_count + 1, dtype=np.int64),
        angles=np.zeros(STARTS),
        start_points=np.zeros((STARTS, 2), dtype=np.int64),
        elements=np.zeros((2, fingers), dtype=np.int64),
        weights=np.zeros((2, fingers, 3)),
        random_state=np.zeros(1, dtype=np.uint64),
        evaluated=np.zeros(1, dtype=np.int64),
    )


@merged
def load_grasp(v, n, grasps, domain, workspace):
    """Make the best grasp of a vertex so far the current one; returns its critical angle."""
    set_vertex_contact(0, v, domain, workspace.candidate)
    # The first contact is the vertex itself and is not stored.
    for j in range(1, n):
        workspace.elements[0, j] = grasps.elements[v, j - 1]
        for c in range(3):
            workspace.weights[0, j, c] = grasps.weights[v, j - 1, c]
        set_contact(j, workspace.elements[0, j], workspace.weights[0, j], domain, workspace)
    return grasps.angles[v]


@merged
def store_grasp(v, n, angle, grasps, workspace):
    """Store the current grasp as the best of a vertex."""
    grasps.angles[v] = angle
    for j in range(1, n):
        grasps.elements[v, j - 1] = workspace.elements[0, j]
        for c in range(3):
            grasps.weights[v, j - 1, c] = workspace.weights[0, j, c]


@merged
def set_finger(i, point, domain, candidate_points, workspace):
    """Move finger i of the current grasp to a candidate point."""
    workspace.elements[0, i] = candidate_points.elements[point]
    for c in range(3):
        workspace.weights[0, i, c] = candidate_points.weights[point, c]
    set_point_contact(i, point, domain, candidate_points, workspace.candidate)
