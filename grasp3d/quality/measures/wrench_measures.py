"""Measures of the primitive wrenches: volume of their hull, min-weight metric."""

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from grasp3d.arrays import Floats
from grasp3d.quality.measures.geometry import GraspGeometry
from grasp3d.quality.measures.linear_programs import Program, solve
from grasp3d.quality.measures.matrix_measures import LEAST_RANK
from grasp3d.quality.measures.metric import Measured

BESIDE_ORIGIN = 1e-9
"""Part of the vector of ones outside the wrenches' column space from which weights exist."""


def wrench_space_volume(grasps: GraspGeometry) -> Measured:
    """Volume of the hull of the primitive wrenches in their span."""
    span_rank = (grasps.primitive_span.sizes > 0.0).sum(axis=1)
    values = np.full(grasps.size, np.nan)
    for row in np.flatnonzero(span_rank >= LEAST_RANK):
        values[row] = _hull_volume(grasps.primitives[row], int(span_rank[row]))
    return Measured.of(
        values,
        *(
            (span_rank == rank, f"the wrenches span {rank} dimensions, less than {LEAST_RANK}")
            for rank in range(LEAST_RANK)
        ),
        (np.isnan(values), "the hull of the wrenches is too flat"),
    )


def _hull_volume(rows: Floats, rank: int) -> float:
    """Volume in the span of wrenches (k, 6); nan if Qhull finds them too flat."""
    # In coordinates in which the hull extends alike in all directions: Qhull's tolerances are
    # those of its longest.
    left, sizes, _ = np.linalg.svd(rows, full_matrices=False)
    try:
        volume = ConvexHull(left[:, :rank]).volume
    except QhullError:
        return float("nan")
    return float(volume * sizes[:rank].prod())


def min_weight(grasps: GraspGeometry) -> Measured:
    """Largest smallest weight of a combination of the primitive wrenches that is 0."""
    coordinates, used = grasps.primitive_span.rows, grasps.used_primitives
    ones = used.astype(np.float64)
    inside = (coordinates @ (np.swapaxes(coordinates, 1, 2) @ ones[..., None]))[..., 0]
    beside = np.linalg.norm(ones - inside, axis=1) <= BESIDE_ORIGIN * np.sqrt(used.sum(axis=1))
    open_rows = np.flatnonzero(~beside & ~grasps.at_one_point)
    values = np.full(grasps.size, np.nan)
    values[open_rows] = solve([_weights_of(coordinates[k][used[k]]) for k in open_rows])
    return Measured.of(
        values,
        (grasps.at_one_point, "all contacts are at one point"),
        (beside, "no weights of sum 1 balance the primitive wrenches"),
        (np.isnan(values), "the linear program was not solved"),
    )


def _weights_of(rows: Floats) -> Program:
    """Unknowns: the smallest weight, and by how much each weight exceeds it."""
    scaled = rows * np.sqrt(len(rows))  # rows of size 1
    balance = np.vstack([scaled.sum(axis=0), scaled]).T  # (6, 1 + k)
    balance = balance[np.any(scaled != 0.0, axis=0)]
    total = np.concatenate([[float(len(rows))], np.ones(len(rows))])
    return Program(
        equal=np.vstack([balance, total]),
        given=np.concatenate([np.zeros(len(balance)), [1.0]]),
        below=np.zeros((0, 1 + len(rows))),
        least=np.concatenate([[-np.inf], np.zeros(len(rows))]),
        most=np.full(1 + len(rows), np.inf),
    )
