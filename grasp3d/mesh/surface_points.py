"""Points on a surface, by face and barycentric coordinates; nearest surface points.

Also crossings of rays and edges with a surface. Embree finds the faces in 32 bits; where it has no
package, as on ARM, a tree of boxes finds them in 64 bits. The rest is computed in 64 bits.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from grasp3d._kernels.search.rays import STEP, first_faces
from grasp3d._kernels.surface.box_tree import BoxTree, box_tree, nearest_faces
from grasp3d.arrays import Bools, Floats, Ints, first_at_position, locked, short_repr, unit_rows
from grasp3d.errors import SettingError
from grasp3d.mesh.measures import Triangles
from grasp3d.mesh.object_mesh import ObjectMesh
from grasp3d.settings.units import GivenLength
from grasp3d.system.context import in_threads

ON_BORDER = 1e-9
"""Distance, in object sizes, within which a point counts as on a corner or an edge."""

NEAR = 0.05
"""Distance from the surface, in object sizes, up to which a position counts as on it."""

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

    The result is exact: every face that could be nearer than the nearest one found is tested. Of
    several equally near points, the first is taken.

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

    A point is inside if the first face that a ray from it meets shows its inner side. The majority
    of three rays decides, as one may pass through an edge.

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

    It is the nearest corner of the face that contains the nearest surface point.

    Args:
        mesh: The surface.
        name: Name of the position, for the error.
        position: Three lengths in the mesh's frame.

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
            "give a point on the surface, in the mesh's frame, with a unit (4cm,0,2cm)"
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


Singles: TypeAlias = npt.NDArray[np.float32]
Numbers: TypeAlias = npt.NDArray[np.int32]

RAYS_AT_ONCE = 4096
"""Rays that a thread traces at once."""

MARGIN = 1e-6
"""Smallest distance of an edge's ends from the face that it passes through, and of the crossing
from the face's border, in the unit of the points: smaller ones may be rounding of 32-bit files."""

MOST_ROUNDS = 256
"""Largest number of faces that are found along one edge."""


EMBREE = find_spec("embreex") is not None
"""Whether Embree traces rays here; otherwise a tree of boxes of this package does."""


class FaceRays:
    """Traces rays to the first face that each meets.

    Positions are in the normalised frame (centred, size 1), so that 32 bits of Embree resolve an
    object of any size, anywhere in space. Several threads may use one instance.
    """

    def __init__(self, points: Floats, faces: Ints) -> None:
        if not EMBREE:
            self._tree: BoxTree = box_tree(locked(points), locked(faces))
            return
        from embreex.mesh_construction import TriangleMesh
        from embreex.rtcore_scene import EmbreeScene

        self._scene = EmbreeScene(robust=True)
        TriangleMesh(self._scene, points.astype(np.float32), faces.astype(np.int32))
        # The first ray makes Embree build its tree, which must not happen in two threads at once.
        self.hits(np.zeros((1, 3), np.float32), np.ones((1, 3), np.float32))

    def hits(
        self, origins: Singles, directions: Singles, lengths: Singles | None = None
    ) -> tuple[Numbers, Singles]:
        """The first face that each ray meets.

        Args:
            origins: Where the rays start (n, 3).
            directions: Their unit vectors (n, 3).
            lengths: Where they end (n,); None: nowhere.

        Returns:
            The faces, -1: none, and their distances, (n,) each.
        """
        if EMBREE:
            found = self._scene.run(origins, directions, dists=lengths, output=1)
            return found["primID"], found["tfar"]
        count = len(origins)
        faces, far = np.empty(count, dtype=np.int32), np.empty(count, dtype=np.float32)
        ends = np.full(count, math.inf, dtype=np.float32) if lengths is None else lengths
        starts, toward = (np.ascontiguousarray(one) for one in (origins, directions))

        def work(rows: slice, _: Any) -> None:
            first_faces(starts, toward, ends, rows.start, rows.stop, self._tree, faces, far)

        in_threads(work, count, RAYS_AT_ONCE)
        return faces, far


def crossing_faces(surface: Triangles) -> Ints:
    """Find faces that cross others, also on open and non-manifold surfaces.

    Two triangles in general position cross where a side of one passes through the other. A ray in
    32 bits finds all faces along each side; a test in 64 bits keeps those that the side surely
    passes through. Every reported face crosses another, but not all are reported: faces that
    graze, that are coplanar, or that meet in an edge or a corner count as touching.

    Args:
        surface: In the normalised frame: near the origin, size 1.

    Returns:
        The faces that cross others, in ascending order.
    """
    points = surface.vertices
    corners = first_at_position(points)[surface.faces]
    ends = np.stack([corners, np.roll(corners, -1, axis=1)], axis=2).reshape(-1, 2)
    sides, met = _met(points, corners, ends)
    apart = (corners[sides // 3][:, :, None] != corners[met][:, None, :]).all(axis=(1, 2))
    sides, met = sides[apart], met[apart]
    through = _passes(points[ends[sides]], points[corners[met]])
    return np.unique([sides[through] // 3, met[through]])


def _met(points: Floats, corners: Ints, ends: Ints) -> tuple[Ints, Ints]:
    """Trace a ray along every side through all faces: (side, face) of each intersection."""
    rays = FaceRays(points, corners)
    directions = unit_rows(points[ends[:, 1]] - points[ends[:, 0]])
    lengths = np.linalg.norm(points[ends[:, 1]] - points[ends[:, 0]], axis=1)
    active = np.flatnonzero(lengths > 2.0 * STEP)
    along, step = np.full(len(ends), STEP), np.full(len(ends), STEP)
    met = [(active[:0], active[:0])]
    for _ in range(MOST_ROUNDS):
        if not len(active):
            break
        starts = points[ends[active, 0]] + along[active, None] * directions[active]
        faces, far = rays.hits(
            starts.astype(np.float32),
            directions[active].astype(np.float32),
            (lengths[active] - along[active]).astype(np.float32),
        )
        hit = faces >= 0
        active, far = active[hit], far[hit]
        met.append((active, faces[hit].astype(np.int64)))
        # A ray that makes no progress lies in a face: take a longer step.
        step[active] = np.where(far < step[active], 2.0 * step[active], STEP)
        along[active] += far + step[active]
        active = active[along[active] < lengths[active]]
    return np.concatenate([a for a, _ in met]), np.concatenate([b for _, b in met])


def _passes(edges: Floats, triangles: Floats) -> Bools:
    """Mask of the edges (m, 2, 3) that surely pass through their triangles (m, 3, 3)."""
    a, b = edges[:, 0], edges[:, 1]
    sides = np.roll(triangles, -1, axis=1) - triangles  # (m, 3 sides, 3)
    normal = unit_rows(np.cross(sides[:, 0], sides[:, 1]))
    above, below = (np.vecdot(end - triangles[:, 0], normal) for end in (a, b))
    opposite = (np.minimum(np.abs(above), np.abs(below)) > MARGIN) & (above * below < 0.0)
    fraction = np.divide(above, above - below, out=np.zeros_like(above), where=opposite)
    crossing = a + fraction[:, None] * (b - a)
    inward = unit_rows(np.cross(normal[:, None], sides))
    inside = np.vecdot(crossing[:, None] - triangles, inward).min(axis=1) > MARGIN
    return np.asarray(opposite & inside)
