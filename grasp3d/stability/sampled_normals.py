"""Critical friction angles at every combination of normals that contacts may have."""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from grasp3d._kernels.coplanar_contacts import critical_of_sets, make_fans, make_plane
from grasp3d._kernels.wrench_problem import SIGN
from grasp3d.arrays import Bools, Floats, Ints
from grasp3d.contact.contacts import Contacts
from grasp3d.quality.critical_angle import RIGHT, critical_friction_angle
from grasp3d.quality.wrench_problem import WrenchProblem
from grasp3d.stability.enumeration import GOLDEN
from grasp3d.stability.normal_sets import sampled_sets

Both = tuple[Floats, Floats]


@dataclass(frozen=True, eq=False)
class NormalSamples:
    """Normals to try at the contacts of grasps, in all combinations."""

    normals: Floats
    """Shape (m, 3)."""
    first: Ints
    """First row of each contact's, shape (b, n)."""
    sizes: Ints
    """How many each contact has, shape (b, n)."""
    apart: Floats
    """Step at which those of a grasp stand at most [rad], shape (b,); see `sampled_set`."""

    @classmethod
    def of_sets(cls, start: Ints, normals: Floats, count: int, step: float) -> "NormalSamples":
        """Sample the sets of grasps' contacts.

        Args:
            start: First row of each contact's set in `normals`, shape (b * count + 1,).
            normals: Corners of the sets, in order around each; one where smooth.
            count: Contacts of a grasp.
            step: As in `sampled_set` [rad].
        """
        numbers, first = _distinct_sets(start, normals)
        chosen = np.concatenate([start[:0], *(np.arange(start[k], start[k + 1]) for k in first)])
        own = np.concatenate([[0], np.cumsum(np.diff(start)[first])]).astype(np.int64)
        found, apart = sampled_sets(own, normals[chosen], step)
        sizes = np.array([len(one) for one in found], dtype=np.int64)
        rows = np.cumsum(sizes) - sizes
        return cls(
            normals=np.concatenate([np.zeros((0, 3)), *found]),
            first=rows[numbers].reshape(-1, count),
            sizes=sizes[numbers].reshape(-1, count),
            apart=apart[numbers].reshape(-1, count).max(axis=1),
        )

    @property
    def combinations(self) -> Floats:
        """Combinations of normals of each grasp, shape (b,)."""
        return np.asarray(self.sizes.astype(np.float64).prod(axis=1))

    def take(self, which: Ints) -> "NormalSamples":
        """Some of the grasps."""
        return replace(
            self, first=self.first[which], sizes=self.sizes[which], apart=self.apart[which]
        )

    def at(self, grasps: Ints, numbers: Ints) -> Floats:
        """Normals of grasps (m,), each at the combination in its place, shape (m, n, 3)."""
        chosen = np.empty((len(grasps), self.sizes.shape[1]), dtype=np.int64)
        for i in range(chosen.shape[1]):
            numbers, chosen[:, i] = np.divmod(numbers, self.sizes[grasps, i])
        return np.asarray(self.normals[self.first[grasps] + chosen])


def _distinct_sets(start: Ints, normals: Floats) -> tuple[Ints, Ints]:
    """(number of each set among the distinct ones, one set of each number), (b,) and (d,)."""
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
    points: Floats, samples: NormalSamples, *, tolerance: float, threads: int | None = 1
) -> Both:
    """Critical friction angles over the worst and over the best of the combinations.

    What lies between the samples is allowed for (see `sampled_set`), so that they hold for all
    normals of the sets.

    Args:
        points: Three contacts or more, shape (b, n, 3).
        samples: The normals.
        tolerance: As in `critical_friction_angle` [rad].
        threads: Threads; None: one per processor.

    Returns:
        (worst, best), shape (b,) each, from 0 to pi/2: no combination has a larger angle than the
        worst, and none a smaller one than the best.
    """
    question = _Question(points, samples, tolerance / 2.0, threads)
    return _safe(*question.extremes(), samples)


def planar_bounds(points: Floats, samples: NormalSamples, *, tolerance: float) -> Both:
    """Do what `angle_bounds` does for three contacts, in the plane through them.

    There the combinations need not be tried: what the normals of a contact leave to its forces is
    told by the first and the last direction.

    Returns:
        (worst, best), shape (b,) each; nan for contacts on one line, which have no plane.
    """
    worst, best = np.empty((2, len(points)))
    critical_of_sets(
        points, samples.first, samples.sizes, samples.normals, tolerance, make_plane(),
        make_fans(int(samples.sizes.max(initial=1))), worst, best,
    )  # fmt: skip
    return _safe(worst, best, samples)


def _safe(worst: Floats, best: Floats, samples: NormalSamples) -> Both:
    """Allow for what lies between the samples; see `sampled_set`."""
    shrink = np.cos(samples.apart / 2.0)
    narrow = np.sin(np.clip(worst, 0.0, RIGHT)) / shrink
    wide = np.cos(np.clip(best, 0.0, RIGHT)) / shrink
    return np.arcsin(np.minimum(narrow, 1.0)), np.arccos(np.minimum(wide, 1.0))


class _Question(NamedTuple):
    """Critical angles at every combination of sampled normals."""

    points: Floats
    """Shape (b, n, 3)."""
    samples: NormalSamples
    tolerance: float
    threads: int | None

    def extremes(self) -> Both:
        """Bounds on the largest angle of each grasp and on the smallest, shape (b,) each."""
        grasps, numbers = self._spread()
        first = np.flatnonzero(np.diff(grasps, prepend=-1))
        found = self.angles(grasps[first], numbers[first])
        rest = np.delete(grasps, first), np.delete(numbers, first)
        return self._search(found.copy(), *rest, 1), self._search(found.copy(), *rest, -1)

    def _spread(self) -> tuple[Ints, Ints]:
        """(grasps, numbers) of all combinations, in an order of which every start is of all kinds.

        The one in the middle comes first.
        """
        totals = self.samples.combinations.astype(np.int64)
        grasps = np.repeat(np.arange(len(totals)), totals)
        numbers = np.arange(len(grasps)) - np.repeat(np.cumsum(totals) - totals, totals)
        key = (numbers - totals[grasps] // 2) * GOLDEN % 1.0
        return grasps, numbers[np.lexsort((key, grasps))]

    def _search(self, found: Floats, grasps: Ints, numbers: Ints, sign: int) -> Floats:
        """Largest angles (sign 1), or smallest (-1), beyond those found, moved to the safe side.

        A closure test settles most combinations; of those that go beyond what was found so far, one
        of each grasp is measured, then the others are tested anew.
        """
        while grasps.size:
            limit = np.maximum(found, 0.0)[grasps] + sign * self.tolerance
            open_ = (limit > 0.0) & (limit < RIGHT)
            grasps, numbers, limit = grasps[open_], numbers[open_], limit[open_]
            beyond = self.closes(grasps, numbers, limit) == (sign < 0)
            grasps, numbers = grasps[beyond], numbers[beyond]
            which, first = np.unique(grasps, return_index=True)
            angles = self.angles(which, numbers[first])
            found[which] = sign * np.maximum(sign * found[which], sign * angles)
            grasps, numbers = np.delete(grasps, first), np.delete(numbers, first)
        return self._moved(found, sign)

    def _moved(self, angles: Floats, sign: int) -> Floats:
        """Angles moved by the tolerance; where no friction closes any, as they are."""
        never = (sign < 0) & (angles >= RIGHT)
        return np.where(never, angles, angles + sign * self.tolerance)

    def angles(self, grasps: Ints, numbers: Ints) -> Floats:
        """Critical angles of grasps (m,), each at the combination in its place."""
        contacts = Contacts(self.points[grasps], self.samples.at(grasps, numbers), friction=0.0)
        return np.array(
            critical_friction_angle(contacts, tolerance=self.tolerance, threads=self.threads)
        )

    def closes(self, grasps: Ints, numbers: Ints, angles: Floats) -> Bools:
        """Whether grasps (m,), each at the combination in its place, close at friction angles."""
        contacts = Contacts(self.points[grasps], self.samples.at(grasps, numbers), friction=0.0)
        problem = WrenchProblem.of_contacts(contacts, None, "total", torque_scale=1.0)
        answers = problem.at_angles(angles).solve(SIGN, prove=False, threads=self.threads)
        return answers.closed
