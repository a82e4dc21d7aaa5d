"""Division of long edges, so that labels can vary within a large flat face."""

import numpy as np

from grasp3d.arrays import Floats, Ints, first_at_position, unit_rows
from grasp3d.mesh.measures import Triangles
from grasp3d.mesh.normals import CornerNormals
from grasp3d.mesh.repair.cleaning import clusters
from grasp3d.settings.costs import check_cost

MAX_ROUNDS = 40

DEFAULT_EDGE = 1.0 / 32.0
"""Longest edge as a fraction of the object's size."""

MANY = 1e15
"""Upper bound of estimated face counts, so that they fit an integer."""


def refine(
    surface: Triangles, normals: CornerNormals, max_edge: float, rounding: float
) -> tuple[Triangles, CornerNormals]:
    """Bisect every edge longer than `max_edge`, until none is left.

    Args:
        surface: The surface.
        normals: Normals at the corners of its faces.
        max_edge: Longest edge allowed, in the unit of the vertices.
        rounding: Largest error of a coordinate, in the same unit.

    Returns:
        The same surface, with the given vertices first and unchanged; normals at the corners of its
        faces, interpolated like the positions, so that a coarse round surface stays round.
    """
    from trimesh.remesh import subdivide_to_size

    vertices, (one, _) = surface.vertices, surface.pairs
    # Positions and normals are columns of one array, one row per patch at a vertex: the columns
    # after the first three are interpolated but do not count for an edge's length.
    rows = np.hstack([vertices[normals.vertices], normals.normals])
    rows, corners = subdivide_to_size(
        rows, normals.corners, max_edge * (1.0 + 1e-9), max_iter=MAX_ROUNDS
    )
    count = len(normals.vertices)
    first = first_at_position(rows[:, :3])  # the two sides of a crease make the same midpoints
    if len(one) * 2 < surface.faces.size:
        tolerance = 8.0 * max(rounding, np.finfo(np.float64).eps)
        first = _first_nearby(rows[:, :3], first, count, tolerance)
    own = (first == np.arange(len(rows))) & (np.arange(len(rows)) >= count)
    number = np.concatenate([normals.vertices, len(vertices) + np.cumsum(own)[count:] - 1])
    vertex_of_row = number[first]
    return (
        Triangles(np.concatenate([vertices, rows[own, :3]]), vertex_of_row[corners]),
        CornerNormals(corners, unit_rows(rows[:, 3:]), vertex_of_row),
    )


def _first_nearby(points: Floats, same: Ints, count: int, tolerance: float) -> Ints:
    """First point within a tolerance of each added point, shape (n,).

    `same` is the first point at each point's position. At a T-junction one face has a vertex in the
    middle of another's edge, and the midpoints of the two faces there agree only up to rounding.
    """
    distinct, row = np.unique(same, return_inverse=True)  # any number may be at one position
    first = distinct[clusters(points[distinct], tolerance)][row]
    first[:count] = np.arange(count)  # given vertices stay distinct
    return first


def check_refinement(surface: Triangles, max_edge: float, max_memory: float, where: str) -> None:
    """Refuse a surface of which refinement would make too large a mesh.

    Args:
        surface: The surface.
        max_edge: Longest edge allowed, in the unit of the vertices.
        max_memory: Largest memory for labelling [GB].
        where: Name of the mesh in errors.

    Raises:
        MeshError: The mesh would be too large.
    """
    count, corners = len(surface.faces), surface.vertices[surface.faces]
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    faces = 2.0 * surface.areas.sum() / max_edge**2 + (2.0 * longest / max_edge).sum() + count
    added = int(min(faces, MANY)) - count
    expected = max(len(surface.used), count // 2) + added // 2
    check_cost(expected, max_memory, where, "give a longer max_edge (--max-edge)")
