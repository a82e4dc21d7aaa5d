"""Overlapping axis-aligned boxes, found by sweeping along one axis."""

from collections.abc import Iterator

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from grasp3d.arrays import Floats, Ints
from grasp3d.mesh.work_bounds import BODY_BOXES

AT_ONCE = 1 << 22
"""Pairs that are compared at once, to bound memory."""

SAMPLED = 1 << 23
"""Pairs of boxes that are compared to estimate the number of overlaps."""

FEWEST_SAMPLES = 32
"""Least number of boxes that are compared with all others."""


def overlapping(lower: Floats, upper: Floats) -> Iterator[tuple[Ints, Ints]]:
    """Find the pairs of boxes that overlap or touch.

    The boxes are sorted along the axis with the fewest overlaps; each is compared with those that
    begin before it ends.

    Args:
        lower: Lower corner of each box (n, 3).
        upper: Upper corner of each box (n, 3).

    Yields:
        Some of the pairs, each pair once: the first and the second box, shape (k,) each.

    Raises:
        WorkBoundError: There are too many boxes to compare.
    """
    count = len(lower)
    orders = np.argsort(lower, axis=0, kind="stable")
    ends = [
        np.searchsorted(lower[orders[:, k], k], upper[orders[:, k], k], side="right")
        for k in range(3)
    ]
    axis = int(np.argmin([end.sum() for end in ends]))
    order, later = orders[:, axis], ends[axis] - np.arange(1, count + 1)
    BODY_BOXES.check(int(later.sum()))
    total = np.cumsum(later)
    begin = 0
    while begin < count:
        before = total[begin] - later[begin]
        end = max(begin + 1, int(np.searchsorted(total, before + AT_ONCE, side="right")))
        size = later[begin:end]
        one = np.repeat(np.arange(begin, end), size)
        two = one + 1 + np.arange(len(one)) - np.repeat(np.cumsum(size) - size, size)
        one, two = order[one], order[two]
        meet = ((lower[one] <= upper[two]) & (lower[two] <= upper[one])).all(axis=1)
        yield one[meet], two[meet]
        begin = end


def enclosed(lower: Floats, upper: Floats) -> tuple[Ints, Ints]:
    """Find the boxes that lie wholly inside others: the inner and the outer of each pair, (k,)."""
    found = [(np.empty(0, dtype=np.int64),) * 2]
    for one, two in overlapping(lower, upper):
        for inner, outer in ((one, two), (two, one)):
            inside = ((lower[outer] < lower[inner]) & (upper[inner] < upper[outer])).all(axis=1)
            found.append((inner[inside], outer[inside]))
    inner, outer = (np.concatenate(part) for part in zip(*found, strict=True))
    return inner, outer


def overlap_groups(lower: Floats, upper: Floats) -> list[Ints]:
    """Groups of two and more boxes that are connected by overlaps."""
    count = len(lower)
    first = np.arange(count)  # first box of each box's group so far
    for one, two in overlapping(lower, upper):
        ends = np.concatenate([one, np.arange(count)]), np.concatenate([two, first])
        links = coo_array((np.ones(len(ends[0]), dtype=np.int8), ends), shape=(count, count))
        _, part = connected_components(links, directed=False)
        _, found, inverse = np.unique(part, return_index=True, return_inverse=True)
        first = found[inverse]
    order = np.argsort(first, kind="stable")
    groups = np.split(order, np.flatnonzero(np.diff(first[order])) + 1)
    return [members for members in groups if len(members) > 1]


def estimated_overlaps(lower: Floats, upper: Floats, group: Ints) -> float:
    """Estimate the number of pairs of boxes of different groups that overlap.

    Evenly chosen boxes are compared with all others: all of them if there are few.

    Args:
        lower: Lower corner of each box (n, 3).
        upper: Upper corner of each box (n, 3).
        group: Group of each box (n,).
    """
    count = len(lower)
    samples = min(count, max(FEWEST_SAMPLES, SAMPLED // count))
    chosen = np.linspace(0, count - 1, samples).astype(np.int64)
    found = 0
    for box in chosen.tolist():
        meet = ((lower <= upper[box]) & (lower[box] <= upper)).all(axis=1)
        found += int((meet & (group != group[box])).sum())
    return found / samples * count / 2.0
