"""Success of the grasps labelled S, M and U, over friction and sensor resolution."""

import math
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from grasp3d.arrays import Bools, Bytes, Floats
from grasp3d.settings import GraspModel
from grasp3d.stability.label import Label
from grasp3d.stability.thresholds import label_angles
from grasp3d.validating.intervals import wilson


@dataclass(frozen=True)
class LabelSuccess:
    """How many grasps of each label held, at one friction and sensor resolution.

    Example:
        >>> from grasp3d.validating import LabelSuccess
        >>> one = LabelSuccess(0.5, 0.4, counts=(20, 0, 80), held=(1, 0, 72))
        >>> one.fraction("S"), one.is_ordered
        (0.9, True)
    """

    friction: float
    sensor_resolution: float
    """[rad]"""
    counts: tuple[int, int, int]
    """Grasps labelled U, M and S, the order of `Label`; those whose jaws do not close are U."""
    held: tuple[int, int, int]
    """How many of them held."""

    def fraction(self, label: str) -> float:
        """Fraction of the grasps with a label that held; nan: there are none.

        Args:
            label: S, M or U.
        """
        code = Label[label]
        return self.held[code] / self.counts[code] if self.counts[code] else math.nan

    def interval(self, label: str) -> tuple[float, float]:
        """Interval of that probability at 95 % (Wilson 1927).

        Args:
            label: S, M or U.
        """
        code = Label[label]
        return wilson(self.held[code], self.counts[code])

    @property
    def is_ordered(self) -> bool:
        """Whether success falls from S to M to U, over the labels that grasps have."""
        filled = [self.fraction(label.name) for label in sorted(Label) if self.counts[label]]
        return all(low < high for low, high in pairwise(filled))


def labels_at(
    worst: Floats, best: Floats, model: GraspModel, friction: float, resolution: float
) -> Bytes:
    """Label codes at another friction and resolution: thresholds, nothing is computed again.

    Args:
        worst: Located angles over the worst normals and locations [rad], shape (n,); nan: the jaws
            do not close.
        best: The same over the best ones.
        model: All other uncertainties.
        friction: Coefficient of friction.
        resolution: Sensor resolution [rad].

    Raises:
        SettingError: The model's error of friction is not below the friction.
    """
    used = replace(model, friction=friction, sensor_resolution=resolution)
    codes = label_angles(worst, best, used)
    codes[np.isnan(worst)] = Label.U
    return codes


def label_success(held: Bools, codes: Bytes, friction: float, resolution: float) -> LabelSuccess:
    """Count the grasps of each label, and those of them that held.

    Args:
        held: Whether each grasp held, shape (n,).
        codes: `Label` codes, shape (n,).
        friction: Coefficient of friction of the labels.
        resolution: Their sensor resolution [rad].
    """
    counts = np.bincount(codes, minlength=len(Label)).tolist()
    successes = np.bincount(codes[held], minlength=len(Label)).tolist()
    return LabelSuccess(
        friction,
        resolution,
        (counts[0], counts[1], counts[2]),
        (successes[0], successes[1], successes[2]),
    )
