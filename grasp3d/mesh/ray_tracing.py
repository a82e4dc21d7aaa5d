"""Crossings of rays, and of edges, with a surface.

Embree finds the faces in 32 bits, or where it has no package, as on ARM, a tree of boxes in 64; the
rest is computed in 64 bits.
"""

import math
from importlib.util import find_spec
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from grasp3d._kernels.search.rays import STEP
from grasp3d._kernels.surface.box_tree import BoxTree, box_tree
from grasp3d._kernels.surface.first_faces import first_faces
from grasp3d.arrays import Bools, Floats, Ints, first_at_position, locked, unit_rows
from grasp3d.mesh.measures import Triangles
from grasp3d.system.context import in_threads

Singles: TypeAlias = npt.NDArray[np.float32]
Numbers: TypeAlias = npt.NDArray[np.int32]

CHUNK = 4096
"""Rays that a thread traces at once."""

MARGIN = 1e-6
"""Least distance of an edge's ends from the face that it passes through, and of the crossing from
the face's border, in the unit of the points: less may be the rounding of a file of 32 bits."""

MOST_ROUNDS = 256
"""Most faces that are found along one edge."""


EMBREE = find_spec("embreex") is not None
"""Whether Embree traces rays here; otherwise a tree of boxes of ours does."""


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

        in_threads(work, count, CHUNK)
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
