"""Contacts that coincide, or lie on a line, exactly or nearly."""

import itertools

import numpy as np

from grasp3d.arrays import Bools, Floats

NEARLY = 1e-5
"""Distance relative to the grasp's size from which contacts are clearly apart, or off a line."""

ROUNDED = 16.0 * np.finfo(np.float64).eps
"""Distance from a line, relative to the grasp's size, that rounding of the coordinates explains."""


def clearly_placed(points: Floats) -> Bools:
    """Whether contacts that are close together coincide, and those near a line are on it.

    Then the grasp is as degenerate as it looks. Otherwise its wrenches depend on distances so small
    that what holds for them need not hold for coinciding contacts. Distances of contacts that are
    close together are exact, however small; that of contacts far apart from a line is not.

    Args:
        points: Contact points, shape (b, n, 3).

    Returns:
        Shape (b,).
    """
    apart = points[:, :, None] - points[:, None]  # (b, n, n, 3)
    distance = np.linalg.norm(apart, axis=-1)
    size = distance.max(axis=(1, 2))
    clear: Bools = ~((distance > 0.0) & (distance < NEARLY * size[:, None, None])).any(axis=(1, 2))
    for i, j, k in itertools.combinations(range(points.shape[1]), 3):
        # Twice the area of the triangle, over its longest side: its height.
        area = np.linalg.norm(np.cross(apart[:, i, j], apart[:, i, k]), axis=-1)
        longest = np.max([distance[:, i, j], distance[:, i, k], distance[:, j, k]], axis=0)
        clear &= (area <= ROUNDED * size * longest) | (area >= NEARLY * size * longest)
    return clear
