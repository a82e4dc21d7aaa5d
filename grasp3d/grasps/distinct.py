"""Which grasps are distinct from others: whose contacts are not near theirs."""

import itertools
from functools import reduce

import numpy as np

from grasp3d.arrays import Floats, Ints
from grasp3d.mesh import ObjectMesh

DISTINCT = 1.0 / 8.0
"""Distance of corresponding contacts, in object sizes, from which grasps are distinct."""

MOST_DISTINCT = 1000
"""Distinct grasps that are found at most."""

MAX_PERMUTED = 5
"""Most contacts of grasps whose contacts are matched in every order."""


def distance_of_distinct(mesh: ObjectMesh) -> float:
    """Default distance from which grasps are distinct, in the mesh's unit."""
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
    squares = np.add.reduce(gaps * gaps, axis=3)  # (b, n, n)
    indices = tuple(range(len(other)))
    orders = itertools.permutations(indices) if len(other) <= MAX_PERMUTED else [indices]
    farthest = (reduce(np.maximum, (squares[:, i, order[i]] for i in indices)) for order in orders)
    return np.asarray(np.sqrt(reduce(np.minimum, farthest)))
