"""Measures of the grasp matrix: its singular values in the span of the grasp."""

import numpy as np

from grasp3d.arrays import Floats
from grasp3d.quality.measures.geometry import GraspGeometry
from grasp3d.quality.measures.metric import Measured

LEAST_RANK = 5
"""Rank of hard fingers on a line; below it contacts coincide, or have no friction."""


def smallest_singular_value(grasps: GraspGeometry) -> Measured:
    """Smallest singular value in the span of the grasp."""
    return _of_rank(grasps, _smallest(grasps))


def grasp_matrix_volume(grasps: GraspGeometry) -> Measured:
    """Product of the singular values in the span of the grasp."""
    values = grasps.singular_values
    product = np.where(values > 0.0, values, 1.0).prod(axis=1)
    return _of_rank(grasps, product)


def grasp_isotropy(grasps: GraspGeometry) -> Measured:
    """Smallest divided by largest singular value in the span of the grasp."""
    return _of_rank(grasps, _smallest(grasps) / grasps.singular_values[:, 0])


def _smallest(grasps: GraspGeometry) -> Floats:
    values = grasps.singular_values
    return np.asarray(np.where(values > 0.0, values, np.inf).min(axis=1))


def _of_rank(grasps: GraspGeometry, values: Floats) -> Measured:
    return Measured.of(
        values,
        *(
            (grasps.rank == rank, f"the grasp matrix has rank {rank}, less than {LEAST_RANK}")
            for rank in range(LEAST_RANK)
        ),
    )
