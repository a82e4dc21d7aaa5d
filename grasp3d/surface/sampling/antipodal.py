"""The best antipodal grasp through every vertex.

Fingers that squeeze: branch and bound over the whole surface, exact on each face, or from the best
of a few rays where fingers may expand too or openings are limited from below.
Fingers that expand: rays from a vertex find the surface points opposite to it, since what lies
between is in the way. The critical friction angle of each pair of contacts is exact, so a search
may miss a grasp, but every grasp that it returns is real. What rays began is then refined: by ever
narrower rings of rays about the closing directions, and by rays to the opposing contacts of
neighbouring vertices.
"""

import math
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import cached_property, partial
from itertools import pairwise
from typing import Any

import numpy as np

from grasp3d._kernels.search.antipodal_candidates import FOUND, PairLimits, no_pairs
from grasp3d._kernels.search.crease_contacts import bound_creases, faces_of_corners
from grasp3d._kernels.search.descent import descend, descend_exactly
from grasp3d._kernels.search.face_contacts import PairDomain
from grasp3d._kernels.search.rays import (
    RAYS_PER_ROUND,
    SMALLEST_OPENING,
    Origins,
    Rays,
    exploring_rays,
    neighbour_rays,
    refining_rays,
    seed_rays,
)
from grasp3d.arrays import Bools, Bytes, Floats, Ints
from grasp3d.hand.reach import Reach
from grasp3d.hand.scene import Scene
from grasp3d.mesh import ObjectMesh
from grasp3d.mesh.surface_points import SurfacePoints
from grasp3d.settings import Sampling
from grasp3d.surface.sampling.reachable import ReachSearch
from grasp3d.surface.sampling.surface_rays import SurfaceRays
from grasp3d.surface.sampling.vertices import contact_tree, neighbours, tangents
from grasp3d.system.context import report_progress, thread_count

OPENING_SLACK = 1e-6
"""Tolerance of the limits of openings, in object sizes: larger than rounding errors of files."""


def pair_limits(mesh: ObjectMesh, sampling: Sampling) -> PairLimits:
    """Limits of pairs of contacts in the normalised frame, openings with a tolerance for rounding.

    Args:
        mesh: The surface.
        sampling: Limits of openings.
    """
    return PairLimits(
        max(sampling.min_opening / mesh.size - OPENING_SLACK, SMALLEST_OPENING),
        sampling.max_opening / mesh.size + OPENING_SLACK,
    )


CHUNK = 100_000
"""Rays that a thread traces at once: bounds the memory and fits into the processor's cache."""

DESCENDING = 1000
"""Vertices for which a thread runs branch and bound at once, so that progress is reported and a
search can be cancelled."""

IN_ORDER = 128
"""Vertices for which it finds the exact best contacts one after the other; the first one starts
without a neighbour's contact. Independent of the threads, as the results depend on it."""

INSIDE_FACES = np.empty(0, dtype=np.int64)
"""In place of the faces with which corners are searched: contacts are inside faces."""

CHUNKS = 4
"""Chunks per thread, which balance the load."""

SEED_BATCHES = (0.0, 0.125, 0.375, 1.0)
"""Fractions of the initial directions at which batches begin: the more grasps are known, the fewer
of the following directions need a ray."""

FEW = 16
"""Divisor of the number of rays before branch and bound, which needs an upper bound only."""

GAIN, GAIN_BEST = math.radians(0.25), math.radians(1.0)
"""Decrease of the critical angle over the worst normals, and over the best ones, from which branch
and bound replaces a grasp; refinement finds smaller ones."""

NEAR_LIMIT, NEAR_ROUNDS = 0.8, 6
"""Openings from which grasps are refined before branch and bound, relative to the largest one, and
the rounds of it: where only that limit keeps a contact from a better position, as on a ball, very
many contacts are about equally good, and branch and bound is slow unless it starts from one."""

STARTS = 3
"""Clearly different grasps per vertex that are cached and refined."""

EXPLORING_ROUNDS = 3
"""Rounds in which all cached grasps are refined, before the best one alone is, where grasps were
found by rays only."""

FIRST_RING, FOUND_RING = 0.5, 0.125
"""Radii of the first rings about the best grasp, relative to the spacing of the rays: where rays
found it, and where branch and bound did."""

SWEEPS, FOUND_SWEEPS = 3, 2
"""Rounds in which the neighbours' opposing contacts are evaluated and improved grasps refined:
where rays found the grasps, and where branch and bound did."""

MAX_ROUNDS = 30
"""Most rounds of refinement in one sweep; rings shrink to the tolerance in fewer."""

MIN_GAIN = 0.1
"""Decrease of a critical angle, relative to the tolerance, from which its ring keeps its size."""


@dataclass(frozen=True, eq=False)
class AntipodalGrasps:
    """The best antipodal grasp found at each vertex, in the mesh's frame."""

    worst: Floats
    """Critical friction angle over the contacts' worst normals [rad], inf: none found. (V,)"""
    best: Floats
    """The smallest over the contacts' best normals, possibly of another grasp. (V,)"""
    partner: Floats
    """Second contact of the grasp of `worst`, nan where there is none. (V, 3)"""
    partner_points: SurfacePoints
    """Second contacts of the grasps of `worst` and of `best`. (V, 2)"""
    grip: np.ndarray[Any, np.dtype[np.int8]]
    """+1 squeeze, -1 expand, 0 none. (V,)"""
    reason: Bytes
    """0 found, 1 no opposing contact, 2 all contacts outside the limits of openings, 5 no contact
    reached by the gripper. (V,)"""
    rays: int
    """Number of rays traced."""
    evaluated: int
    """Number of faces on which a contact was computed exactly."""
    reach: Reach | None = None
    """With a gripper: how it reaches each grasp, or why not the best where reason is 5. (V,)"""


def best_pairs(
    mesh: ObjectMesh,
    sampling: Sampling,
    cone: float,
    *,
    scene: Scene | None = None,
) -> AntipodalGrasps:
    """Search for the best antipodal grasp through every vertex of the surface.

    The best grasp has the smallest critical friction angle. The result does not depend on the
    number of threads.

    Args:
        mesh: The surface.
        sampling: Rays, grip, opening limits and tolerance.
        cone: Half-angle of the cone of directions about the inward normals [rad].
        scene: The gripper that must reach the grasps; None: ideal points.
    """
    with ThreadPoolExecutor(thread_count()) as executor:
        return _Search(mesh, sampling, cone, executor, scene).run()


@dataclass(eq=False)
class _Search:
    """State of one search over all vertices of a mesh, in its normalised frame."""

    mesh: ObjectMesh
    sampling: Sampling
    cone: float
    executor: ThreadPoolExecutor
    scene: Scene | None = None
    traced: int = field(default=0, init=False)
    evaluated: int = field(default=0, init=False)
    reach: Reach | None = field(default=None, init=False)

    def __post_init__(self) -> None:
        mesh = self.mesh
        self.spacing = math.sqrt(2.0 * math.pi * (1.0 - math.cos(self.cone)) / self.sampling.rays)
        self.vertices = mesh.contact_vertices.copy()  # kernels are compiled for such arrays
        self.limits = pair_limits(mesh, self.sampling)
        self.sets = mesh.contact_normals
        self.surface = mesh.contact_surface
        self.origins = Origins(
            self.surface.points, self.sets, mesh.normal_centres, tangents(mesh), mesh.normal_radii,
            neighbours(mesh), self.cone,
        )  # fmt: skip
        self.grasps = no_pairs(len(mesh.vertices), STARTS, math.cos(self.spacing))

    @cached_property
    def tracer(self) -> SurfaceRays:
        """Rays through the surface, made where they are needed, in the thread of the search."""
        return SurfaceRays(self.surface, self.sets, self.mesh.contact_faces)

    @cached_property
    def domain(self) -> PairDomain:
        """Where contacts may be; `_run_exactly` ends with a tree over its creases and corners."""
        tree = contact_tree(self.mesh)
        return PairDomain(self.surface, self.sets, self.origins.centres, tree, self.limits)

    def run(self) -> AntipodalGrasps:
        """Find grasps over the whole surface, refine them, and try those of neighbours."""
        squeezing, by_rays = self.sampling.grip != "expand", self.sampling.grip != "squeeze"
        if self._is_exact():
            return self._run_exactly()
        if by_rays:
            self._seed(self.vertices, self.sampling.rays, -1, (0.0, 0.4))
            for number in range(EXPLORING_ROUNDS):
                radius, turn = self.spacing / 2.0 ** (number + 1), 0.5 * (number % 2)
                self._trace(self._unfinished(), exploring_rays, radius=radius, turn=turn)
        if squeezing:
            self._seed(self.vertices, max(self.sampling.rays // FEW, 1), 1, (0.4, 0.45))
            self._refine_near_limit()
            self._descend()
            missing = self.vertices[self.grasps.reason[self.vertices] != FOUND]
            self._seed(missing, self.sampling.rays, 1, (0.85, 0.85))  # why there is no grasp
        ring, sweeps = (FIRST_RING, SWEEPS) if by_rays else (FOUND_RING, FOUND_SWEEPS)
        radii = np.full(len(self.mesh.vertices), ring * self.spacing)
        for sweep in range(sweeps):
            improved = self._improved(self._try_neighbours)
            if sweep:
                radii[improved] = 0.25 * self.spacing
            self._refine_all(radii)
            report_progress(0.85 + 0.15 * (sweep + 1) / sweeps)
        self._keep_reached(squeeze=squeezing)
        return self._result()

    def _is_exact(self) -> bool:
        """Whether the best contacts are found on the faces themselves, without rays.

        For fingers that squeeze, where no opening is too small.
        """
        return self.sampling.grip == "squeeze" and self.limits.smallest == SMALLEST_OPENING

    def _run_exactly(self) -> AntipodalGrasps:
        """Find the contact with the smallest critical angle of every vertex, or why it has none."""
        # In the order of the tree, neighbours follow one another.
        used, first = np.unique(self.surface.faces[self.domain.tree.order], return_index=True)
        place = np.full(len(self.mesh.vertices), len(self.surface.faces) * 3)
        place[used] = first
        ordered = self.vertices[np.argsort(place[self.vertices], kind="stable")]
        self._descend_exactly(ordered, self.cone, (0.0, 0.6))
        useless = ordered[self.grasps.worst[ordered] >= self.cone]
        if self.limits.largest < math.inf:  # is anything opposite within the largest opening?
            self._seed(useless, self.sampling.rays, 1, (0.6, 0.65))
            useless = useless[self.grasps.reason[useless] == FOUND]
        self._descend_exactly(useless, math.pi / 2.0, (0.65, 0.75))
        # The best normals are others at creases: at those of the vertices, with contacts inside
        # faces, and at those of the surface, with all vertices.
        several = ordered[self.sets.counts[ordered] != 1]
        if len(several):
            self._descend_exactly(several, self.cone, (0.75, 0.85), worst=False)
            faces = self.mesh.contact_faces
            part = self.surface._replace(faces=self.surface.faces[faces])
            owners = faces_of_corners(part, self.sets)
            owners = np.where(owners < 0, -1, faces[owners])
            bound_creases(self.domain.tree, owners, self.surface, self.sets)
            self._descend_exactly(ordered, self.cone, (0.85, 0.95), worst=False, owners=owners)
        self._keep_reached(squeeze=True)
        report_progress(1.0)
        return self._result()

    def _descend_exactly(
        self,
        vertices: Ints,
        cone: float,
        progress: tuple[float, float],
        *,
        worst: bool = True,
        owners: Ints = INSIDE_FACES,
    ) -> None:
        """Minimise the critical angles of vertices in the order of the tree; see the kernel."""
        search = partial(
            descend_exactly, worst=worst, owners=owners, cone=cone, domain=self.domain,
            grasps=self.grasps,
        )  # fmt: skip
        self.evaluated += sum(self._in_chunks(search, vertices, IN_ORDER, progress))

    def _keep_reached(self, *, squeeze: bool) -> None:
        """With a gripper: replace the grasps by the best ones that it reaches."""
        if self.scene is None:
            return
        reach = ReachSearch(self.mesh, self.scene, self.cone, self.limits, self.executor)
        ideal = self.grasps
        self.grasps = reach.run(ideal, self.tracer, self.origins, squeeze=squeeze)
        self.reach = reach.reach_of(ideal, self.grasps, self.tracer)

    def _descend(self) -> None:
        """Search the whole surface by branch and bound; at creases for the best normals too."""
        vertices = self._unfinished()
        creases = vertices[self.sets.counts[vertices] != 1]
        search = partial(descend, cone=self.cone, domain=self.domain, grasps=self.grasps)
        for_worst = partial(search, worst=True, gain=GAIN)
        self._in_chunks(for_worst, vertices, self._even(vertices, DESCENDING), (0.45, 0.65))
        for_best = partial(search, worst=False, gain=GAIN_BEST)
        self._in_chunks(for_best, creases, self._even(creases, DESCENDING), (0.65, 0.85))

    def _refine_near_limit(self) -> None:
        """Refine grasps whose openings are near the largest one."""
        openings = np.linalg.norm(self.grasps.partner - self.surface.points, axis=1)
        near = openings > NEAR_LIMIT * self.limits.largest
        self._refine_all(np.where(near, FIRST_RING * self.spacing, 0.0), NEAR_ROUNDS)

    def _refine_all(self, radii: Floats, most: int = MAX_ROUNDS) -> None:
        """Refine the best grasps, halving the rings without improvement."""
        for number in range(most):
            vertices = self._unfinished()
            vertices = vertices[
                (radii[vertices] > self.sampling.tolerance)
                & (self.grasps.reason[vertices] == FOUND)
            ]
            if len(vertices) == 0:
                return
            turn = 0.5 * (number % 2)
            improved = self._improved(
                partial(self._trace, vertices, refining_rays, radii=radii, turn=turn)
            )
            radii[vertices[~improved[vertices]]] *= 0.5

    def _improved(self, improve: Callable[[], None]) -> Bools:
        """Whether `improve` lowers each vertex's critical angle by more than rounding, (V,)."""
        worst, best = self.grasps.worst.copy(), self.grasps.best.copy()
        improve()
        margin = MIN_GAIN * self.sampling.tolerance
        return (self.grasps.worst < worst - margin) | (self.grasps.best < best - margin)

    def _seed(self, vertices: Ints, count: int, sign: int, progress: tuple[float, float]) -> None:
        """Trace directions spread over the cone; those near the normal first, as they exclude some.

        Args:
            vertices: Vertices (n,).
            count: Directions per vertex.
            sign: +1 squeeze, -1 expand.
            progress: Fractions of the work done before and after.
        """
        ends = [round(count * fraction) for fraction in SEED_BATCHES]
        batches = [batch for batch in pairwise(ends) if batch[1] > batch[0]]
        parts = pairwise(np.linspace(*progress, len(batches) + 1).tolist())
        for batch, part in zip(batches, parts, strict=True):
            self._trace(
                vertices, seed_rays, batch[1] - batch[0], part,
                rays=count, batch=batch, sign=sign,
            )  # fmt: skip

    def _try_neighbours(self) -> None:
        """Evaluate the opposing contacts that the neighbours had at the beginning of the round."""
        before = self.grasps._replace(
            signs=self.grasps.signs.copy(),
            partner=self.grasps.partner.copy(),
            reason=self.grasps.reason.copy(),
        )
        self._trace(self._unfinished(), neighbour_rays, grasps=before)

    def _unfinished(self) -> Ints:
        """Vertices whose critical angle is not within the tolerance of 0, its minimum."""
        smooth = self.mesh.contact_normals.counts[self.vertices] == 1
        bound = np.where(smooth, self.grasps.worst[self.vertices], math.inf)
        return self.vertices[bound > self.sampling.tolerance]

    def _trace(
        self,
        vertices: Ints,
        make_rays: Callable[..., Rays],
        rays_per_vertex: int = RAYS_PER_ROUND,
        progress: tuple[float, float] | None = None,
        **settings: Any,
    ) -> None:
        """Make and trace the rays of vertices: those of a kernel with these settings."""
        if len(vertices) == 0:
            return
        tracer, settings = self.tracer, {"grasps": self.grasps, **settings}

        def evaluate(chunk: Ints) -> int:
            rays = make_rays(chunk, origins=self.origins, **settings)
            return tracer.evaluate_all(rays, self.limits, self.grasps)

        size = self._even(vertices, CHUNK // rays_per_vertex)
        self.traced += sum(self._in_chunks(evaluate, vertices, size, progress))

    def _even(self, vertices: Ints, most: int) -> int:
        """Size of chunks, at most so large, that balance the load of the threads."""
        return max(1, min(most, -(-len(vertices) // (CHUNKS * thread_count()))))

    def _in_chunks(
        self,
        work: Callable[[Ints], Any],
        vertices: Ints,
        size: int,
        progress: tuple[float, float] | None,
    ) -> list[Any]:
        """What work on chunks of vertices returns, in the threads; a search can be cancelled."""
        chunks, results = [vertices[i : i + size] for i in range(0, len(vertices), size)], []
        for result in self.executor.map(work, chunks):
            results.append(result)
            if progress is not None:
                first, last = progress
                report_progress(first + (last - first) * len(results) / len(chunks))
        return results

    def _result(self) -> AntipodalGrasps:
        canonical, grasps = self.mesh.canonical, self.grasps
        return AntipodalGrasps(
            worst=grasps.worst[canonical],
            best=grasps.best[canonical],
            partner=self.mesh.from_normalized(grasps.partner[canonical]),
            partner_points=SurfacePoints(grasps.faces[canonical], grasps.weights[canonical]),
            grip=grasps.signs[canonical],
            reason=grasps.reason[canonical],
            rays=self.traced,
            evaluated=self.evaluated,
            reach=None if self.reach is None else self.reach.take(canonical),
        )
