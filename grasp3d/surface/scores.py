"""The one number of a grasp, by which lists and files are sorted."""

import math

import numpy as np

from grasp3d.arrays import Bytes, Floats, locked


def written_scores(label: Bytes, quality: Floats) -> Floats:
    """(l + (1 + s) / 2) / 3, from 0 to 1: U up to 1/3, M up to 2/3, S above; shape (b,).

    Args:
        label: `Label` codes l of everything that is stated: U 0, M 1, S 2.
        quality: How far each grasp is from failing, s, from -1 to 1.
    """
    return locked((label + 0.5 * (1.0 + np.clip(quality, -1.0, 1.0))) / 3.0)


def quality_of_contacts(margin: Floats, held: Floats) -> Floats:
    """How far contacts are from failing, from -1 to 1, shape (b,).

    Margin over pi where it is negative, else m / (1 + m).

    Args:
        margin: Friction angle to spare [rad].
        held: m: what they hold over what must be held, or epsilon where that is not known.
    """
    with np.errstate(divide="ignore"):
        share = 1.0 - 1.0 / (1.0 + np.nan_to_num(held, nan=0.0, posinf=math.inf))
    return np.where(margin < 0.0, np.maximum(margin / math.pi, -1.0), share)
