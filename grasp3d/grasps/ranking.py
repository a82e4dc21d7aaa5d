"""Which grasp is to be taken first, and which others are distinct from it."""

import itertools
from functools import reduce

import numpy as np

from grasp3d.arrays import Bools, Floats, Ints
from grasp3d.mesh import ObjectMesh
from grasp3d.surface.labelled_grasps import LabelledGrasps

DISTINCT = 1.0 / 8.0
"""Distance of corresponding contacts, in object sizes, from which grasps are distinct."""

MOST_DISTINCT = 1000
"""Distinct grasps that are found at most."""

AS_GOOD, STARTS = 0.01, 100
"""Difference of scores up to which grasps are about as good, and so many of them from which the
others are chosen."""

MAX_PERMUTED = 5
"""Most contacts of grasps whose contacts are matched in every order."""


def distance_of_distinct(mesh: ObjectMesh) -> float:
    """Default distance from which grasps are distinct [m]."""
    return DISTINCT * mesh.size


def distinct_rows(points: Floats, count: int, limit: float) -> Ints:
    """Indices of grasps (b, n, 3), best first, that are not near a better one."""
    rows: list[int] = []
    remaining = np.arange(len(points))
    while len(remaining) and len(rows) < count:
        rows.append(int(remaining[0]))
        remaining = remaining[1:]
        distance = matched_distance(points[remaining], points[rows[-1]])
        remaining = remaining[(distance >= limit) & (distance > 0.0)]
    return np.array(rows, dtype=np.int64)


def matched_distance(points: Floats, other: Floats) -> Floats:
    """Distances of grasps from another one: the farthest pair of contacts in the best matching.

    Args:
        points: Contacts, shape (b, n, 3).
        other: Shape (n, 3); more than five contacts are matched in their order.

    Returns:
        Shape (b,).
    """
    gaps = points[:, :, None] - other  # (b, n, n, 3)
    gaps *= gaps
    squares = gaps[..., 0] + gaps[..., 1] + gaps[..., 2]  # (b, n, n), faster than `sum`
    indices = tuple(range(len(other)))
    orders = itertools.permutations(indices) if len(other) <= MAX_PERMUTED else [indices]
    farthest = (reduce(np.maximum, (squares[:, i, order[i]] for i in indices)) for order in orders)
    return np.asarray(np.sqrt(reduce(np.minimum, farthest)))


def most_distinct(points: Floats, scores: Floats, limit: float, count: int) -> Ints:
    """Numbers of distinct grasps (b, 2, 3), `count` at most: a best one and many others.

    Where the best ones shut out so many that fewer than `count` are left, those that shut out
    fewest are taken first, beside each of those that are about as good as the best one, and each is
    exchanged that shuts out two others.
    """
    greedy = distinct_rows(points, count, limit)
    if len(greedy) == min(count, len(points)):
        return greedy
    near = np.stack([matched_distance(points, one) < limit for one in points])
    choices = [_exchanged(near, greedy.tolist())]
    for first in np.flatnonzero(scores >= scores[0] - AS_GOOD)[:STARTS].tolist():
        sparse, left = [first], ~near[first]
        while left.any():
            crowds = np.where(left, (near & left).sum(axis=1), len(points))
            sparse.append(int(crowds.argmin()))
            left &= ~near[sparse[-1]]
        choices.append(_exchanged(near, sparse))
    most = max(choices, key=len)
    return np.array([most[0], *sorted(most[1:])][:count])


def _exchanged(near: Bools, chosen: list[int]) -> list[int]:
    """Numbers with those added that are distinct from all, and those exchanged that shut out two.

    The first one stays.

    Args:
        near: Which of n are near each other, shape (n, n).
        chosen: Numbers of those that are chosen.
    """
    changed = True
    while changed:
        changed, blocked = False, near[chosen].sum(axis=0)
        if not blocked.all():
            chosen, changed = [*chosen, int(blocked.argmin())], True
            continue
        for one in chosen[1:]:
            alone = np.flatnonzero((blocked == 1) & near[one])
            apart = ~near[np.ix_(alone, alone)]
            first = np.flatnonzero(apart.any(axis=1))
            if len(first):
                pair = alone[[first[0], apart[first[0]].argmax()]]
                chosen = [*(other for other in chosen if other != one), *pair.tolist()]
                changed = True
                break
    return chosen


def ranked_rows(grasps: LabelledGrasps) -> Ints:
    """Rows of grasps, the one to be taken first at the front; computes scores and epsilon.

    By `score`; where that is the same by margin, by epsilon, and by their order.

    Args:
        grasps: A table of grasps, or poses.

    Returns:
        Shape (b,).
    """
    margin, epsilon = np.nan_to_num(grasps.margin, nan=-np.inf), np.nan_to_num(grasps.epsilon)
    return np.lexsort([-epsilon, -margin, -grasps.score])
