"""Search for the best antipodal grasp through every vertex among those that a gripper reaches.

The best grasps for ideal points are tested first. Where one is not reached, a search of the whole
surface tests opposing contacts in the order of their critical angles. The contacts that
neighbouring vertices ended with are tested as well.
"""

import math
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from grasp3d._kernels.jaws.gripper_parts import REACHED, ReachResults, make_workspace, no_results
from grasp3d._kernels.search.antipodal_candidates import FOUND, BestPairs, no_pairs
from grasp3d._kernels.search.face_contacts import PairDomain
from grasp3d._kernels.search.reachable_partners import (
    keep_reached,
    reach_partners,
    search_reachable,
)
from grasp3d.arrays import Bools, Floats, Ints
from grasp3d.hand.reach import ANGLES, NormalizedScene, Reach
from grasp3d.hand.scene import Scene
from grasp3d.mesh import ObjectMesh
from grasp3d.surface.candidate_points import neighbours

NOT_REACHED = 5
"""Reason code: there are grasps, but none of those tested is reached."""

GRASP = ("worst", "best", "reason", "closing", "partner", "partner_normal", "faces", "weights")
"""Fields of `BestPairs` that describe a vertex's grasp."""

CHUNK = 128
"""Vertices that a thread tests at once."""

MOST_FAILED = 4
"""Number of unreached opposing contacts of a vertex after which its search ends; good contacts of
its neighbours are tested in addition."""

SWEEPS = 2
"""Rounds in which the opposing contacts of neighbouring vertices are tested."""

ALIKE_GAINS, WAVES, MORE_FAILED = 1e-6, 6, 24
"""Difference below which gains count as equal [rad]; number of waves of the further search, first
at some vertices, then beside those where it found a better grasp; its own `MOST_FAILED`."""

STEP = math.radians(1.0)
"""Difference of angles that is worth a further search, and from which this search tests contacts
near an unreached one [rad]."""

SPACING, LARGEST_SPACING = 0.5, 1.0 / 16.0
"""Distance from which opposing contacts count as different, in widths of a finger; its largest
value, in object sizes."""


class Pairs(NamedTuple):
    """Grasps to test, each of a vertex and a point on a face."""

    vertices: Ints
    """(n,)"""
    faces: Ints
    """Face of the opposing contact, -1: none (n,)."""
    weights: Floats
    """Its barycentric coordinates (n, 3)."""


@dataclass(eq=False)
class ReachSearch:
    """Search for the grasps of vertices that a gripper reaches, in the normalised frame."""

    mesh: ObjectMesh
    domain: PairDomain
    places: Ints
    """Position of each vertex in the order of the domain's tree, shape (V,)."""
    scene: Scene
    cone: float
    """Largest critical angle that is searched for [rad]."""
    executor: ThreadPoolExecutor

    def __post_init__(self) -> None:
        scene = self.scene
        assert scene.jaws is not None
        self.beside = NormalizedScene.of(self.mesh, scene.jaws, scene.table, scene.approach)

    def run(self, ideal: BestPairs) -> tuple[BestPairs, Reach]:
        """Find the best grasps that are reached; vertices with other grasps only are NOT_REACHED.

        Args:
            ideal: The best grasps for ideal points.

        Returns:
            The grasps, and how each is reached; where none is, why the best grasp is not.
        """
        vertices, results = np.flatnonzero(ideal.reason == FOUND), no_results(len(ideal.reason))
        reached = _nothing_found(ideal)
        self._write_reach(_grasps_of(ideal, vertices), results)
        same = results.codes == REACHED
        for name in GRASP:
            getattr(reached, name)[same] = getattr(ideal, name)[same]
        missing = vertices[~same[vertices]]
        self._improve(ideal, missing, reached)
        found = missing[reached.faces[missing] >= 0]
        self._write_reach(_grasps_of(reached, found), results)
        return reached, Reach.of(self.mesh, results)

    def _write_reach(self, pairs: Pairs, results: ReachResults) -> None:
        """Write how grasps are reached, or why they are not."""

        def work(rows: slice, beside: Any) -> None:
            reach_partners(*(one[rows] for one in pairs), self.domain, beside, results)

        self._in_chunks(work, len(pairs.vertices))

    def _keep(self, pairs: Pairs, reached: BestPairs) -> None:
        """Keep the given grasps that are reached and better than the known ones."""
        order = np.argsort(pairs.vertices, kind="stable")
        vertices, faces, weights = (array[order] for array in pairs)

        def work(rows: slice, beside: Any) -> None:
            grasps = (vertices[rows], faces[rows], weights[rows])
            keep_reached(*grasps, self.domain, beside, reached)

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
            workspace = make_workspace(ANGLES)
            work(slice(start, end), (*self.beside, workspace))

        if count:
            list(self.executor.map(run, starts.tolist(), ends.tolist()))

    def _improve(self, ideal: BestPairs, missing: Ints, reached: BestPairs) -> None:
        """Search for grasps of vertices whose best one is not reached; try those of neighbours."""
        around = neighbours(self.mesh)
        self._keep_partners(missing, reached, MOST_FAILED)
        last = np.full(len(ideal.reason), np.inf)
        for number in range(SWEEPS + 1):
            if number == SWEEPS:
                self._search_on(ideal, missing, reached, around)
            changed, last = reached.worst < last, reached.worst.copy()
            self._keep(_of_neighbours(reached, missing, changed, *around), reached)

    def _search_on(
        self, ideal: BestPairs, missing: Ints, reached: BestPairs, neighbours: tuple[Ints, Ints]
    ) -> None:
        """Search near unreached contacts, at vertices where there may be much better grasps.

        Neighbours mostly end alike. So the search starts at vertices with more to gain than their
        neighbours, with random choices among equal ones, and goes on beside each vertex where it
        finds a better grasp. No grasp becomes worse.
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
        bounds: Floats | None = None,
        step: float = math.inf,
    ) -> Bools:
        """Search for the best opposing contacts that are reached, and keep those that are better.

        Args:
            vertices: Vertices (n,).
            reached: Grasps that are reached; modified.
            most_failed: Number of unreached contacts of a vertex after which its search ends.
            bounds: Critical angles to improve on [rad] (n,); None: the largest that is searched
                for.
            step: Difference of angles from which contacts near an unreached one are tested [rad].

        Returns:
            Whether each vertex has a reached contact below its bound (n,).
        """
        faces = np.full(len(vertices), -1, dtype=np.int64)
        weights = np.zeros((len(vertices), 3))
        limit = np.full(len(vertices), self.cone) if bounds is None else bounds
        order = np.argsort(self.places[vertices], kind="stable")  # neighbours read the same memory
        spacing = min(SPACING * self.beside.shape.finger_width, LARGEST_SPACING)

        def work(rows: slice, beside: Any) -> None:
            own = order[rows]
            faces[own], weights[own] = search_reachable(
                vertices[own], limit[own], step, spacing, most_failed, self.domain, beside
            )

        self._in_chunks(work, len(vertices))
        self._keep(Pairs(vertices, faces, weights), reached)
        return faces >= 0


def _nothing_found(grasps: BestPairs) -> BestPairs:
    """Grasps of as many vertices, none reached yet; other known reasons stay."""
    nothing = no_pairs(len(grasps.worst))
    unreached = np.where(grasps.reason == FOUND, NOT_REACHED, grasps.reason)
    return nothing._replace(reason=unreached.astype(np.uint8))


def _grasps_of(grasps: BestPairs, vertices: Ints) -> Pairs:
    """The best grasps of vertices."""
    return Pairs(vertices, grasps.faces[vertices], grasps.weights[vertices])


def _of_neighbours(
    reached: BestPairs, vertices: Ints, changed: Bools, first: Ints, index: Ints
) -> Pairs:
    """Opposing contacts of those neighbours of vertices whose grasp has changed."""
    counts = np.diff(first)[vertices]
    owners = np.repeat(vertices, counts)
    ends = np.cumsum(counts)
    rows = np.arange(len(owners)) + np.repeat(first[vertices] - (ends - counts), counts)
    others = index[rows]
    usable = (changed & (reached.reason == FOUND))[others]
    return Pairs(owners[usable], reached.faces[others[usable]], reached.weights[others[usable]])
