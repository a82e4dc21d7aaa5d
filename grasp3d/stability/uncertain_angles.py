"""Critical friction angles of grasps whose contacts are uncertain: the worst and the best.

What is uncertain besides the tilts folds into two angles, on which labels are thresholds: S if the
worst is below beta - alpha/2, U if the best is at least beta + alpha/2.

*Normals on creases.* A contact may have any normal of a set. Two contacts: the largest and the
smallest angle between the line through them and the set. More: the set lies in a cap about its
middle, of radius r; a cone that is narrower by r holds for each of its normals, one that is wider
by r covers all.

*Locations.* A contact is anywhere within its location error d of the perceived point, where the
normal turns by up to omega from the set of normals; see `mesh.turns`. Two contacts: the line
between them turns by up to eta = asin((d1 + d2) / opening), in every direction: the worst angle is
at most the larger of both, each with its omega, plus eta; the best at least the same with both
subtracted. More: cones are narrower by omega, and for the rest see `displacement` of
`quality.critical_angle`; the best angle is 0.
"""

import math

import numpy as np

from grasp3d._kernels.search.pair_angles import pair_angles
from grasp3d.arrays import Floats, angles_between
from grasp3d.quality.critical_angle import angle_brackets, brackets_of_smooth
from grasp3d.stability.normal_sets import NormalSets, WorstAndBest

ANY_DIRECTION = np.array([0.0, 0.0, 1.0])


def uncertain_angles(
    points: Floats,
    sets: NormalSets,
    *,
    wider: tuple[Floats, Floats] | None = None,
    location: Floats | None = None,
    turns: Floats | None = None,
    first: tuple[Floats, Floats] | None = None,
    tolerance: float = 1e-4,
) -> WorstAndBest:
    """Critical friction angles over the worst and over the best of what is uncertain.

    Args:
        points: Perceived contact points, shape (b, n, 3).
        sets: Normals that each contact may have.
        wider: Where cones differ, what each has more than the friction angle in the worst and in
            the best case [rad], shape (b, n) each.
        location: Location error of each contact, in the unit of the points, shape (b, n).
        turns: How far the surface turns within it [rad], shape (b, n); None: normals stay.
        first: Three contacts and more: the angles in question [rad], shape (b,) each. Whether the
            worst is below the first of them, and the best at least the second, is then exact,
            whatever the tolerance is.
        tolerance: Three contacts and more: width of brackets [rad], of the best only without
            `first`; of the worst the upper end is returned, of the best the lower one. inf: no more
            than `first` asks for.

    Returns:
        Shape (b,) each; inf for one contact, and the worst where two may be at one point. For two
        contacts up to pi, for more from 0 to pi/2: pi/2 where the grasp is force-closed at no
        friction. Of three smooth contacts and more, about which nothing else is uncertain, both are
        the critical friction angle, except where closure is undecided.
    """
    size, count = points.shape[:2]
    if count == 1:
        return np.full(size, math.inf), np.full(size, math.inf)
    inner, outer = wider or np.zeros((2, size, count))
    if turns is not None:
        inner, outer = inner - turns, outer + turns
    if count == 2:
        return _of_pairs(points, sets, inner, outer, location)
    middles, radii = sets.middles, sets.radii
    middles = np.where((middles == 0.0).all(axis=2, keepdims=True), ANY_DIRECTION, middles)
    if wider is None and location is None and not radii.any():
        low, high = brackets_of_smooth(points, middles, tolerance)
        return high, np.where(high - low > 2.0 * tolerance, low, high)
    moved = None if location is None else np.append(location.max(axis=1), np.zeros(size))
    low, high = angle_brackets(
        np.concatenate([points, points]),
        np.concatenate([middles, middles]),
        np.concatenate([inner - radii, outer + radii]),
        first=None if first is None else np.concatenate(first),
        displacement=moved,
        tolerance=np.repeat([tolerance, tolerance if first is None else math.inf], size),
    )
    worst, best = high[:size], low[size:]
    return worst, best if location is None else np.where(location.any(axis=1), 0.0, best)


def _of_pairs(
    points: Floats, sets: NormalSets, inner: Floats, outer: Floats, location: Floats | None
) -> WorstAndBest:
    """Closed form of two contacts: squeezing or expanding."""
    largest, smallest = np.empty((2, len(points), 2))
    # Copies: read-only arrays would be compiled for once more.
    arrays = (np.array(one) for one in (points, sets.start[:-1], sets.counts, sets.normals))
    pair_angles(*arrays, largest, smallest)
    worst = np.minimum((largest - inner).max(1), (math.pi - smallest - inner).max(1))
    best = np.minimum((smallest - outer).max(1), (math.pi - largest - outer).max(1))
    if location is not None:
        turn = line_turns(points, location.sum(axis=1))
        worst, best = np.minimum(worst + turn, math.pi), best - turn
    # Contacts at one point push along any line that lies in both cones.
    together = np.isinf(largest[:, 0])
    one, other = sets.middles[together].swapaxes(0, 1)
    between, spread = angles_between(one, -other), sets.radii[together].sum(axis=1)
    worst[together] = 0.5 * (between + spread - inner[together].sum(axis=1))
    best[together] = 0.5 * (between - spread - outer[together].sum(axis=1))
    if location is not None:  # any line may be the true one
        worst[together & location.any(axis=1)] = math.inf
    return worst, np.maximum(best, 0.0)


def line_turns(points: Floats, location: Floats | float) -> Floats:
    """Largest angles by which the lines between two contacts turn [rad], shape (b,).

    Args:
        points: Their perceived positions, shape (b, 2, 3).
        location: Sum of both location errors, shape (b,) or one for all.
    """
    openings = np.linalg.norm(points[:, 1] - points[:, 0], axis=1)
    sines = np.ones(len(openings))
    np.divide(location, openings, out=sines, where=openings > location)
    return np.where(np.asarray(location) > 0.0, np.arcsin(sines), 0.0)
