"""Search for the best antipodal grasp through every vertex.

For fingers that squeeze, branch and bound covers the whole surface. For fingers that expand, rays
from a vertex find the opposite surface points, as anything between would be in the way. The
critical friction angle of each pair of contacts is exact, so rays may miss a grasp, but every grasp
that they find is real. The grasps found are refined by ever narrower rings of rays about the
closing directions, and by rays to the opposing contacts of neighbouring vertices.
"""

import math
from abc import ABC, abstractmethod
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from itertools import pairwise
from typing import Any, ClassVar

import numpy as np

from grasp3d._kernels.search.antipodal_candidates import (
    FOUND,
    NO_PARTNER,
    OPENING,
    SMALLEST_OPENING,
    TIE,
    BestPairs,
    PairLimits,
    no_pairs,
)
from grasp3d._kernels.search.descent import descend
from grasp3d._kernels.search.face_contacts import PairDomain
from grasp3d._kernels.search.rays import (
    RAYS_PER_ROUND,
    Origins,
    Rays,
    evaluate_crossings,
    exploring_rays,
    neighbour_rays,
    refining_rays,
    seed_rays,
    write_rays,
)
from grasp3d._kernels.surface.surface_contacts import ContactNormals, Surface
from grasp3d.arrays import Bools, Bytes, Floats, Ints, chosen_rows
from grasp3d.hand.reach import Reach
from grasp3d.hand.scene import Scene
from grasp3d.mesh import ObjectMesh
from grasp3d.mesh.surface_points import FaceRays, Singles, SurfacePoints
from grasp3d.mesh.turns import located_surface
from grasp3d.settings import Sampling
from grasp3d.settings.sampling import Grip
from grasp3d.surface.candidate_points import contact_tree, neighbours, places_in_tree, tangents
from grasp3d.surface.reachable import NOT_REACHED, ReachSearch
from grasp3d.system.context import report_progress, thread_count, within

BESIDE = 1e-5
"""Distance from a vertex, in object sizes, within which a face counts as around it."""


class SurfaceRays(FaceRays):
    """Traces rays away from vertices and evaluates the grasps where they meet the surface.

    Args:
        surface: The surface.
        sets: The normals of its vertices.
        allowed: Faces where opposing contacts may be.
    """

    def __init__(self, surface: Surface, sets: ContactNormals, allowed: Ints) -> None:
        super().__init__(surface.points, surface.faces)
        self._surface = surface
        self._sets = sets
        self._excluded = np.append(~np.isin(np.arange(len(surface.faces)), allowed), False)

    def evaluate_all(self, rays: Rays, limits: PairLimits, grasps: BestPairs) -> int:
        """Follow every ray to the surface and keep each vertex's best grasps.

        Args:
            rays: The rays; modified.
            limits: Openings in the normalised frame.
            grasps: The best grasps so far; modified.

        Returns:
            Number of rays traced, those continued at their vertex included.
        """
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

        An excluded face blocks the ray, unless it is at the vertex.
        """
        faces, far = self.hits(origins, directions)
        excluded, count = self._excluded[faces], len(faces)
        beside = excluded & (rays.along[:count] + far < BESIDE)  # the ray goes on
        rays.last[:count][beside] = faces[beside]
        return np.where(excluded & ~beside, np.int32(-1), faces), far


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


UNLIMITED = PairLimits(SMALLEST_OPENING, math.inf)

CHUNK = 100_000
"""Rays that a thread traces at once: bounds the memory and fits into the processor's cache."""

IN_ORDER = 128
"""Number of vertices for which a thread finds the exact best contacts in sequence; the first one
starts without a neighbour's contact. Fixed for any number of threads, as results depend on it."""

CHUNKS = 4
"""Chunks of rays per thread, which balance the load."""

SEED_BATCHES = (0.0, 0.125, 0.375, 1.0)
"""Fractions of the initial directions at which batches begin: known grasps rule out directions of
later batches."""

STARTS = 3
"""Clearly different grasps per vertex that are cached and refined."""

EXPLORING_ROUNDS = 3
"""Rounds in which all cached grasps are refined, before only the best one is."""

FIRST_RING = 0.5
"""Radius of the first ring about the best grasp, relative to the spacing of the rays."""

SWEEPS = 3
"""Rounds in which the neighbours' opposing contacts are evaluated and improved grasps refined."""

MAX_ROUNDS = 30
"""Largest number of refinement rounds in a sweep; rings shrink to the tolerance in fewer."""

MIN_GAIN = 0.1
"""Decrease of a critical angle, relative to the tolerance, from which its ring keeps its size."""

PREFERRED = (FOUND, NOT_REACHED, OPENING, NO_PARTNER)
"""Reasons, beginning with the one that says most about a vertex."""


@dataclass(frozen=True, eq=False)
class FoundGrasps:
    """The best grasp found at each vertex."""

    worst: Floats
    """Critical friction angle over the contacts' worst normals, and over the worst locations if the
    search considers these [rad], inf: none found. (V,)"""
    best: Floats
    """The same over the contacts' best normals at their perceived locations. (V,)"""
    partner_points: SurfacePoints
    """The other contacts, face -1 where there is none. (V, n - 1)"""
    grip: np.ndarray[Any, np.dtype[np.int8]]
    """+1 squeeze, -1 expand, 0 no grasp, or three fingers and more. (V,)"""
    reason: Bytes
    """0: found; 1: no opposing contact, or no force-closed grasp within the limits of distances; 2:
    all contacts outside the limits of openings; 5: no contact reached by the gripper. (V,)"""
    evaluated: int
    """Number of faces on which a contact was computed exactly, or of candidate grasps of three
    fingers and more."""
    rays: int = 0
    """Number of rays traced."""
    reach: Reach | None = None
    """How jaws reach each grasp or, if the reason is 5, why they do not reach the best one. (V,)"""


def best_pairs(
    mesh: ObjectMesh,
    sampling: Sampling,
    cone: float,
    *,
    scene: Scene | None = None,
    location_error: float = 0.0,
) -> FoundGrasps:
    """Search for the best antipodal grasp through every vertex of the surface.

    The best grasp has the smallest critical friction angle over the worst normals. The result does
    not depend on the number of threads.

    Args:
        mesh: The surface.
        sampling: Rays, grip, opening limits and tolerance.
        cone: Half-angle of the cone of directions about the inward normals [rad].
        scene: The hand, whose stroke limits the openings; jaws must reach the grasps. None: ideal
            points.
        location_error: Largest distance between true and perceived contacts [m]; the best grasp has
            the smallest critical angle over these locations too.
    """
    surface = located_surface(mesh, location_error, cone)
    kinds: dict[str, tuple[type[_Search], ...]] = {
        "squeeze": (_Squeezing,), "expand": (_Expanding,), "both": (_Squeezing, _Expanding)
    }  # fmt: skip
    searches, found = kinds[sampling.grip], []
    with ThreadPoolExecutor(thread_count()) as executor:
        for number, kind in enumerate(searches):
            with within(number / len(searches), (number + 1) / len(searches)):
                found.append(kind(mesh, surface, sampling, cone, executor, scene).run())
                report_progress(1.0)
    return found[0] if len(found) == 1 else _better(*found)


def _better(one: FoundGrasps, other: FoundGrasps) -> FoundGrasps:
    """Choose the better of two grasps at each vertex, or else the reason that says more."""
    place = np.zeros(max(PREFERRED) + 1)
    place[list(PREFERRED)] = range(len(PREFERRED))
    first, second = place[one.reason], place[other.reason]
    better = (second < first) | ((second == first) & (other.worst < one.worst - TIE))
    grasps: FoundGrasps = chosen_rows(better, other, one)
    return replace(grasps, rays=one.rays + other.rays, evaluated=one.evaluated + other.evaluated)


@dataclass(eq=False)
class _Search(ABC):
    """State of one search over all vertices of a mesh, in its normalised frame."""

    mesh: ObjectMesh
    surface: Surface
    sampling: Sampling
    cone: float
    executor: ThreadPoolExecutor
    scene: Scene | None
    rays: int = field(default=0, init=False)
    evaluated: int = field(default=0, init=False)

    sign: ClassVar[int]
    """+1 fingers squeeze, -1 they expand."""
    grip: ClassVar[Grip]

    def __post_init__(self) -> None:
        self.vertices = self.mesh.contact_vertices.copy()  # kernels take writable arrays
        own = replace(self.sampling, grip=self.grip)
        if self.scene is not None:
            own = self.scene.within_stroke(self.mesh, own)
        self.limits = pair_limits(self.mesh, own)
        self.sets = self.mesh.contact_normals
        self.located = self.surface.turns.error > 0.0
        self.grasps = no_pairs(len(self.mesh.vertices))

    @cached_property
    def domain(self) -> PairDomain:
        """Domain in which opposing contacts are searched for."""
        tree = contact_tree(self.mesh, self.surface)
        centres = self.mesh.normal_centres
        return PairDomain(self.surface, self.sets, centres, tree, self.limits)

    @cached_property
    def places(self) -> Ints:
        """First position of each vertex in the order of the tree, shape (V,)."""
        return places_in_tree(len(self.mesh.vertices), self.surface, self.domain.tree)

    def run(self) -> FoundGrasps:
        """Find the best grasps; with a gripper, those that it reaches."""
        self._search()
        grasps, reach, canonical = self.grasps, None, self.mesh.canonical
        if self.scene is not None and self.scene.jaws is not None:
            cone = math.pi if self.located else self.cone
            search = ReachSearch(
                self.mesh, self.domain, self.places, self.scene, cone, self.executor
            )
            grasps, reached = search.run(self.grasps)
            reach = reached.take(canonical)
        reason = grasps.reason[canonical]
        return FoundGrasps(
            worst=grasps.worst[canonical],
            best=grasps.best[canonical],
            partner_points=SurfacePoints(
                grasps.faces[canonical, None], grasps.weights[canonical, None]
            ),
            grip=np.where(reason == FOUND, self.sign, 0).astype(np.int8),
            reason=reason,
            rays=self.rays,
            evaluated=self.evaluated,
            reach=reach,
        )

    @abstractmethod
    def _search(self) -> None:
        """Find the best grasps of ideal points."""

    def _in_chunks(
        self,
        work: Callable[[Ints], int],
        vertices: Ints,
        size: int,
        progress: tuple[float, float] | None,
    ) -> int:
        """Run work on chunks of vertices in threads, and add up its results; can be cancelled."""
        chunks, total = [vertices[i : i + size] for i in range(0, len(vertices), size)], 0
        for number, result in enumerate(self.executor.map(work, chunks), start=1):
            total += result
            if progress is not None:
                first, last = progress
                report_progress(first + (last - first) * number / len(chunks))
        return total


class _Squeezing(_Search):
    """Search by branch and bound for grasps of fingers that squeeze."""

    sign, grip = 1, "squeeze"

    def _search(self) -> None:
        """Find the contact with the smallest critical angle of every vertex, or why it has none."""
        domain = self.domain
        vertices = self.vertices[np.argsort(self.places[self.vertices], kind="stable")]
        self._descend(vertices, self.cone, domain, self.grasps, (0.0, 0.6))
        vertices = vertices[self.grasps.worst[vertices] >= self.cone]
        uncertain = vertices[:0]
        if self.located:
            # None is surely stable: find those that are best at their perceived locations.
            uncertain, domain = vertices, domain._replace(surface=self.mesh.contact_surface)
            self._descend(vertices, self.cone, domain, self.grasps, (0.6, 0.6))
            vertices = vertices[self.grasps.worst[vertices] >= self.cone]
        reason, anywhere = self.grasps.reason, no_pairs(len(self.mesh.vertices))
        unlimited, limited = domain._replace(limits=UNLIMITED), self.limits != UNLIMITED
        if limited:
            self._descend(vertices, self.cone, unlimited, anywhere, (0.6, 0.7))
            reason[vertices[anywhere.reason[vertices] == FOUND]] = OPENING
            # On a crease a grasp that is not good with all normals may be with some.
            smooth = self.sets.counts[vertices] == 1
            vertices = vertices[~smooth | (anywhere.worst[vertices] >= self.cone)]
        self._descend(vertices, math.pi / 2.0, domain, self.grasps, (0.7, 0.9))
        if limited:
            vertices = vertices[reason[vertices] == NO_PARTNER]
            self._descend(vertices, math.pi / 2.0, unlimited, anywhere, (0.9, 1.0))
            reason[vertices[anywhere.reason[vertices] == FOUND]] = OPENING
        self.grasps.worst[uncertain[reason[uncertain] == FOUND]] = math.pi

    def _descend(
        self,
        vertices: Ints,
        cone: float,
        domain: PairDomain,
        grasps: BestPairs,
        progress: tuple[float, float],
    ) -> None:
        """Minimise the critical angles of vertices in the order of the tree; see the kernel."""
        search = partial(descend, cone=cone, domain=domain, grasps=grasps)
        self.evaluated += self._in_chunks(search, vertices, IN_ORDER, progress)


class _Expanding(_Search):
    """Search by rays for grasps of fingers that expand."""

    sign, grip = -1, "expand"

    def __post_init__(self) -> None:
        super().__post_init__()
        mesh = self.mesh
        self.spacing = math.sqrt(2.0 * math.pi * (1.0 - math.cos(self.cone)) / self.sampling.rays)
        self.origins = Origins(
            self.surface.points, self.sets, mesh.normal_centres, tangents(mesh), mesh.normal_radii,
            neighbours(mesh), self.cone,
        )  # fmt: skip
        self.grasps = no_pairs(len(mesh.vertices), STARTS, math.cos(self.spacing))
        self.tracer = SurfaceRays(self.surface, self.sets, mesh.contact_faces)

    def _search(self) -> None:
        """Find grasps over the whole surface, refine them, and try those of neighbours."""
        self._seed((0.0, 0.7))
        for number in range(EXPLORING_ROUNDS):
            radius, turn = self.spacing / 2.0 ** (number + 1), 0.5 * (number % 2)
            self._trace(self._unfinished(), exploring_rays, radius=radius, turn=turn)
        radii = np.full(len(self.mesh.vertices), FIRST_RING * self.spacing)
        for sweep in range(SWEEPS):
            improved = self._improved(self._try_neighbours)
            if sweep:
                radii[improved] = 0.25 * self.spacing
            self._refine_all(radii)
            report_progress(0.7 + 0.3 * (sweep + 1) / SWEEPS)

    def _refine_all(self, radii: Floats) -> None:
        """Refine the best grasps, halving the rings without improvement."""
        for number in range(MAX_ROUNDS):
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
        worst = self.grasps.worst.copy()
        improve()
        return np.asarray(self.grasps.worst < worst - MIN_GAIN * self.sampling.tolerance)

    def _seed(self, progress: tuple[float, float]) -> None:
        """Trace directions spread over the cone, first those near the normal, which exclude others.

        Args:
            progress: Fractions of the work done before and after.
        """
        count = self.sampling.rays
        ends = [round(count * fraction) for fraction in SEED_BATCHES]
        batches = [batch for batch in pairwise(ends) if batch[1] > batch[0]]
        parts = pairwise(np.linspace(*progress, len(batches) + 1).tolist())
        for batch, part in zip(batches, parts, strict=True):
            self._trace(
                self.vertices, seed_rays, batch[1] - batch[0], part, rays=count, batch=batch
            )

    def _try_neighbours(self) -> None:
        """Evaluate the opposing contacts that the neighbours had at the beginning of the round."""
        before = self.grasps._replace(
            partner=self.grasps.partner.copy(), reason=self.grasps.reason.copy()
        )
        self._trace(self._unfinished(), neighbour_rays, grasps=before)

    def _unfinished(self) -> Ints:
        """Vertices whose critical angle is not within the tolerance of 0, its minimum."""
        return self.vertices[self.grasps.worst[self.vertices] > self.sampling.tolerance]

    def _trace(
        self,
        vertices: Ints,
        make_rays: Callable[..., Rays],
        rays_per_vertex: int = RAYS_PER_ROUND,
        progress: tuple[float, float] | None = None,
        **settings: Any,
    ) -> None:
        """Make the rays of vertices with a kernel and its settings, and trace them."""
        settings = {"grasps": self.grasps, **settings}

        def evaluate(chunk: Ints) -> int:
            rays = make_rays(chunk, origins=self.origins, **settings)
            return self.tracer.evaluate_all(rays, self.limits, self.grasps)

        even = -(-len(vertices) // (CHUNKS * thread_count()))  # balances the load of the threads
        size = max(1, min(CHUNK // rays_per_vertex, even))
        self.rays += self._in_chunks(evaluate, vertices, size, progress)
