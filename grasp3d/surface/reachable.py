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
"""Fields of `BestPairs` of a vertex's grasp."""

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


class Pairs(NamedTuple):
    """Grasps to test: a vertex and a point on a face each."""

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
    """Where each vertex comes in the order of the domain's tree, shape (V,)."""
    scene: Scene
    cone: float
    """Largest critical angle that is searched for [rad]."""
    executor: ThreadPoolExecutor

    def __post_init__(self) -> None:
        scene = self.scene
        assert scene.jaws is not None
        self.beside = NormalizedScene.of(self.mesh, scene.jaws, scene.table, scene.approach)

    def run(self, ideal: BestPairs) -> tuple[BestPairs, Reach]:
        """The best grasps that are reached; vertices with other grasps only are NOT_REACHED.

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
        """Write how grasps are reached, or why not."""

        def work(rows: slice, beside: Any) -> None:
            reach_partners(*(one[rows] for one in pairs), self.domain, beside, results)

        self._in_chunks(work, len(pairs.vertices))

    def _keep(self, pairs: Pairs, reached: BestPairs) -> None:
        """Keep those of some grasps that are reached and better than the known ones."""
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
        """Search for grasps of the vertices whose best one is not reached, and try neighbours'."""
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
        bounds: Floats | None = None,
        step: float = math.inf,
    ) -> Bools:
        """Search for the best opposing contacts that are reached, and keep those that are better.

        Args:
            vertices: Vertices (n,).
            reached: Grasps that are reached; written.
            most_failed: Contacts of a vertex that are tested and not reached, before it ends.
            bounds: Critical angles that are to be improved [rad] (n,), None: all that are
                searched for.
            step: Difference of angles from which contacts near one that is not reached are tested.

        Returns:
            Whether a contact is found (n,).
        """
        faces = np.full(len(vertices), -1, dtype=np.int64)
        weights = np.zeros((len(vertices), 3))
        limit = np.full(len(vertices), self.cone) if bounds is None else bounds
        order = np.argsort(self.places[vertices], kind="stable")  # neighbours need the same memory
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
    """Grasps of as many vertices, none found yet; the reasons are those known."""
    nothing = no_pairs(len(grasps.worst))
    unreached = np.where(grasps.reason == FOUND, NOT_REACHED, grasps.reason)
    return nothing._replace(reason=unreached.astype(np.uint8))


def _grasps_of(grasps: BestPairs, vertices: Ints) -> Pairs:
    """The best grasps of vertices."""
    return Pairs(vertices, grasps.faces[vertices], grasps.weights[vertices])


def _of_neighbours(
    reached: BestPairs, vertices: Ints, changed: Bools, first: Ints, index: Ints
) -> Pairs:
    """The opposing contacts that changed neighbours of vertices ended with, not tried before."""
    counts = np.diff(first)[vertices]
    owners = np.repeat(vertices, counts)
    ends = np.cumsum(counts)
    rows = np.arange(len(owners)) + np.repeat(first[vertices] - (ends - counts), counts)
    others = index[rows]
    usable = (changed & (reached.reason == FOUND))[others]
    return Pairs(owners[usable], reached.faces[others[usable]], reached.weights[others[usable]])
