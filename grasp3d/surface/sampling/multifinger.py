"""The best grasp of three fingers and more through every vertex.

Finger 1 stands at the vertex. The others are tried at all pairs of points of a well-spread sample,
and at the vertex's best partner of two fingers; the best grasps found are refined by moving their
fingers about, and shared with the neighbours. Each further finger is added to the best grasp with
one less. A candidate is settled by one closure test at the best angle so far, so the search can
only miss a grasp, never make one up.
"""

import math
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace

import numpy as np

from grasp3d._kernels.antipodal_candidates import FOUND, NO_PARTNER
from grasp3d._kernels.multifinger import Hands, make_bench, make_hands, work_on_hands
from grasp3d._kernels.multifinger_contacts import Pool, Rules
from grasp3d.arrays import Bytes, Ints
from grasp3d.errors import SettingError
from grasp3d.mesh import ObjectMesh
from grasp3d.mesh.surface_points import SurfacePoints
from grasp3d.settings import Sampling
from grasp3d.surface.contacts import SurfaceContacts, vertex_surface_points
from grasp3d.surface.sampling.antipodal import best_pairs
from grasp3d.surface.sampling.candidate_points import ground_of, surface_pool, vertex_pool
from grasp3d.system.progress import Progress, ignore, within

CHUNK = 256
"""Vertices searched at once by a thread."""

SEPARATION = 0.01
"""Smallest distance between contacts where none is asked for, in object sizes."""

LOOSE = 0.1
"""The same at most, as a share of the largest distance."""

APART = 1e-3
"""The same where 0 is asked for: nearer ones are one place; in sizes of the object or the hand."""

FEW = 4
"""Times as many vertices as candidates up to which all are tried, where fingers stand on them."""

DENSE, MOST_DENSE = 16, 4096
"""Times as many places as candidates are spread, up to so many: single fingers are tried there."""

MOST_SPREAD = 32_768
"""Places spread at most, so that a small hand reaches some from everywhere."""

ROUNDS = 80
"""Steps of the refinement from each start."""

SHARED_ROUNDS = 40
"""Steps after a neighbour's grasp was taken over."""

SWEEPS = 3
"""How often the neighbours' grasps are tried."""

FALL = 0.1
"""Share of the tolerance by which a critical angle must fall to count."""

SHORTEST = 0.05
"""Steps end the search when they turn a normal on a ball of the object's size by less than this
share of the tolerance."""


@dataclass(frozen=True, eq=False)
class Found:
    """The best grasps found at each vertex."""

    partner_points: SurfacePoints
    """The other fingers of the best grasp over the worst normals, and of that over the best, shape
    (V, 2, n - 1); face -1: none."""
    reason: Bytes
    """0 found, 1 nothing closes that keeps the distances. (V,)"""
    settled: int
    """Candidate grasps settled."""
    rounds: int
    """How often the neighbours' grasps were tried."""
    still_falling: float
    """Share of the vertices that the last trial of the neighbours' grasps still improved."""


def search(
    mesh: ObjectMesh,
    fingers: int,
    sampling: Sampling,
    cone: float,
    *,
    threads: int = 1,
    progress: Progress | None = None,
) -> Found:
    """Search the best grasp of three fingers and more through every vertex.

    The result does not depend on the number of threads.

    Args:
        mesh: The surface.
        fingers: Fingers of a grasp, 3 or more.
        sampling: Candidates, distances, places, seed and tolerance.
        cone: Largest critical friction angle that counts, at most 90 degrees [rad].
        threads: Threads to use.
        progress: Called with the share of the work done, from 0 to 1.

    Raises:
        SettingError: The mesh has fewer places than fingers.
    """
    with ThreadPoolExecutor(threads) as pool:
        return _Search(mesh, fingers, sampling, cone, threads, pool, progress or ignore).run()


@dataclass(eq=False)
class _Search:
    """The state of one search, in the normalised frame scaled to what a hand reaches."""

    mesh: ObjectMesh
    fingers: int
    sampling: Sampling
    cone: float
    threads: int
    pool: ThreadPoolExecutor
    progress: Progress
    settled: int = field(default=0, init=False)

    def __post_init__(self) -> None:
        mesh, sampling = self.mesh, self.sampling
        given = sampling.min_separation
        if given is None:
            given = min(SEPARATION * mesh.size, LOOSE * sampling.max_spread)
        if given > mesh.size:
            raise SettingError(
                f"min_separation is {given:g}, but no two places of the object, of size "
                f"{mesh.size:.4g}, are so far apart"
            )
        self.least = given
        self.on_vertices = sampling.candidate_points == "vertices"
        self.vertices = np.unique(mesh.faces)
        if self.on_vertices and len(self.vertices) < self.fingers:
            raise SettingError(
                f"{self.fingers} fingers need as many vertices; the mesh has {len(self.vertices)}"
            )
        few = self.on_vertices and len(self.vertices) <= FEW * sampling.candidates
        self.candidates = len(self.vertices) if few else sampling.candidates
        self.scale = 1.0 / min(1.0, sampling.max_spread / mesh.size)
        self.ground = ground_of(mesh, self.scale, on_vertices=self.on_vertices)
        self.sites, self.own = self._sites()
        edges = self.ground.surface.points[mesh.faces]
        self.edge = float(np.linalg.norm(edges - np.roll(edges, 1, axis=1), axis=2).mean())
        self.step = math.sqrt(float(self.mesh.vertex_areas.sum()) / self.sampling.candidates)
        self.step *= 0.5 * self.scale / mesh.size

    def run(self) -> Found:
        """Seed three fingers, refine, share, and add the others."""
        creased = self.vertices[np.diff(self.ground.first)[self.vertices] > 1]
        helped = self.vertices if self.on_vertices and len(creased) else creased
        kinds = [(self.vertices, False), (helped, True)]
        work = sum(len(vertices) for vertices, _ in kinds)
        done, found, falling = 0.0, [], 0.0
        for vertices, helping in kinds:
            share = len(vertices) / work
            hands, fell = self._search(vertices, helping=helping, begun=done, share=share)
            found.append(hands)
            falling = falling if helping else fell
            done += share
        worst, best = found
        missing = np.isinf(best.angles)
        for of_best, of_worst in zip(best[1:], worst[1:], strict=True):
            of_best[missing] = of_worst[missing]
        return self._result(worst, best, falling)

    def _search(
        self, vertices: Ints, *, helping: bool, begun: float, share: float
    ) -> tuple[Hands, float]:
        """(grasps, share that still fell) over the worst or the best normals of some vertices."""
        rules = self._rules(helping=helping)
        stages, falling = (self.fingers - 2) * (1 + SWEEPS), 0.0
        hands = make_hands(len(self.mesh.vertices), 1)
        for n in range(3, self.fingers + 1):
            before, hands = hands, make_hands(len(self.mesh.vertices), n - 1)
            for stage in range(1 + SWEEPS):
                if stage:
                    before = Hands(hands.angles.copy(), hands.numbers.copy(), hands.weights.copy())
                told = within(self.progress, begun, begun + share / stages)
                self._run(stage, vertices, n, rules, before, hands, told)
                begun += share / stages
            fell = hands.angles[vertices] < before.angles[vertices] - rules.margin
            falling = float(fell.mean()) if len(vertices) else 0.0
        return hands, falling

    def _run(
        self,
        stage: int,
        vertices: Ints,
        n: int,
        rules: Rules,
        before: Hands,
        hands: Hands,
        progress: Progress,
    ) -> None:
        """Do one stage of the search for vertices, chunk by chunk in the threads."""
        size = max(1, min(CHUNK, -(-len(vertices) // (4 * self.threads))))
        chunks = [vertices[i : i + size] for i in range(0, len(vertices), size)]
        step, rounds = self.step / 2.0**stage, SHARED_ROUNDS if stage else ROUNDS
        ground = self.ground if n == 3 else self.ground._replace(most=1)

        most = max(1, int(np.diff(self.ground.first).max()))

        def settle(chunk: Ints) -> int:
            bench = make_bench(self.fingers, most, self.sites.spread)
            work_on_hands(
                stage, chunk, self.own, n, ground, self.sites, rules, int(self.sampling.seed), step,
                rounds, before, hands, bench,
            )  # fmt: skip
            return int(bench.settled[0])

        for done, settled in enumerate(self.pool.map(settle, chunks), start=1):
            self.settled += settled
            progress(done / len(chunks))

    def _rules(self, *, helping: bool) -> Rules:
        sampling, unit = self.sampling, self.scale / self.mesh.size
        return Rules(
            low=max(self.least * unit, APART),
            high=sampling.max_spread * unit if math.isfinite(sampling.max_spread) else math.inf,
            limit=self.cone,
            tolerance=FALL * sampling.tolerance,
            margin=FALL * sampling.tolerance,
            enough=sampling.tolerance,
            candidates=self.candidates,
            edge=self.edge,
            shortest=SHORTEST * sampling.tolerance * self.scale,
            helping=helping,
        )

    def _sites(self) -> tuple[Pool, Ints]:
        """Places for the other fingers, and which of them each vertex tries first."""
        count = max(self.candidates, min(DENSE * self.candidates, MOST_DENSE))
        count = max(count, min(math.ceil(self.candidates * self.scale**2), MOST_SPREAD))
        if self.on_vertices:
            return vertex_pool(self.mesh, count, self.sampling.seed, self.scale)
        return surface_pool(
            self.mesh, count, self.sampling.seed, self.scale, extra=self._partners()
        )

    def _partners(self) -> tuple[SurfacePoints, Ints]:
        """(places, vertices): smooth second contacts of the best grasps of two fingers."""
        sampling, mesh = self.sampling, self.mesh
        pairs = best_pairs(
            mesh,
            replace(
                sampling,
                grip="both",
                min_opening=self.least,
                max_opening=sampling.max_spread,
            ),
            self.cone,
            threads=self.threads,
        )
        faces, weights = (
            pairs.partner_points.faces[self.vertices, 0],
            pairs.partner_points.weights[self.vertices, 0],
        )
        held = np.flatnonzero(faces >= 0)
        points = SurfacePoints(faces[held], weights[held])
        single = SurfaceContacts(mesh, SurfacePoints(faces[held, None], weights[held, None]))
        smooth = ~single.on_crease[:, 0]
        return (
            SurfacePoints(points.faces[smooth], points.weights[smooth]),
            self.vertices[held[smooth]],
        )

    def _result(self, worst: Hands, best: Hands, still_falling: float) -> Found:
        numbers = np.stack([worst.numbers, best.numbers], axis=1)
        weights = np.stack([worst.weights, best.weights], axis=1)
        if self.on_vertices:
            there = numbers >= 0
            points = vertex_surface_points(self.mesh, np.maximum(numbers, 0))
            faces = np.where(there, points.faces, -1)
            weights = np.where(there[..., None], points.weights, 0.0)
        else:
            faces = numbers
        canonical = self.mesh.canonical
        nothing = np.isinf(worst.angles) & np.isinf(best.angles)
        return Found(
            partner_points=SurfacePoints(faces[canonical], weights[canonical]),
            reason=np.where(nothing, NO_PARTNER, FOUND).astype(np.uint8)[canonical],
            settled=self.settled,
            rounds=SWEEPS * (self.fingers - 2),
            still_falling=still_falling,
        )
