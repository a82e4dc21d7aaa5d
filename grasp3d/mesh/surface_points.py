"""Points on a surface, by face and barycentric coordinates; nearest surface points."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from grasp3d._kernels.surface.box_tree import nearest_faces
from grasp3d.arrays import Bools, Floats, Ints, short_repr, unit_rows
from grasp3d.errors import SettingError
from grasp3d.mesh.measures import Triangles
from grasp3d.mesh.object_mesh import ObjectMesh
from grasp3d.mesh.ray_tracing import FaceRays
from grasp3d.settings.units import GivenLength
from grasp3d.system.context import in_threads

ON_BORDER = 1e-9
"""Distance, in object sizes, within which a point counts as on a corner or an edge."""

NEAR = 0.05
"""Distance from the surface, in object sizes, up to which a position is on it."""

WAYS_OUT = unit_rows(np.array([[0.36, 0.48, 0.8], [-0.81, 0.31, 0.49], [0.29, -0.87, -0.41]]))
"""Directions of rays from a point, along no axis of an object."""

CHUNK = 1024
"""Points whose nearest surface points a thread searches at once."""


@dataclass(frozen=True, eq=False)
class SurfacePoints:
    """Points anywhere on a surface."""

    faces: Ints
    """Face of each point, shape (...); -1: no point."""
    weights: Floats
    """Barycentric coordinates on the face, shape (..., 3)."""

    __repr__ = short_repr

    def positions(self, mesh: ObjectMesh) -> Floats:
        """Positions in the mesh's frame, shape (..., 3); nan: no point."""
        corners = mesh.vertices[mesh.faces[self.faces]]  # (..., 3, 3)
        positions = (self.weights[..., None, :] @ corners)[..., 0, :]
        return np.where(self.faces[..., None] >= 0, positions, math.nan)


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
    normalized = (points - mesh.center) / mesh.size
    faces, weights = np.full(len(points), -1, dtype=np.int64), np.zeros((len(points), 3))

    def search(rows: slice, _: Any) -> None:
        nearest_faces(normalized, limit / mesh.size, rows.start, rows.stop, mesh.boxes, faces)

    in_threads(search, len(points), CHUNK)
    near = faces >= 0
    corners = mesh.normalized[mesh.faces[faces[near]]]
    weights[near] = _weights(corners, _closest(corners, normalized[near]))
    surface_points = SurfacePoints(faces, weights)
    positions = surface_points.positions(mesh)
    distances = np.where(near, np.linalg.norm(positions - points, axis=1), math.inf)
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
    ways = np.repeat(WAYS_OUT.astype(np.float32)[:, None], len(points), axis=1)  # (3, k, 3)
    faces = np.stack([rays.hits(origins, way)[0].astype(np.int64) for way in ways])
    votes = (faces >= 0) & (np.vecdot(outward[faces], ways) > 0.0)
    return np.asarray(votes.sum(axis=0) > 1)


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
    nearest, _, (distance,) = nearest_surface_points(mesh, point[None])
    if distance > NEAR * mesh.size:
        at = ",".join(map(str, position))
        raise SettingError(
            f"{name} {at} is {mesh.length_text(distance)} from the surface of "
            f"{mesh.report.source}, more than the allowed {mesh.length_text(NEAR * mesh.size)}: "
            "give a point on the surface, in its frame with its unit"
        )
    return int(mesh.faces[nearest.faces[0], np.argmax(nearest.weights[0])])


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
    two, three = (np.roll(corners, -k, axis=1) - points[:, None] for k in (1, 2))
    weights = np.clip(np.vecdot(np.cross(two, three), across[:, None]), 0.0, None)
    total = weights.sum(axis=1, keepdims=True)
    even = np.full_like(weights, 1.0 / 3.0)
    return np.asarray(np.divide(weights, total, out=even, where=total > 0.0))
