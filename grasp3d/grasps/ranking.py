"""Which grasp is to be taken first: the one order of grasps, for lists, tables and pictures."""

import numpy as np

from grasp3d.arrays import Ints
from grasp3d.surface.labelled_grasps import LabelledGrasps


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
