"""Division of long edges, so that labels can vary within a large flat face."""

from dataclasses import dataclass

import numpy as np
import trimesh
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from grasp3d.arrays import Floats, Ints, first_at_position, unit_rows
from grasp3d.mesh.measures import face_areas
from grasp3d.mesh.normals import CornerNormals, paired_edges
from grasp3d.mesh.work_bounds import close_pairs

MAX_ROUNDS = 40


@dataclass(frozen=True, eq=False)
class RefinedSurface:
    """The same surface with no edge longer than requested; given vertices first."""

    vertices: Floats
    """Shape (V', 3); the first V are the given vertices, unchanged."""
    faces: Ints
    """Shape (F', 3)."""
    normals: CornerNormals
    """Interpolated along with the positions, so that a coarse round surface stays round."""


def refine(
    vertices: Floats, faces: Ints, normals: CornerNormals, max_edge: float, rounding: float
) -> RefinedSurface:
    """Bisect every edge longer than `max_edge`, until none is left.

    Args:
        vertices: Positions (V, 3).
        faces: Faces (F, 3).
        normals: Normals at the corners of the faces.
        max_edge: Longest edge allowed, in the unit of `vertices`.
        rounding: Largest error of a coordinate, in the same unit.
    """
    # Positions and normals are columns of one array, one row per patch at a vertex: the columns
    # after the first three are interpolated but do not count for an edge's length.
    rows = np.hstack([vertices[normals.vertices], normals.normals])
    rows, corners = trimesh.remesh.subdivide_to_size(
        rows, normals.corners, max_edge * (1.0 + 1e-9), max_iter=MAX_ROUNDS
    )
    count = len(normals.vertices)
    first = first_at_position(rows[:, :3])  # the two sides of a crease make the same midpoints
    if len(paired_edges(faces)[0]) * 2 < faces.size:
        tolerance = 8.0 * max(rounding, np.finfo(np.float64).eps)
        first = _first_nearby(rows[:, :3], first, count, tolerance)
    own = (first == np.arange(len(rows))) & (np.arange(len(rows)) >= count)
    number = np.concatenate([normals.vertices, len(vertices) + np.cumsum(own)[count:] - 1])
    vertex_of_row = number[first]
    return RefinedSurface(
        vertices=np.concatenate([vertices, rows[own, :3]]),
        faces=vertex_of_row[corners],
        normals=CornerNormals(corners, unit_rows(rows[:, 3:]), vertex_of_row),
    )


def refined_corners(vertices: Floats, faces: Ints, max_edge: float) -> tuple[Ints, Floats]:
    """Where the faces that `refine` makes lie on the given ones.

    Args:
        vertices: Positions (V, 3).
        faces: Faces (F, 3).
        max_edge: Longest edge allowed, in the unit of `vertices`.

    Returns:
        The given face of each face (F',), in the order of `refine`; barycentric coordinates of its
        three corners there, shape (F', 3, 3).
    """
    # Each face has corners of its own, with their coordinates as columns beside the position; how a
    # face is divided depends on the lengths of its edges only.
    rows = np.hstack([vertices[faces].reshape(-1, 3), np.tile(np.eye(3), (len(faces), 1))])
    rows, corners, parents = trimesh.remesh.subdivide_to_size(
        rows,
        np.arange(len(rows)).reshape(-1, 3),
        max_edge * (1.0 + 1e-9),
        max_iter=MAX_ROUNDS,
        return_index=True,
    )
    return parents, rows[corners][..., 3:]


def _first_nearby(points: Floats, same: Ints, given: int, tolerance: float) -> Ints:
    """First point within a tolerance of each added point, shape (n,).

    `same` is the first point at each point's position. At a T-junction one face has a vertex in the
    middle of another's edge, and the midpoints of the one lie on those of the other only up to
    rounding.
    """
    distinct = np.flatnonzero(same == np.arange(len(points)))  # any number may be at one position
    pairs = distinct[close_pairs(points[distinct], tolerance)]
    ends = np.concatenate([pairs.T, [np.arange(len(points)), same]], axis=1)
    links = coo_array(
        (np.ones(ends.shape[1], dtype=np.int8), tuple(ends)), shape=(len(points),) * 2
    )
    _, part = connected_components(links, directed=False)
    _, first, inverse = np.unique(part, return_index=True, return_inverse=True)
    result = first[inverse]
    result[:given] = np.arange(given)  # given vertices stay distinct
    return np.asarray(result, dtype=np.int64)


def refined_faces(vertices: Floats, faces: Ints, max_edge: float) -> float:
    """Estimate the number of faces after refinement of positions (V, 3), faces (F, 3)."""
    a, b, c = vertices[faces[:, 0]], vertices[faces[:, 1]], vertices[faces[:, 2]]
    area = face_areas(vertices, faces).sum()
    longest = np.max([np.linalg.norm(x - y, axis=1) for x, y in ((a, b), (b, c), (c, a))], axis=0)
    return float(2.0 * area / max_edge**2 + (2.0 * longest / max_edge).sum() + len(faces))
