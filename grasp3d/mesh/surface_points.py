"""Points on a surface, by face and barycentric coordinates; nearest surface points."""

import math
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np

from grasp3d._kernels.surface.box_tree import nearest_faces
from grasp3d.arrays import Bools, Floats, Ints, short_repr, unit_rows
from grasp3d.errors import SettingError
from grasp3d.mesh.measures import Triangles
from grasp3d.mesh.object_mesh import ObjectMesh
from grasp3d.mesh.ray_tracing import FaceRays
from grasp3d.settings.units import GivenLength
from grasp3d.system.context import report_progress, thread_count

ON_BORDER = 1e-9
"""Distance, in object sizes, within which a point counts as on a corner or an edge."""

NEAR = 0.05
"""Distance from the surface, in object sizes, up to which a position is on it."""

WAYS_OUT = unit_rows(np.array([[0.36, 0.48, 0.8], [-0.81, 0.31, 0.49], [0.29, -0.87, -0.41]]))
"""Directions of rays from a point, along no axis of an object."""

POINTS = 1 << 14
"""Points whose nearest surface points are searched at once."""


@dataclass(frozen=True, eq=False)
class SurfacePoints:
    """Points anywhere on a surface."""

    faces: Ints
    """Face of each point, shape (...); -1: no point."""
    weights: Floats
    """Barycentric coordinates on the face, shape (..., 3)."""

    __repr__ = short_repr

    def positions(self, mesh: ObjectMesh) -> Floats:
        """Positions in the mesh's frame, shape (..., 3)."""
        corners = mesh.vertices[mesh.faces[self.faces]]  # (..., 3, 3)
        return (self.weights[..., None, :] @ corners)[..., 0, :]


def nearest_surface_points(
    mesh: ObjectMesh, points: Floats, *, limit: float = math.inf
) -> tuple[SurfacePoints, Floats, Floats]:
    """Find the surface point that is nearest to each point.

    Exact: every face that could be nearer than the nearest one found is tested; of several that
    are equally near the first is taken.

    Args:
        mesh: The surface.
        points: Finite positions in the mesh's frame, shape (k, 3).
        limit: Largest distance to search [m].

    Returns:
        The surface points (k,); their positions (k, 3) in the mesh's frame; the distances
        (k,). Points farther away than `limit` have face -1, nan and inf.
    """
    numbers, weights = np.full(len(points), -1, dtype=np.int64), np.zeros((len(points), 3))
    reach = limit / mesh.size
    for start in range(0, len(points), POINTS):
        part = slice(start, start + POINTS)
        normalized = (points[part] - mesh.center) / mesh.size
        numbers[part], weights[part] = _nearest(mesh, normalized, reach)
        report_progress(min(part.stop / len(points), 1.0))
    surface_points = SurfacePoints(numbers, weights)
    missing = numbers < 0
    positions = np.where(missing[:, None], math.nan, surface_points.positions(mesh))
    distances = np.where(missing, math.inf, np.linalg.norm(positions - points, axis=1))
    far = distances > limit
    numbers[far], weights[far], positions[far], distances[far] = -1, 0.0, math.nan, math.inf
    return surface_points, positions, distances


def contains(mesh: ObjectMesh, points: Floats) -> Bools:
    """Whether points are in an object whose surface is closed, shape (k,).

    The first face that a ray from a point meets then shows its inner side; of three rays most
    count, as one may pass through an edge.

    Args:
        mesh: The object.
        points: Positions in the mesh's frame, shape (k, 3).
    """
    rays = FaceRays(mesh.normalized, mesh.faces)
    outward = -Triangles(mesh.normalized, mesh.faces).normals
    origins = ((points - mesh.center) / mesh.size).astype(np.float32)
    votes = np.zeros(len(points), dtype=np.int64)
    for direction in WAYS_OUT:
        toward = np.tile(direction, (len(points), 1))
        face = rays.hits(origins, toward.astype(np.float32))[0].astype(np.int64)
        votes += (face >= 0) & (outward[face] @ direction > 0.0)
    return np.asarray(2 * votes > len(WAYS_OUT))


def nearest_surface_point(mesh: ObjectMesh, point: Floats) -> tuple[Floats, int, Floats]:
    """Find the surface point that is nearest to a point.

    Args:
        mesh: The surface.
        point: Position in the normalised frame, shape (3,).

    Returns:
        Its position (3,) in the normalised frame, its face, and its barycentric coordinates (3,).
    """
    faces, weights = _nearest(mesh, np.array(point[None], dtype=np.float64), math.inf)
    face = int(faces[0])
    return weights[0] @ mesh.normalized[mesh.faces[face]], face, weights[0]


def nearest_vertex(mesh: ObjectMesh, name: str, position: Sequence[GivenLength]) -> int:
    """The vertex of a surface that is nearest to a position on it.

    It is the nearest corner of the face with the nearest point of the surface.

    Args:
        mesh: The surface.
        name: Name of the position, for the error.
        position: In the mesh's frame, three lengths.

    Raises:
        SettingError: It is farther from the surface than a twentieth of the object's size; or it
            has a unit, but that of the mesh is not known.
    """
    point = np.array([mesh.length(name, one) for one in position])
    nearest, face, weights = nearest_surface_point(mesh, (point - mesh.center) / mesh.size)
    distance = float(np.linalg.norm(mesh.from_normalized(nearest) - point))
    if distance > NEAR * mesh.size:
        at = ",".join(map(str, position))
        raise SettingError(
            f"{name} {at} is {mesh.length_text(distance)} from the surface of "
            f"{mesh.report.source}, more than the allowed {mesh.length_text(NEAR * mesh.size)}: "
            "give a point on the surface, in its frame with its unit"
        )
    return int(mesh.faces[face, np.argmax(weights)])


def _nearest(mesh: ObjectMesh, points: Floats, limit: float) -> tuple[Ints, Floats]:
    """Face nearest to each point (k,) and barycentric coordinates of the nearest point (k, 3).

    Points and limit are in the normalised frame; points beyond the limit have face -1.
    """
    faces, weights = np.full(len(points), -1, dtype=np.int64), np.zeros((len(points), 3))
    part = -(-len(points) // max(1, thread_count()))

    def search(first: int) -> None:
        nearest_faces(points, limit, first, min(first + part, len(points)), mesh.boxes, faces)

    with ThreadPoolExecutor(thread_count()) as executor:
        list(executor.map(search, range(0, len(points), max(1, part))))
    near = faces >= 0
    corners = mesh.normalized[mesh.faces[faces[near]]]
    weights[near] = _weights(corners, _closest(corners, points[near]))
    return faces, weights


def _closest(corners: Floats, points: Floats) -> Floats:
    """Nearest point of a triangle (k, 3, 3) to each point, shape (k, 3)."""
    from trimesh.triangles import closest_point

    origin = corners[:, 0]
    middle = corners.mean(axis=1, keepdims=True)
    scale = np.linalg.norm(corners - middle, axis=2).max(axis=1)[:, None]
    # In units of the face: trimesh's tolerances are absolute and too large for small faces.
    closest = closest_point(
        (corners - origin[:, None]) / scale[..., None], (points - origin) / scale
    )
    return np.asarray(origin + closest * scale)


def _weights(corners: Floats, points: Floats) -> Floats:
    """Barycentric coordinates of points (k, 3) on triangles (k, 3, 3), exact on their borders."""
    weights = _inside(corners, points)
    for i in range(3):  # edges first, as corners override them
        a, b = corners[:, (i + 1) % 3], corners[:, (i + 2) % 3]
        along = np.clip(np.vecdot(points - a, b - a) / np.vecdot(b - a, b - a), 0.0, 1.0)
        on = np.linalg.norm(a + along[:, None] * (b - a) - points, axis=1) <= ON_BORDER
        weights[on] = 0.0
        weights[on, (i + 1) % 3], weights[on, (i + 2) % 3] = 1.0 - along[on], along[on]
    for i in range(3):
        weights[np.linalg.norm(corners[:, i] - points, axis=1) <= ON_BORDER] = np.eye(3)[i]
    return weights


def _inside(corners: Floats, points: Floats) -> Floats:
    """Barycentric coordinates by areas; points of triangles without an area lie on their edges."""
    across = unit_rows(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]))
    edges = [corners[:, (i + 2) % 3] - corners[:, (i + 1) % 3] for i in range(3)]
    areas = [
        np.vecdot(np.cross(edge, points - corners[:, (i + 1) % 3]), across)
        for i, edge in enumerate(edges)
    ]
    weights = np.clip(np.stack(areas, axis=1), 0.0, None)
    total = weights.sum(axis=1, keepdims=True)
    even = np.full_like(weights, 1.0 / 3.0)
    return np.asarray(np.divide(weights, total, out=even, where=total > 0.0))
