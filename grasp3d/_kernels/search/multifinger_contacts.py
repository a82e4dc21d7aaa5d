"""Contacts of multi-finger grasps: candidate points, their normals, and limits of the search."""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from grasp3d._kernels.compiling.decorators import merged
from grasp3d._kernels.surface.normal_sets import ContactNormals
from grasp3d._kernels.surface.surface_contacts import Surface, write_normals

NO_CONTACT = -1
"""Element or point of a finger without a contact."""


class ContactDomain(NamedTuple):
    """The surface on which fingers are placed, with its normals and neighbourhoods."""

    surface: Surface
    sets: ContactNormals
    adjacent_faces: npt.NDArray[np.int64]
    """Face across the edge opposite each corner (F, 3); -1: none, or several."""
    normal_start: npt.NDArray[np.int64]
    """First row of each vertex in `normals` (V + 1,)."""
    normals: npt.NDArray[np.float64]
    """Inward unit normals with which a contact at each vertex is evaluated (K, 3)."""
    neighbour_start: npt.NDArray[np.int64]
    """First neighbour of each vertex in `neighbours` (V + 1,)."""
    neighbours: npt.NDArray[np.int64]
    """Vertices around each vertex."""
    on_vertices: bool
    """Whether contacts are vertices; an element is then a vertex, otherwise a face."""
    max_normals: int
    """Most normals of a vertex where a finger may be placed, as all combinations are evaluated."""


class CandidatePoints(NamedTuple):
    """Points that the other fingers are placed at.

    First those spread over the surface, of which every beginning is evenly spread, for all
    vertices; then points that belong to one vertex each.
    """

    common_count: int
    """Number of points for all vertices."""
    points: npt.NDArray[np.float64]
    """Positions (P, 3)."""
    elements: npt.NDArray[np.int64]
    """Face or vertex of each point (P,)."""
    weights: npt.NDArray[np.float64]
    """Barycentric coordinates (P, 3)."""
    normals: npt.NDArray[np.float64]
    """Inward unit normals (P, 3); unused where contacts are vertices, which may have several."""


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
    best_normals: bool
    """Whether critical angles are those over the best normals, instead of the worst."""


@merged
def set_vertex_contact(i, vertex, domain, candidate):
    """Place contact i of a candidate at a vertex; returns whether the vertex has a normal."""
    normal_start, points = domain.normal_start[vertex], domain.surface.points
    count = domain.normal_start[vertex + 1] - normal_start
    candidate.counts[i] = count
    for c in range(3):
        candidate.points[i, c] = points[vertex, c]
        for k in range(count):
            candidate.normals[i, k, c] = domain.normals[normal_start + k, c]
    return count > 0


@merged
def set_face_contact(i, face, weights, domain, candidate, face_normals):
    """Place contact i of a candidate on a face; returns whether the surface is smooth there."""
    # On a crease only the first normal is used: the walk avoids edges, and the grasps found are
    # evaluated exactly afterwards.
    surface = domain.surface
    b0, b1, b2 = weights[0], weights[1], weights[2]
    count, vertex = write_normals(face, (b0, b1, b2), surface, domain.sets, face_normals)
    v0, v1, v2 = surface.faces[face, 0], surface.faces[face, 1], surface.faces[face, 2]
    candidate.counts[i] = 1
    for c in range(3):
        candidate.normals[i, 0, c] = face_normals[0, c]
        candidate.points[i, c] = (
            b0 * surface.points[v0, c] + b1 * surface.points[v1, c] + b2 * surface.points[v2, c]
        )
    return count == 1 and vertex < 0


@merged
def set_contact(i, element, weights, domain, workspace):
    """Place contact i of a candidate on an element; returns whether a finger may stay there."""
    if domain.on_vertices:
        fits = set_vertex_contact(i, element, domain, workspace.candidate)
        return fits and workspace.candidate.counts[i] <= domain.max_normals
    return set_face_contact(
        i, element, weights, domain, workspace.candidate, workspace.face_normals
    )


@merged
def set_point_contact(i, point, domain, candidate_points, candidate):
    """Place contact i of a candidate at a candidate point; returns whether it may stay there."""
    if domain.on_vertices:
        return (
            set_vertex_contact(i, candidate_points.elements[point], domain, candidate)
            and candidate.counts[i] <= domain.max_normals
        )
    # Points are precomputed: neither interpolation nor crease tests in the innermost loops.
    candidate.counts[i] = 1
    for c in range(3):
        candidate.points[i, c] = candidate_points.points[point, c]
        candidate.normals[i, 0, c] = candidate_points.normals[point, c]
    return True


@merged
def distances_allowed(candidate, i, n, limits):
    """Whether the distances of contact i to the others of the first n are within the limits."""
    for j in range(n):
        if j != i:
            x = candidate.points[i, 0] - candidate.points[j, 0]
            y = candidate.points[i, 1] - candidate.points[j, 1]
            z = candidate.points[i, 2] - candidate.points[j, 2]
            square = x * x + y * y + z * z
            if (
                square < limits.min_distance * limits.min_distance
                or square > limits.max_distance * limits.max_distance
            ):
                return False
    return True
