"""Colours of margins, on both sides of 0."""

import numpy as np
from matplotlib import colormaps

from grasp3d.arrays import Bytes, Floats
from grasp3d.settings import GraspModel

STEPS = 256
"""Number of colours."""

_SIDES = np.concatenate([np.linspace(0.0, 0.4, STEPS // 2), np.linspace(0.6, 1.0, STEPS // 2)])
BOTH_SIDES = np.array(colormaps["BrBG"](_SIDES)[:, :3] * 255.0, dtype=np.uint8)
"""Colours of values on both sides of 0, brown below and green above, shape (STEPS, 3).

They jump at 0, so that the border is sharp and none is grey.
"""


def most_margin(model: GraspModel) -> float:
    """Margin that has the last colour [rad]; its negative has the first one."""
    return model.friction_angle


def margin_colors(margins: Floats, model: GraspModel) -> Bytes:
    """Red, green and blue of margins [rad], shape (n, 3)."""
    values = 0.5 + margins / (2.0 * most_margin(model))
    return np.asarray(BOTH_SIDES[np.clip(values * STEPS, 0, STEPS - 1).astype(int)])
