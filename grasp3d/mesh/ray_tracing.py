"""Crossings of rays, and of edges, with a surface.

Embree finds the faces in 32 bits, or where it has no package, as on ARM, a tree of boxes in 64; the
rest is computed in 64 bits.
"""

import math
from importlib.util import find_spec
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from grasp3d._kernels.search.antipodal_candidates import BestPairs, PairLimits
from grasp3d._kernels.search.rays import STEP, Rays, evaluate_crossings, write_rays
from grasp3d._kernels.surface.box_tree import BoxTree, box_tree
from grasp3d._kernels.surface.first_faces import first_faces
from grasp3d._kernels.surface.surface_contacts import ContactNormals, Surface
from grasp3d.arrays import Bools, Floats, Ints, first_at_position, locked, unit_rows
from grasp3d.mesh.measures import edges_of
from grasp3d.system.context import in_threads

Singles: TypeAlias = npt.NDArray[np.float32]
Numbers: TypeAlias = npt.NDArray[np.int32]

CHUNK = 4096
"""Rays that a thread traces at once."""

BESIDE = 1e-5
"""Distance from a vertex, in object sizes, within which a face is one of those around it."""

MARGIN = 1e-6
"""Least distance of an edge's ends from the face that it passes through, and of the crossing from
the face's border, in the unit of the points: less may be the rounding of a file of 32 bits."""

MOST_ROUNDS = 256
"""Most faces that are found along one edge."""

MOST_RAYS = 20_000_000
"""Most rays along all edges: then no farther faces are searched."""

MOST_PAIRS = 5_000_000
"""Most pairs of faces, of which the first are reported."""


class EmbreeTracer:
    """The first faces that rays meet, by Embree."""

    def __init__(self, points: Floats, faces: Ints) -> None:
        from embreex.mesh_construction import TriangleMesh
        from embreex.rtcore_scene import EmbreeScene

        self._scene = EmbreeScene(robust=True)
        TriangleMesh(self._scene, points.astype(np.float32), faces.astype(np.int32))
        # The first ray makes Embree build its tree, which must not happen in two threads at once.
        self.hits(np.zeros((1, 3), np.float32), np.ones((1, 3), np.float32), None)

    def hits(
        self, origins: Singles, directions: Singles, lengths: Singles | None
    ) -> tuple[Numbers, Singles]:
        """See `FaceRays.hits`."""
        found = self._scene.run(origins, directions, dists=lengths, output=1)
        return found["primID"], found["tfar"]


class TreeTracer:
    """The same by our own tree of boxes."""

    def __init__(self, points: Floats, faces: Ints) -> None:
        self._tree: BoxTree = box_tree(locked(points), locked(faces))

    def hits(
        self, origins: Singles, directions: Singles, lengths: Singles | None
    ) -> tuple[Numbers, Singles]:
        """See `FaceRays.hits`."""
        count = len(origins)
        faces, far = np.empty(count, dtype=np.int32), np.empty(count, dtype=np.float32)
        ends = np.full(count, math.inf, dtype=np.float32) if lengths is None else lengths
        starts, toward = (np.ascontiguousarray(one) for one in (origins, directions))

        def work(rows: slice, _: Any) -> None:
            first_faces(starts, toward, ends, rows.start, rows.stop, self._tree, faces, far)

        in_threads(work, count, CHUNK)
        return faces, far


TRACER: type[EmbreeTracer | TreeTracer] = EmbreeTracer if find_spec("embreex") else TreeTracer
"""What traces rays here."""


class FaceRays:
    """Traces rays to the first face that each meets.

    Positions are in the normalised frame (centred, size 1), so that 32 bits of Embree resolve an
    object of any size, anywhere in space. Several threads may use one instance.
    """

    def __init__(self, points: Floats, faces: Ints) -> None:
        self._tracer = TRACER(points, faces)

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
        return self._tracer.hits(origins, directions, lengths)


class SurfaceRays(FaceRays):
    """Traces rays from vertices through a surface and evaluates the grasp at every crossing.

    Args:
        surface: The surface.
        sets: The normals of its vertices.
        allowed: Faces where opposing contacts may be; None: all.
    """

    def __init__(self, surface: Surface, sets: ContactNormals, allowed: Ints | None = None) -> None:
        super().__init__(surface.points, surface.faces)
        self._surface = surface
        self._sets = sets
        self._part: FaceRays | None = None
        if allowed is not None and len(allowed) < len(surface.faces):
            self._part = FaceRays(surface.points, surface.faces[allowed])
            self._numbers = np.append(allowed, -1).astype(np.int32)
            self._excluded = np.append(~np.isin(np.arange(len(surface.faces)), allowed), False)

    def evaluate_all(self, rays: Rays, limits: PairLimits, grasps: BestPairs) -> int:
        """Follow every ray through all its crossings and keep each vertex's best grasps.

        Args:
            rays: The rays; modified.
            limits: Openings and location error in the normalised frame.
            grasps: The best grasps so far; modified.

        Returns:
            Number of rays traced, those continued behind a crossing included.
        """
        if self._part is None:
            return self._follow(rays, limits, grasps)
        squeezing = rays.signs > 0
        parts = [Rays._make(one[rows] for one in rays) for rows in (squeezing, ~squeezing)]
        return sum(self._follow(part, limits, grasps) for part in parts)

    def _follow(self, rays: Rays, limits: PairLimits, grasps: BestPairs) -> int:
        """Follow rays, with a region those of one sign; see `evaluate_all`."""
        count = len(rays.owner)
        origins = np.empty((count, 3), dtype=np.float32)
        directions = np.empty((count, 3), dtype=np.float32)
        traced = 0
        while count:
            traced += count
            write_rays(count, rays, self._surface.points, origins, directions)
            faces, far = self._met(origins[:count], directions[:count], rays)
            count = evaluate_crossings(
                count, faces, far, rays, self._surface, self._sets, limits, grasps
            )
        return traced

    def _met(self, origins: Singles, directions: Singles, rays: Rays) -> tuple[Any, Any]:
        """Face that each ray meets first, -1: none, and its distance.

        What lies between squeezing fingers does not matter, so they meet allowed faces only; for
        expanding ones an excluded face is in the way.
        """
        if self._part is not None and rays.signs[0] > 0:
            faces, far = self._part.hits(origins, directions)
            return self._numbers[faces], far
        faces, far = self.hits(origins, directions)
        if self._part is None:
            return faces, far
        excluded, count = self._excluded[faces], len(faces)
        beside = excluded & (rays.along[:count] + far < BESIDE)  # the ray goes on
        rays.last[:count][beside] = faces[beside]
        return np.where(excluded & ~beside, np.int32(-1), faces), far


def crossings(points: Floats, faces: Ints) -> Ints:
    """Find faces that cross one another, also on open and non-manifold surfaces.

    Two triangles in general position cross where an edge of one passes through the other. A ray in
    32 bits finds all faces along each edge; a test in 64 bits keeps those that the edge surely
    passes through. Every reported pair crosses, but not all are reported: faces that graze, that
    are coplanar, or that meet in an edge or a corner count as touching.

    Args:
        points: Positions (V, 3) in the normalised frame: near the origin, size 1.
        faces: Faces (F, 3).

    Returns:
        The faces that cross, the smaller index first, each pair once, shape (P, 2).
    """
    corners = first_at_position(points)[faces]
    ends, counts, _, of_corner = edges_of(corners)
    owners = np.argsort(of_corner.ravel(), kind="stable") // 3  # faces at each edge
    first = np.concatenate([[0], np.cumsum(counts)])
    met_edges, met_faces = _met(points, corners, ends)
    apart = (ends[met_edges][:, :, None] != corners[met_faces][:, None, :]).all(axis=(1, 2))
    met_edges, met_faces = met_edges[apart], met_faces[apart]
    through = _passes(points[ends[met_edges]], points[corners[met_faces]])
    pairs = _pairs(met_edges[through], met_faces[through], owners, first)
    first, second = corners[pairs[:, 0]], corners[pairs[:, 1]]
    return np.asarray(pairs[(first[:, :, None] != second[:, None, :]).all(axis=(1, 2))])


def _met(points: Floats, corners: Ints, edges: Ints) -> tuple[Ints, Ints]:
    """Trace a ray along every edge through all faces: (edge, face) of each intersection."""
    rays = FaceRays(points, corners)
    origins, ends = points[edges[:, 0]], points[edges[:, 1]]
    directions = unit_rows(ends - origins)
    lengths = np.linalg.norm(ends - origins, axis=1)
    active = np.flatnonzero(lengths > 2.0 * STEP)
    along = np.full(len(edges), STEP)
    step = np.full(len(edges), STEP)
    met = [(active[:0], active[:0])]
    traced = 0
    for _ in range(MOST_ROUNDS):
        traced += len(active)
        if len(active) == 0 or traced > max(MOST_RAYS, len(edges)):
            break
        starts = origins[active] + along[active, None] * directions[active]
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


def _pairs(edges: Ints, faces: Ints, owners: Ints, first: Ints) -> Ints:
    """Pair each face that an edge passes through with the faces at that edge, (P, 2), each once."""
    counts = first[edges + 1] - first[edges]
    some = np.cumsum(counts) <= MOST_PAIRS
    edges, faces, counts = edges[some], faces[some], counts[some]
    offsets = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
    around = owners[np.repeat(first[edges], counts) + offsets]
    pairs = np.sort(np.column_stack([np.repeat(faces, counts), around]), axis=1)
    return np.unique(pairs, axis=0).reshape(-1, 2)
