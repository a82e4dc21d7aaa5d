"""The best two-finger grasp through every vertex.

Rays from a vertex find the vertices that a second finger can take; the critical friction angle of
each pair is exact, so the search can only miss a grasp, never make one up. The best ones found are
then improved: by ever narrower rings of rays about them, and by the partners of the neighbours.
"""

import math
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np
from scipy.sparse import coo_array

from grasp3d._kernels.antipodal_candidates import FOUND, NO_PARTNER, Grasps
from grasp3d._kernels.antipodal_directions import Frames, seed_rays
from grasp3d._kernels.antipodal_neighbours import shared_rays
from grasp3d._kernels.antipodal_refinement import PROPOSALS, exploring_rays, refining_rays
from grasp3d._kernels.ray_crossings import SMALLEST
from grasp3d._kernels.ray_tracing import Rays
from grasp3d.arrays import Bools, Bytes, Floats, Ints, unit_rows
from grasp3d.mesh import ObjectMesh
from grasp3d.mesh.ray_tracing import SurfaceRays
from grasp3d.mesh.surface_points import SurfacePoints
from grasp3d.settings import Sampling
from grasp3d.system.progress import Progress, ignore

CHUNK = 100_000
"""Rays in flight per thread: bounds the memory and stays in the processor's cache."""

SEED_BATCHES = (0.0, 0.125, 0.375, 1.0)
"""How the first directions are parted; from batch to batch more of them need no ray."""

STARTS = 3
"""Grasps per vertex, apart from each other, around which the search begins."""

EXPLORING_ROUNDS = 3
"""Rounds in which all starts are tried before the best one alone goes on."""

SWEEPS = 3
"""How often the neighbours' partners are tried and what they improve is refined again."""

MAX_ROUNDS = 30
"""Most rounds of refinement in one sweep; rings shrink to the tolerance long before."""

FALL = 0.1
"""Share of the tolerance by which a critical angle must fall for its ring to keep its size."""

SLACK = 1e-6
"""What an opening may exceed its limits by, in object sizes: more than a file's rounding."""

CLEAR = 1e-3
"""Length across the normal, in object sizes, from which a reference direction counts."""

EVEN = 1e-9
"""Third moment, in object sizes cubed, below which the ends of an axis are not told apart."""


@dataclass(frozen=True, eq=False)
class AntipodalGrasps:
    """The best two-finger grasp found at each vertex, in the mesh's own frame and unit."""

    worst: Floats
    """Critical friction angle over the contacts' worst normals [rad], inf: none found. (V,)"""
    best: Floats
    """The same over the contacts' best normals, of a grasp of its own. (V,)"""
    partner: Floats
    """Second contact of the grasp of `worst`, nan where there is none. (V, 3)"""
    partner_normal: Floats
    """Inward unit normal there. (V, 3)"""
    partner_points: SurfacePoints
    """Second contacts of the grasps of `worst` and of `best`. (V, 2)"""
    grip: np.ndarray[Any, np.dtype[np.int8]]
    """+1 squeeze, -1 expand, 0 none. (V,)"""
    reason: Bytes
    """0 found, 1 no partner met, 2 every partner outside the opening limits. (V,)"""
    rays: int
    """Rays traced in all."""
    rounds: int
    """Rounds of refinement."""
    still_falling: float
    """Share of the vertices that the last trial of their neighbours' partners still improved."""


def best_pairs(
    mesh: ObjectMesh,
    sampling: Sampling,
    cone: float,
    *,
    threads: int = 1,
    progress: Progress | None = None,
) -> AntipodalGrasps:
    """Search the best two-finger grasp through every vertex of the surface.

    The result does not depend on the number of threads.

    Args:
        mesh: The surface.
        sampling: Rays, grip, opening limits and tolerance.
        cone: Half-angle of the cone of directions about the inward normals [rad].
        threads: Threads to use.
        progress: Called with the share of the work done, from 0 to 1.
    """
    with ThreadPoolExecutor(threads) as pool:
        search = _Search(mesh, sampling, cone, threads, pool, progress or ignore)
        return search.run()


def tangents(mesh: ObjectMesh) -> Floats:
    """A direction across each vertex's normal that turns with the object, shape (V, 3).

    Taken from the mesh's own geometry, so that the same object turned, moved, scaled or with its
    vertices in another order is searched along the same lines: the direction away from the centre;
    where that is the normal itself, the object's lopsidedness, its main axes, and at last, for
    objects as regular as a ball, an edge.
    """
    centres = mesh.normal_sets.centres
    points = mesh.normalized
    weights = mesh.vertex_areas / mesh.vertex_areas.sum()
    squares = np.einsum("ij,ij->i", points, points)
    moments = (points * weights[:, None]).T @ points
    lopsided = ((weights * squares)[:, None] * points).sum(axis=0)
    _, axes = np.linalg.eigh(moments)
    skew = ((points @ axes) ** 3 * weights[:, None]).sum(axis=0)
    signs = np.where(np.abs(skew) > EVEN, np.sign(skew), 0.0)
    edge = np.zeros_like(points)
    for k in (2, 1, 0):
        edge[mesh.faces[:, k]] = points[mesh.faces[:, (k + 1) % 3]] - points[mesh.faces[:, k]]
    fixed = [lopsided, axes[:, 2] * signs[2], axes[:, 0] * signs[0]]
    result = np.zeros_like(points)
    missing = np.ones(len(points), dtype=bool)
    for reference in (points, *fixed, unit_rows(edge)):
        across = reference - (reference * centres).sum(axis=1, keepdims=True) * centres
        clear = missing & (np.linalg.norm(across, axis=1) > CLEAR)
        result[clear] = across[clear]
        missing &= ~clear
    return unit_rows(result)


def neighbours(mesh: ObjectMesh) -> tuple[Ints, Ints]:
    """(first, index): the vertices around each vertex, as the kernels take them."""
    one, two = mesh.faces[:, [0, 1, 2]].ravel(), mesh.faces[:, [1, 2, 0]].ravel()
    links = coo_array(
        (
            np.ones(2 * len(one), dtype=np.int8),
            (np.concatenate([one, two]), np.concatenate([two, one])),
        ),
        shape=(len(mesh.vertices),) * 2,
    ).tocsr()
    return links.indptr.astype(np.int64), links.indices.astype(np.int64)


@dataclass(eq=False)
class _Search:
    """The state of one search over all vertices of a mesh, in its normalised frame."""

    mesh: ObjectMesh
    sampling: Sampling
    cone: float
    threads: int
    pool: ThreadPoolExecutor
    progress: Progress
    traced: int = field(default=0, init=False)

    def __post_init__(self) -> None:
        mesh = self.mesh
        count = len(mesh.vertices)
        self.spacing = math.sqrt(2.0 * math.pi * (1.0 - math.cos(self.cone)) / self.sampling.rays)
        self.vertices = np.unique(mesh.faces)
        self.limits = (
            max(self.sampling.min_opening / mesh.size - SLACK, SMALLEST),
            self.sampling.max_opening / mesh.size + SLACK,
        )
        self.sets = mesh.contact_normals
        self.surface = mesh.contact_surface
        self.frames = Frames(mesh.normal_sets.centres, tangents(mesh), mesh.normal_sets.radii)
        self.around = neighbours(mesh)
        self.tracer = SurfaceRays(self.surface, self.sets)
        self.grasps = Grasps(
            worst=np.full(count, math.inf),
            best=np.full(count, math.inf),
            closing=np.zeros((count, 3)),
            closing_best=np.zeros((count, 3)),
            partner=np.full((count, 3), math.nan),
            partner_normal=np.full((count, 3), math.nan),
            faces=np.full((count, 2), -1, dtype=np.int64),
            weights=np.zeros((count, 2, 3)),
            signs=np.zeros(count, dtype=np.int8),
            signs_best=np.zeros(count, dtype=np.int8),
            reason=np.full(count, NO_PARTNER, dtype=np.uint8),
            starts=np.zeros((count, STARTS, 3)),
            start_angles=np.full((count, STARTS), math.inf),
            start_signs=np.zeros((count, STARTS), dtype=np.int8),
            apart=math.cos(self.spacing),
        )

    def run(self) -> AntipodalGrasps:
        """Seed, explore several starts, and refine the best until neighbours add nothing."""
        spacing = self.spacing
        self._seed(share=0.5)
        for number in range(EXPLORING_ROUNDS):
            self._explore(spacing / 2.0 ** (number + 1), turn=0.5 * (number % 2))
        radii = np.full(len(self.mesh.vertices), 0.5 * spacing)
        rounds, falling = 0, 0.0
        for sweep in range(SWEEPS):
            fell = self._falls(self._share)
            falling = float(fell.sum()) / len(self.vertices)
            if sweep:
                radii[fell] = 0.25 * spacing
            rounds += self._descend(radii)
            self.progress(0.5 + 0.5 * (sweep + 1) / SWEEPS)
        return self._result(rounds, falling)

    def _descend(self, radii: Floats) -> int:
        """Shrink the rings about the grasps wherever they find nothing better; returns rounds."""
        for number in range(MAX_ROUNDS):
            vertices = self._open_places()
            vertices = vertices[
                (radii[vertices] > self.sampling.tolerance)
                & (self.grasps.reason[vertices] == FOUND)
            ]
            if len(vertices) == 0:
                return number
            fell = self._falls(partial(self._refine, vertices, radii, turn=0.5 * (number % 2)))
            radii[vertices[~fell[vertices]]] *= 0.5
        return MAX_ROUNDS

    def _falls(self, improve: Callable[[], None]) -> Bools:
        """Tell the vertices whose critical angles some work lowers by more than rounding."""
        worst, best = self.grasps.worst.copy(), self.grasps.best.copy()
        improve()
        enough = FALL * self.sampling.tolerance
        return (self.grasps.worst < worst - enough) | (self.grasps.best < best - enough)

    def _seed(self, share: float) -> None:
        """Try the first directions, those near the normal first: they may settle the matter."""
        count = self.sampling.rays
        signs = {"squeeze": (1,), "expand": (-1,), "both": (1, -1)}[self.sampling.grip]
        edges = [round(count * part) for part in SEED_BATCHES]
        tasks = [(batch, sign) for batch in pairwise(edges) for sign in signs]
        for number, (batch, sign) in enumerate(tasks):
            self._trace(
                self.vertices,
                partial(self._seed_rays, batch, sign),
                batch[1] - batch[0],
                (share * number / len(tasks), share / len(tasks)),
            )

    def _seed_rays(self, batch: tuple[int, int], sign: int, vertices: Ints) -> Rays:
        rays: Rays = seed_rays(
            vertices,
            self.sampling.rays,
            batch,
            self.cone,
            sign,
            self.frames,
            self.sets,
            self.grasps,
        )
        return rays

    def _share(self) -> None:
        """Try the partners that the neighbours had found when the round began."""
        before = self.grasps._replace(
            signs=self.grasps.signs.copy(),
            partner=self.grasps.partner.copy(),
            reason=self.grasps.reason.copy(),
        )
        self._trace(
            self._open_places(),
            lambda vertices: shared_rays(
                vertices, self.cone, self.surface.points, self.around, self.sets, before
            ),
            PROPOSALS,
        )

    def _explore(self, radius: float, turn: float) -> None:
        self._trace(
            self._open_places(),
            lambda chunk: exploring_rays(
                chunk, radius, turn, self.cone, self.frames, self.sets, self.grasps
            ),
            PROPOSALS,
        )

    def _refine(self, vertices: Ints, radii: Floats, turn: float) -> None:
        self._trace(
            vertices,
            lambda chunk: refining_rays(
                chunk, radii, turn, self.cone, self.frames, self.sets, self.grasps
            ),
            PROPOSALS,
        )

    def _open_places(self) -> Ints:
        """Places whose grasp is not yet as good as a grasp can be, to the tolerance."""
        smooth = self.mesh.normal_sets.counts[self.vertices] == 1
        bound = np.where(smooth, self.grasps.worst[self.vertices], math.inf)
        return self.vertices[bound > self.sampling.tolerance]

    def _trace(
        self,
        vertices: Ints,
        lay: Callable[[Ints], Rays],
        rays_per_place: int,
        progress: tuple[float, float] | None = None,
    ) -> None:
        """Lay out and settle the rays of all vertices, chunk by chunk in the threads."""
        evenly = -(-len(vertices) // (4 * self.threads))  # so that no thread waits for another
        size = max(1, min(CHUNK // rays_per_place, evenly))
        chunks = [vertices[i : i + size] for i in range(0, len(vertices), size)]

        def settle(chunk: Ints) -> int:
            return self.tracer.settle_all(lay(chunk), self.limits, self.grasps)

        for done, traced in enumerate(self.pool.map(settle, chunks), start=1):
            self.traced += traced
            if progress is not None:
                start, share = progress
                self.progress(start + share * done / len(chunks))

    def _result(self, rounds: int, still_falling: float) -> AntipodalGrasps:
        canonical = self.mesh.canonical
        return AntipodalGrasps(
            worst=self.grasps.worst[canonical],
            best=self.grasps.best[canonical],
            partner=self.mesh.from_normalized(self.grasps.partner[canonical]),
            partner_normal=self.grasps.partner_normal[canonical],
            partner_points=SurfacePoints(
                self.grasps.faces[canonical], self.grasps.weights[canonical]
            ),
            grip=self.grasps.signs[canonical],
            reason=self.grasps.reason[canonical],
            rays=self.traced,
            rounds=rounds,
            still_falling=still_falling,
        )
