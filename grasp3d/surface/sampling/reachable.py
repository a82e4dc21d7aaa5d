"""The best antipodal grasp through every vertex that a gripper reaches.

The best grasps for ideal points are tested first. Where one is not reached, others come in the
order of their critical angles: clearly different ones that the same rays found, opposing contacts
from a search of the whole surface, and those that neighbouring vertices ended with.
"""

import math
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from grasp3d._kernels.jaws.gripper_parts import ReachResults, make_workspace, no_results
from grasp3d._kernels.search.antipodal_candidates import FOUND, BestPairs, PairLimits, no_pairs
from grasp3d._kernels.search.face_contacts import PairDomain
from grasp3d._kernels.search.rays import Origins, neighbour_rays, starting_rays
from grasp3d._kernels.search.reachable_partners import explain_pairs, keep_reached, search_reachable
from grasp3d.arrays import Bools, Floats, Ints
from grasp3d.hand.jaw_reach import NormalizedScene
from grasp3d.hand.reach import Reach, Reachability
from grasp3d.hand.scene import Scene
from grasp3d.mesh import ObjectMesh
from grasp3d.surface.sampling.surface_rays import SurfaceRays
from grasp3d.surface.sampling.vertices import contact_tree

NOT_REACHED = 5
"""Reason code: there are grasps, but none of those tested is reached."""

CHUNK = 128
"""Vertices that a thread tests at once."""

MOST_FAILED = 4
"""Opposing contacts of a vertex that are tested and not reached, before its search ends; good ones
of its neighbours are tested besides."""

SWEEPS = 2
"""Rounds in which the opposing contacts of neighbouring vertices are tested."""

ALIKE_GAINS, WAVES, MORE_FAILED = 1e-6, 6, 24
"""Gains that differ by less count as equal [rad]; how often the search goes on, first at some
vertices and then beside those where it found a better grasp; and as `MOST_FAILED`."""

STEP = math.radians(1.0)
"""Difference of angles that is worth another search, and from which it tests contacts near one that
is not reached [rad]."""

SPACING, LARGEST_SPACING = 0.5, 1.0 / 16.0
"""Distance from which opposing contacts differ: in widths of a finger, but at most in object
sizes."""


OF_WORST = ("worst", "closing", "partner", "partner_normal", "signs", "reason")
OF_BEST = ("best", "closing_best", "signs_best")
CACHED = ("starts", "start_angles", "start_signs")
"""Fields of `BestPairs` of the grasp of `worst`, of that of `best`, and of the cache."""


class Pairs(NamedTuple):
    """Grasps to test: a vertex and a point on a face each."""

    vertices: Ints
    """(n,)"""
    signs: npt.NDArray[np.int8]
    """+1 squeeze, -1 expand (n,)."""
    faces: Ints
    """Face of the opposing contact, -1: none (n,)."""
    weights: Floats
    """Its barycentric coordinates (n, 3)."""


@dataclass(eq=False)
class ReachSearch:
    """Search for the grasps of vertices that a gripper reaches, in the normalised frame."""

    mesh: ObjectMesh
    scene: Scene
    cone: float
    """Largest critical angle that is searched for [rad]."""
    limits: PairLimits
    """Openings."""
    executor: ThreadPoolExecutor

    def __post_init__(self) -> None:
        mesh, scene = self.mesh, self.scene
        self.surface, self.sets = mesh.contact_surface, mesh.contact_normals
        self.centres = mesh.normal_centres
        assert scene.jaws is not None
        self.beside = NormalizedScene.of(mesh, scene.jaws, scene.table, scene.approach)
        tree = contact_tree(mesh)
        self.domain = PairDomain(self.surface, self.sets, self.centres, tree, self.limits)
        self.results = no_results(len(mesh.vertices))
        self.spacing = min(SPACING * self.beside.shape.finger_width, LARGEST_SPACING)

    def run(
        self, ideal: BestPairs, tracer: SurfaceRays, origins: Origins, *, squeeze: bool
    ) -> BestPairs:
        """The best grasps that are reached; vertices with other grasps only are NOT_REACHED.

        Args:
            ideal: The best grasps for ideal points.
            tracer: Rays through the surface.
            origins: The vertices from which rays start.
            squeeze: Whether fingers may squeeze.
        """
        vertices = np.flatnonzero(ideal.reason == FOUND)
        reached = self._ideal(ideal, vertices)
        missing = _still_better(ideal, reached, vertices)
        if squeeze:
            self._search(missing, reached)
        if (ideal.start_signs < 0).any():
            for pairs in self._other_starts(ideal, missing, tracer):
                self._keep(pairs, reached)
        last = np.full(len(ideal.reason), np.inf)
        for number in range(SWEEPS + squeeze):
            if number == SWEEPS:
                self._search_on(ideal, missing, reached, origins.neighbours)
            changed, last = reached.worst < last, reached.worst.copy()
            self._keep(_of_neighbours(reached, missing, changed, *origins.neighbours), reached)
            if (reached.signs[missing] < 0).any():
                self._keep(self._expanding(reached, missing, origins, tracer), reached)
        return reached

    def _ideal(self, ideal: BestPairs, vertices: Ints) -> BestPairs:
        """The best grasps for ideal points that are reached, with the same numbers."""
        worst, best = _nothing_found(ideal), _nothing_found(ideal)
        self._keep(_grasps_of(ideal, vertices, 0), worst)
        differing = vertices[_differ(ideal, vertices)]
        results = no_results(len(ideal.reason))
        self._keep(_grasps_of(ideal, differing, 1), best, results)
        first = worst.faces[:, 1] >= 0
        second = first.copy()
        second[differing] = best.faces[differing, 1] >= 0
        _copy(best, worst, second & ~first, (*OF_WORST, *CACHED))
        # Evaluated again they would differ by rounding.
        _copy(ideal, worst, first, OF_WORST)
        _copy(ideal, worst, second, OF_BEST)
        for number, mask in enumerate((first, second)):
            worst.faces[mask, number] = ideal.faces[mask, number]
            worst.weights[mask, number] = ideal.weights[mask, number]
        only_second = second & ~first
        for name in results._fields:
            getattr(self.results, name)[only_second] = getattr(results, name)[only_second]
        worst.faces[only_second, 0] = best.faces[only_second, 0]
        worst.weights[only_second, 0] = best.weights[only_second, 0]
        return worst

    def reach_of(self, ideal: BestPairs, reached: BestPairs, tracer: SurfaceRays) -> Reach:
        """How the best grasp of each vertex is reached; where none is, why the best grasp is not.

        Where the stroke leaves only grasps that are outside the search cone, but the surface
        right opposite is within it, WIDTH.

        Args:
            ideal: The best grasps for ideal points.
            reached: What `run` returned.
            tracer: Rays through the surface.
        """
        missing = np.flatnonzero(reached.reason == NOT_REACHED)
        vertices, signs, faces, weights = _grasps_of(ideal, missing, 0)
        codes = self.results.codes

        def work(rows: slice, beside: Any) -> None:
            pairs = (vertices[rows], signs[rows], faces[rows], weights[rows])
            explain_pairs(*pairs, self.domain, beside, codes)

        self._in_chunks(work, len(missing))
        useless = missing[ideal.best[missing] >= self.cone]
        codes[self._facing(useless, ideal, tracer)] = Reachability.WIDTH
        return Reach.of(self.mesh, self.results, self.scene.approach.angles)

    def _facing(self, vertices: Ints, ideal: BestPairs, tracer: SurfaceRays) -> Ints:
        """Those vertices that have a grasp along their normal, of any opening."""
        one, count = _nothing_found(ideal), len(vertices)
        if count:
            rays = starting_rays(
                vertices.astype(np.int32), self.centres[vertices], np.ones(count, dtype=np.int8),
                count,
            )  # fmt: skip
            tracer.evaluate_all(rays, self.limits._replace(largest=np.inf), one)
        return vertices[one.best[vertices] < self.cone]

    def _search(self, missing: Ints, reached: BestPairs) -> None:
        """Search the whole surface; at creases for the best normals too."""
        creases = missing[self.sets.counts[missing] != 1]
        for vertices, worst in ((missing, True), (creases, False)):
            self._keep_partners(vertices, reached, MOST_FAILED, worst=worst)

    def _search_on(
        self, ideal: BestPairs, missing: Ints, reached: BestPairs, neighbours: tuple[Ints, Ints]
    ) -> None:
        """Search near contacts that are not reached, where there may be much better grasps.

        Neighbours mostly end alike: first where more is to gain than beside, of equal ones at some,
        and then beside each vertex where a better grasp is found. It is kept beside what is known:
        no grasp becomes worse.
        """
        count, bounds = len(reached.worst), np.minimum(reached.worst, self.cone)
        gains, around = np.zeros((2, count))
        chance = np.random.default_rng(0).random(len(missing))
        gains[missing] = (bounds - ideal.worst)[missing] + ALIKE_GAINS * chance
        owners, others = np.repeat(np.arange(count), np.diff(neighbours[0])), neighbours[1]
        np.maximum.at(around, owners, gains[others])
        waits = gains > STEP
        wave = waits & (gains > around)
        for _ in range(WAVES):
            found = np.zeros(count, dtype=bool)
            found[wave] = self._keep_partners(
                np.flatnonzero(wave), reached, MORE_FAILED, bounds=bounds[wave], step=STEP
            )
            waits &= ~wave
            wave = waits & np.isin(np.arange(count), owners[found[others]])

    def _keep_partners(
        self,
        vertices: Ints,
        reached: BestPairs,
        most_failed: int,
        *,
        worst: bool = True,
        bounds: Floats | None = None,
        step: float = math.inf,
    ) -> Bools:
        """Search for the best opposing contacts that are reached, and keep those that are better.

        For fingers that squeeze.

        Args:
            vertices: Vertices (n,).
            reached: Grasps that are reached; written.
            most_failed: Contacts of a vertex that are tested and not reached, before it ends.
            worst: Whether the best are those over the worst normals of the vertex.
            bounds: Critical angles that are to be improved [rad] (n,), None: all that are
                searched for.
            step: Difference of angles from which contacts near one that is not reached are tested.

        Returns:
            Whether a contact is found (n,).
        """
        faces = np.full(len(vertices), -1, dtype=np.int64)
        weights = np.zeros((len(vertices), 3))
        limit = np.full(len(vertices), self.cone) if bounds is None else bounds

        def work(rows: slice, beside: Any) -> None:
            faces[rows], weights[rows] = search_reachable(
                vertices[rows], worst, limit[rows], step, self.spacing, most_failed, self.domain,
                beside,
            )  # fmt: skip

        self._in_chunks(work, len(vertices))
        signs = np.ones(len(vertices), dtype=np.int8)
        self._keep(Pairs(vertices, signs, faces, weights), reached)
        return faces >= 0

    def _keep(self, pairs: Pairs, reached: BestPairs, results: ReachResults | None = None) -> None:
        """Keep those of some grasps that are reached and better than the known ones.

        The results of the tests are kept too, None: among those of the search.
        """
        results = results or self.results
        order = np.argsort(pairs.vertices, kind="stable")
        vertices, signs, faces, weights = (array[order] for array in pairs)

        def work(rows: slice, beside: Any) -> None:
            grasps = (vertices[rows], signs[rows], faces[rows], weights[rows])
            keep_reached(*grasps, self.domain, beside, reached, results)

        # No two threads write the grasp of one vertex.
        self._in_chunks(work, len(vertices), np.flatnonzero(np.diff(vertices)) + 1)

    def _in_chunks(
        self, work: Callable[[slice, Any], None], count: int, borders: Ints | None = None
    ) -> None:
        """Run work on slices of `count` rows that begin at `borders`, in the threads."""
        starts = np.arange(0, count, CHUNK)
        if borders is not None:
            starts = np.unique(np.append(borders, count)[np.searchsorted(borders, starts[1:])])
            starts = np.concatenate([[0], starts[starts < count]])
        ends = np.append(starts[1:], count)

        def run(start: int, end: int) -> None:
            workspace = make_workspace(self.scene.approach.angles)
            work(slice(start, end), (*self.beside, workspace))

        if count:
            list(self.executor.map(run, starts.tolist(), ends.tolist()))

    def _other_starts(self, ideal: BestPairs, vertices: Ints, tracer: SurfaceRays) -> list[Pairs]:
        """The clearly different grasps that rays found, traced again, one list for each rank."""
        traced = []
        for rank in range(1, ideal.start_angles.shape[1]):
            subset = vertices[np.isfinite(ideal.start_angles[vertices, rank])]
            if not len(subset):
                continue
            one = _nothing_found(ideal)
            rays = starting_rays(
                subset.astype(np.int32), ideal.starts[subset, rank].copy(),
                ideal.start_signs[subset, rank].copy(), len(subset),
            )  # fmt: skip
            tracer.evaluate_all(rays, self.limits, one)
            traced.append(_grasps_of(one, subset, 0))
        return traced

    def _expanding(
        self, reached: BestPairs, vertices: Ints, origins: Origins, tracer: SurfaceRays
    ) -> Pairs:
        """The best grasps toward neighbours' opposing contacts with nothing in between."""
        inside = reached._replace(
            reason=np.where(reached.signs < 0, reached.reason, NOT_REACHED).astype(np.uint8)
        )
        one = _nothing_found(reached)
        tracer.evaluate_all(neighbour_rays(vertices, origins, inside), self.limits, one)
        return _grasps_of(one, vertices[one.reason[vertices] == FOUND], 0)


def _copy(source: BestPairs, target: BestPairs, mask: Bools, names: tuple[str, ...]) -> None:
    """Copy fields of the chosen vertices (V,)."""
    for name in names:
        getattr(target, name)[mask] = getattr(source, name)[mask]


def _nothing_found(grasps: BestPairs) -> BestPairs:
    """Grasps of as many vertices, none found yet; the reasons are those known."""
    nothing = no_pairs(len(grasps.worst), 1, grasps.distinct_cosine)
    unreached = np.where(grasps.reason == FOUND, NOT_REACHED, grasps.reason)
    return nothing._replace(reason=unreached.astype(np.uint8))


def _grasps_of(grasps: BestPairs, vertices: Ints, number: int) -> Pairs:
    """The best grasps of vertices, over the worst normals (0) or over the best ones (1)."""
    signs = (grasps.signs, grasps.signs_best)[number]
    return Pairs(
        vertices,
        signs[vertices],
        grasps.faces[vertices, number],
        grasps.weights[vertices, number],
    )


def _differ(grasps: BestPairs, vertices: Ints) -> Bools:
    """Whether the best grasps over the worst and over the best normals differ, (n,)."""
    faces, weights = grasps.faces[vertices], grasps.weights[vertices]
    same = (faces[:, 0] == faces[:, 1]) & (weights[:, 0] == weights[:, 1]).all(axis=1)
    return np.asarray(~same)


def _still_better(ideal: BestPairs, reached: BestPairs, vertices: Ints) -> Ints:
    """Vertices with a better grasp than that which is reached."""
    worse = reached.worst[vertices] > ideal.worst[vertices]
    return vertices[worse | (reached.best[vertices] > ideal.best[vertices])]


def _of_neighbours(
    reached: BestPairs, vertices: Ints, changed: Bools, first: Ints, index: Ints
) -> Pairs:
    """The opposing contacts that changed neighbours of vertices ended with, of squeezing fingers.

    The others were tried before.
    """
    counts = np.diff(first)[vertices]
    owners = np.repeat(vertices, counts)
    ends = np.cumsum(counts)
    rows = np.arange(len(owners)) + np.repeat(first[vertices] - (ends - counts), counts)
    others = index[rows]
    usable = (changed & (reached.reason == FOUND) & (reached.signs > 0))[others]
    return Pairs(
        owners[usable],
        reached.signs[others[usable]],
        reached.faces[others[usable], 0],
        reached.weights[others[usable], 0],
    )
