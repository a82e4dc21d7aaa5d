"""Critical friction angles over all combinations of the normals that contacts may have."""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from grasp3d._kernels.hull.wrench_problem import SIGN
from grasp3d._kernels.search.coplanar_contacts import critical_of_sets, make_fans, make_plane
from grasp3d.arrays import RIGHT_ANGLE, Bools, Floats, Ints
from grasp3d.contact.contacts import Contacts
from grasp3d.quality.closure import Status
from grasp3d.quality.critical_angle import critical_friction_angle
from grasp3d.quality.epsilon_options import EpsilonOptions
from grasp3d.quality.wrench_problem import WrenchProblem
from grasp3d.stability.enumeration import GOLDEN_RATIO
from grasp3d.stability.normal_sets import sampled_sets

WorstAndBest = tuple[Floats, Floats]
"""Critical friction angles over the worst and over the best normals [rad]."""


@dataclass(frozen=True, eq=False)
class NormalSamples:
    """Sampled normals of the contacts of grasps, to be combined in every way."""

    normals: Floats
    """Shape (m, 3)."""
    first: Ints
    """First row of each contact's normals, shape (b, n)."""
    sizes: Ints
    """Number of normals of each contact, shape (b, n)."""
    steps: Floats
    """Largest step between the samples of a grasp [rad], shape (b,); see `sampled_set`."""

    @classmethod
    def of_sets(cls, start: Ints, normals: Floats, count: int, step: float) -> "NormalSamples":
        """Sample the sets of grasps' contacts.

        Args:
            start: First row of each contact's set in `normals`, shape (b * count + 1,).
            normals: Corners of the sets, in order around each; one where the surface is smooth.
            count: Number of contacts of a grasp.
            step: Largest step between samples [rad], as in `sampled_set`.
        """
        numbers, first = _distinct_sets(start, normals)
        chosen = np.concatenate([start[:0], *(np.arange(start[k], start[k + 1]) for k in first)])
        chosen_start = np.concatenate([[0], np.cumsum(np.diff(start)[first])]).astype(np.int64)
        samples, steps = sampled_sets(chosen_start, normals[chosen], step)
        sizes = np.array([len(rows) for rows in samples], dtype=np.int64)
        first_rows = np.cumsum(sizes) - sizes
        return cls(
            normals=np.concatenate([np.zeros((0, 3)), *samples]),
            first=first_rows[numbers].reshape(-1, count),
            sizes=sizes[numbers].reshape(-1, count),
            steps=steps[numbers].reshape(-1, count).max(axis=1),
        )

    @property
    def combinations(self) -> Floats:
        """Number of combinations of normals of each grasp, shape (b,)."""
        return np.asarray(self.sizes.astype(np.float64).prod(axis=1))

    def take(self, which: Ints) -> "NormalSamples":
        """The samples of chosen grasps."""
        return replace(
            self, first=self.first[which], sizes=self.sizes[which], steps=self.steps[which]
        )

    def at(self, grasps: Ints, numbers: Ints) -> Floats:
        """Normals of grasps (m,), each at its combination number (m,), shape (m, n, 3)."""
        chosen = np.empty((len(grasps), self.sizes.shape[1]), dtype=np.int64)
        for i in range(chosen.shape[1]):
            numbers, chosen[:, i] = np.divmod(numbers, self.sizes[grasps, i])
        return np.asarray(self.normals[self.first[grasps] + chosen])


def _distinct_sets(start: Ints, normals: Floats) -> tuple[Ints, Ints]:
    """(index of each set among the distinct ones (b,), first set of each index (d,))."""
    numbers: dict[bytes, int] = {}
    first: list[int] = []
    found = np.empty(len(start) - 1, dtype=np.int64)
    for k in range(len(found)):
        key = normals[start[k] : start[k + 1]].tobytes()
        if key not in numbers:
            numbers[key] = len(first)
            first.append(k)
        found[k] = numbers[key]
    return found, np.array(first, dtype=np.int64)


def angle_bounds(
    points: Floats, samples: NormalSamples, *, tolerance: float, threads: int | None = None
) -> WorstAndBest:
    """Critical friction angles over the worst and over the best of the combinations.

    They include a margin for the normals between the samples (see `sampled_set`), so that they
    are bounds for all normals of the sets.

    Args:
        points: Contact points, n >= 3, shape (b, n, 3).
        samples: Sampled normals of the contacts.
        tolerance: As in `critical_friction_angle` [rad].
        threads: Threads; None: one per processor.

    Returns:
        (worst, best), shape (b,) each, from 0 to pi/2: no combination has a larger angle than the
        worst, and none a smaller one than the best.
    """
    problem = _CombinationProblem(points, samples, tolerance / 2.0, threads)
    return _with_margin(*problem.extremes(), samples)


def planar_bounds(points: Floats, samples: NormalSamples, *, tolerance: float) -> WorstAndBest:
    """The bounds of `angle_bounds` for three contacts, computed in the plane through them.

    There the combinations need not be enumerated: the force directions that a contact's normals
    allow are intervals in the plane, of which the first and the last direction are enough.

    Returns:
        (worst, best), shape (b,) each; nan for contacts on one line, which have no plane.
    """
    worst, best = np.empty((2, len(points)))
    critical_of_sets(
        points, samples.first, samples.sizes, samples.normals, tolerance, make_plane(),
        make_fans(int(samples.sizes.max(initial=1))), worst, best,
    )  # fmt: skip
    return _with_margin(worst, best, samples)


def _with_margin(worst: Floats, best: Floats, samples: NormalSamples) -> WorstAndBest:
    """Bounds for all normals of the sets, also between the samples; see `sampled_set`."""
    shrink = np.cos(samples.steps / 2.0)
    sine = np.sin(np.clip(worst, 0.0, RIGHT_ANGLE)) / shrink
    cosine = np.cos(np.clip(best, 0.0, RIGHT_ANGLE)) / shrink
    return np.arcsin(np.minimum(sine, 1.0)), np.arccos(np.minimum(cosine, 1.0))


class _CombinationProblem(NamedTuple):
    """Search for the largest and smallest critical angle among combinations of sampled normals."""

    points: Floats
    """Shape (b, n, 3)."""
    samples: NormalSamples
    tolerance: float
    threads: int | None

    def extremes(self) -> WorstAndBest:
        """Bounds on the largest and on the smallest angle of each grasp, shape (b,) each."""
        grasps, numbers = self._combinations()
        first = np.flatnonzero(np.diff(grasps, prepend=-1))
        found = self.angles(grasps[first], numbers[first])
        others = np.delete(grasps, first), np.delete(numbers, first)
        return self._search(found.copy(), *others, 1), self._search(found.copy(), *others, -1)

    def _combinations(self) -> tuple[Ints, Ints]:
        """(grasps, numbers) of all combinations, grasp by grasp.

        Those of a grasp start with the middle one and are in an order whose beginnings are spread
        evenly over all of them.
        """
        totals = self.samples.combinations.astype(np.int64)
        grasps = np.repeat(np.arange(len(totals)), totals)
        numbers = np.arange(len(grasps)) - np.repeat(np.cumsum(totals) - totals, totals)
        key = (numbers - totals[grasps] // 2) * GOLDEN_RATIO % 1.0
        return grasps, numbers[np.lexsort((key, grasps))]

    def _search(self, found: Floats, grasps: Ints, numbers: Ints, sign: int) -> Floats:
        """Bounds on the largest (sign 1) or smallest (-1) angles, starting from those found.

        A closure test excludes most combinations. Of those with a larger (smaller) angle than found
        so far, the angle of one for each grasp is computed, then the others are tested again.
        """
        while grasps.size:
            limit = np.maximum(found, 0.0)[grasps] + sign * self.tolerance
            possible = (limit > 0.0) & (limit < RIGHT_ANGLE)
            grasps, numbers, limit = grasps[possible], numbers[possible], limit[possible]
            closed, failed = self.closed_at(grasps, numbers, limit)
            better = ~failed if sign < 0 else ~closed  # undecided ones are not excluded
            grasps, numbers = grasps[better], numbers[better]
            which, first = np.unique(grasps, return_index=True)
            angles = self.angles(which, numbers[first])
            found[which] = sign * np.maximum(sign * found[which], sign * angles)
            grasps, numbers = np.delete(grasps, first), np.delete(numbers, first)
        # Add the tolerance, except where no combination is force-closed at any friction.
        never_closed = (sign < 0) & (found >= RIGHT_ANGLE)
        return np.where(never_closed, found, found + sign * self.tolerance)

    def angles(self, grasps: Ints, numbers: Ints) -> Floats:
        """Critical angles of grasps (m,), each at its combination number (m,)."""
        contacts = Contacts(self.points[grasps], self.samples.at(grasps, numbers), friction=0.0)
        return np.array(
            critical_friction_angle(contacts, tolerance=self.tolerance, threads=self.threads)
        )

    def closed_at(self, grasps: Ints, numbers: Ints, angles: Floats) -> tuple[Bools, Bools]:
        """Force closure of grasps (m,), each at its combination and friction angle (m,).

        Returns:
            (surely force-closed, surely not force-closed), shape (m,) each.
        """
        contacts = Contacts(self.points[grasps], self.samples.at(grasps, numbers), friction=0.0)
        problem = WrenchProblem.of_contacts(contacts, EpsilonOptions())
        at_angles = problem.at_angles(angles)
        results = at_angles.solve(SIGN, with_forces=False, threads=self.threads)
        return results.closed, ~results.closed & (results.status != Status.UNDECIDED)
