"""Places on a surface."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import chain
from typing import NamedTuple

import numpy as np
import trimesh
from scipy.spatial import KDTree

from grasp3d.arrays import Floats, Ints, unit_rows
from grasp3d.mesh.object_mesh import ObjectMesh
from grasp3d.system.progress import Progress, ignore

ON_BORDER = 1e-9
"""Distance, in object sizes, from which a place near a corner or an edge is not on it."""

POINTS = 1 << 14
"""Points whose nearest places are sought at once."""

PAIRS = 1 << 18
"""Points and faces near them that are in memory at once."""


@dataclass(frozen=True, eq=False)
class SurfacePoints:
    """Places anywhere on a surface."""

    faces: Ints
    """Face of each, shape (...); -1: nowhere."""
    weights: Floats
    """Barycentric coordinates on it, shape (..., 3)."""

    def positions(self, mesh: ObjectMesh) -> Floats:
        """Where they are, in the mesh's frame and unit, shape (..., 3)."""
        corners = mesh.vertices[mesh.faces[self.faces]]  # (..., 3, 3)
        return (self.weights[..., None, :] @ corners)[..., 0, :]


def nearest_surface_points(
    mesh: ObjectMesh,
    points: Floats,
    *,
    limit: float = math.inf,
    threads: int = 1,
    progress: Progress | None = None,
) -> tuple[SurfacePoints, Floats, Floats]:
    """Find the place of the surface that is nearest to each point.

    Exact: every face that could be nearer than the nearest one is tried; of several that are
    equally near the first counts.

    Args:
        mesh: The surface.
        points: Finite positions in the mesh's frame and unit, shape (k, 3).
        limit: Distance from which places need not be found, in the mesh's unit. Points far from a
            surface are as near to much of it, so that without a limit they take long.
        threads: Threads to use.
        progress: Called with the share of the work done, from 0 to 1.

    Returns:
        The places (k,); their positions (k, 3) in the mesh's frame and unit; the distances (k,).
        Points that are farther off than `limit` have face -1, nan and inf.
    """
    faces = _Faces.of(mesh.normalized[mesh.faces])
    found, weights = np.full(len(points), -1, dtype=np.int64), np.zeros((len(points), 3))
    reach = limit / mesh.size
    for start in range(0, len(points), POINTS):
        part = slice(start, start + POINTS)
        asked = (points[part] - mesh.center) / mesh.size
        found[part], weights[part] = faces.nearest(asked, reach, threads)
        (progress or ignore)(min(part.stop / len(points), 1.0))
    places = SurfacePoints(found, weights)
    missing = found < 0
    positions = np.where(missing[:, None], math.nan, places.positions(mesh))
    distances = np.where(missing, math.inf, np.linalg.norm(positions - points, axis=1))
    far = distances > limit
    found[far], weights[far], positions[far], distances[far] = -1, 0.0, math.nan, math.inf
    return places, positions, distances


def nearest_surface_point(mesh: ObjectMesh, point: Floats) -> tuple[Floats, int, Floats]:
    """Find the place of the surface that is nearest to a point.

    Args:
        mesh: The surface.
        point: Position in the normalised frame, shape (3,).

    Returns:
        The place (3,) in the normalised frame, its face, and its barycentric coordinates (3,).
    """
    corners = mesh.normalized[mesh.faces]
    found, weights = _Faces.of(corners).nearest(point[None], math.inf, 1)
    face = int(found[0])
    return weights[0] @ corners[face], face, weights[0]


class _Alike(NamedTuple):
    """Faces of about one size."""

    numbers: Ints
    tree: KDTree
    """Of their middles."""
    radius: float
    """Largest of their radii."""


@dataclass(frozen=True, eq=False)
class _Faces:
    """The faces of a surface in the normalised frame, to be searched."""

    corners: Floats
    """Shape (F, 3, 3)."""
    radii: Floats
    """Largest distance of a corner from the middle, shape (F,)."""
    tree: KDTree
    """Of the middles."""
    kinds: tuple[_Alike, ...]
    """All faces, parted by size: beside large faces small ones would all seem near."""

    @classmethod
    def of(cls, corners: Floats) -> "_Faces":
        middles = corners.mean(axis=1)
        radii = np.linalg.norm(corners - middles[:, None], axis=2).max(axis=1)
        sizes = np.ceil(np.log2(radii))
        kinds = []
        for size in np.unique(sizes):
            numbers = np.flatnonzero(sizes == size)
            kinds.append(_Alike(numbers, KDTree(middles[numbers]), float(radii[numbers].max())))
        return cls(corners, radii, KDTree(middles), tuple(kinds))

    def nearest(self, points: Floats, limit: float, threads: int) -> tuple[Ints, Floats]:
        """Face of the place nearest to each point (k,) and barycentric coordinates (k, 3).

        Points that are surely beyond the limit have face -1.
        """
        _, first = self.tree.query(
            points, distance_upper_bound=limit + self.radii.max(), workers=threads
        )
        first = np.asarray(first, dtype=np.int64)
        near = np.flatnonzero(first < len(self.radii))
        faces, weights = np.full(len(points), -1, dtype=np.int64), np.zeros((len(points), 3))
        asked, found = points[near], first[near]
        least = self._distances(asked, found)
        for kind in self.kinds:
            for rows, tried in _pairs(kind, asked, least, threads):
                which, faces_here, least_here = self._best(asked, rows, tried)
                better = (least_here < least[which]) | (
                    (least_here == least[which]) & (faces_here < found[which])
                )
                found[which[better]] = faces_here[better]
                least[which[better]] = least_here[better]
        faces[near] = found
        weights[near] = _weights(self.corners[found], self._closest(asked, found))
        return faces, weights

    def _best(self, points: Floats, rows: Ints, tried: Ints) -> tuple[Ints, Ints, Floats]:
        """Nearest face tried at each point, the first of equals: (points, faces, distances)."""
        distances = self._distances(points[rows], tried)
        start = np.flatnonzero(np.diff(rows, prepend=-1))
        least = np.minimum.reduceat(distances, start)
        count = np.diff(start, append=len(rows))
        nearest = np.where(distances == np.repeat(least, count), tried, len(self.radii))
        return rows[start], np.minimum.reduceat(nearest, start), least

    def _distances(self, points: Floats, faces: Ints) -> Floats:
        """From points (k, 3) to a face each, shape (k,)."""
        return np.asarray(np.linalg.norm(self._closest(points, faces) - points, axis=1))

    def _closest(self, points: Floats, faces: Ints) -> Floats:
        """Nearest places of a face each, shape (k, 3)."""
        corners, scale = self.corners[faces], self.radii[faces][:, None]
        origin = corners[:, 0]
        # In units of the face: trimesh's tolerances are absolute, and small faces would vanish.
        closest = trimesh.triangles.closest_point(
            (corners - origin[:, None]) / scale[..., None], (points - origin) / scale
        )
        return np.asarray(origin + closest * scale)


def _pairs(
    kind: _Alike, points: Floats, least: Floats, threads: int
) -> Iterator[tuple[Ints, Ints]]:
    """Points, by number and in order, and the faces that may be nearer to them than `least`."""
    reach = least + kind.radius
    reach *= 1.0 + 1e-12  # rounding must not leave out the face itself
    counts = np.asarray(
        kind.tree.query_ball_point(points, reach, return_length=True, workers=threads)
    )
    near = np.flatnonzero(counts)
    part = np.cumsum(counts[near]) // PAIRS
    for number in np.unique(part):
        rows = near[part == number]
        lists = kind.tree.query_ball_point(points[rows], reach[rows])
        tried = np.fromiter(chain.from_iterable(lists), np.int64, int(counts[rows].sum()))
        yield np.repeat(rows, counts[rows]), kind.numbers[tried]


def _weights(corners: Floats, places: Floats) -> Floats:
    """Barycentric coordinates of places (k, 3) on triangles (k, 3, 3), exact on their borders."""
    weights = _inside(corners, places)
    for i in range(3):  # edges, then corners: the nearest border has the last word
        a, b = corners[:, (i + 1) % 3], corners[:, (i + 2) % 3]
        along = np.clip(_dot(places - a, b - a) / _dot(b - a, b - a), 0.0, 1.0)
        on = np.linalg.norm(a + along[:, None] * (b - a) - places, axis=1) <= ON_BORDER
        weights[on] = 0.0
        weights[on, (i + 1) % 3], weights[on, (i + 2) % 3] = 1.0 - along[on], along[on]
    for i in range(3):
        weights[np.linalg.norm(corners[:, i] - places, axis=1) <= ON_BORDER] = np.eye(3)[i]
    return weights


def _inside(corners: Floats, places: Floats) -> Floats:
    """Barycentric coordinates by areas; a triangle without area has its places on its edges."""
    across = unit_rows(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]))
    edges = [corners[:, (i + 2) % 3] - corners[:, (i + 1) % 3] for i in range(3)]
    areas = [
        _dot(np.cross(edge, places - corners[:, (i + 1) % 3]), across)
        for i, edge in enumerate(edges)
    ]
    weights = np.clip(np.stack(areas, axis=1), 0.0, None)
    total = weights.sum(axis=1, keepdims=True)
    even = np.full_like(weights, 1.0 / 3.0)
    return np.asarray(np.divide(weights, total, out=even, where=total > 0.0))


def _dot(a: Floats, b: Floats) -> Floats:
    return np.asarray((a * b).sum(axis=1))
