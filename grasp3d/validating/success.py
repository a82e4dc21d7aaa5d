"""Success of grasps by label, over friction and sensor resolution, and by margin.

Calibration of the margin: success by margin, and margins from which on grasps hold.
"""

import math
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from scipy.optimize import isotonic_regression
from scipy.stats import spearmanr

from grasp3d.arrays import Bools, Bytes, Floats, short_repr
from grasp3d.settings import GraspModel
from grasp3d.stability.label import Label
from grasp3d.stability.thresholds import label_angles
from grasp3d.validating.intervals import wilson


@dataclass(frozen=True)
class MarginBin:
    """Grasps whose margins are in an interval.

    Example:
        >>> from grasp3d.validating import MarginBin
        >>> one = MarginBin(low=0.1, high=0.2, mean=0.15, count=20, held=18)
        >>> one.fraction, tuple(round(end, 2) for end in one.interval)
        (0.9, (0.7, 0.97))
    """

    low: float
    """Smallest margin in it [rad]."""
    high: float
    """Largest margin in it [rad]."""
    mean: float
    """[rad]"""
    count: int
    held: int

    @property
    def fraction(self) -> float:
        """Fraction that held."""
        return self.held / self.count

    @property
    def interval(self) -> tuple[float, float]:
        """Interval of the probability to hold, at 95 % (Wilson 1927)."""
        return wilson(self.held, self.count)


@dataclass(frozen=True)
class MarginThreshold:
    """What accepting the grasps of at least some margin would have given."""

    margin: float
    """[rad]; nan: no margin has the property; -inf: all grasps are accepted."""
    accepted: int
    """Grasps with at least this margin."""
    held: int
    """Those of them that held."""
    sensitivity: float
    """Fraction of the grasps that held which is accepted."""
    specificity: float
    """Fraction of the grasps that failed which is refused."""


@dataclass(frozen=True, eq=False)
class Calibration:
    """Success by margin.

    Grasps whose jaws do not close have no margin: they count as less than any, and are not in the
    bins.
    """

    bins: tuple[MarginBin, ...]
    """By increasing margin; each has about as many grasps, but equal margins stay together."""
    margins: Floats
    """Distinct margins [rad], increasing, shape (m,)."""
    fitted: Floats
    """Success there by isotonic regression: the nearest that never falls, shape (m,)."""
    rank_correlation: float
    """Spearman's coefficient of margin and outcome over all grasps; nan: all are equal."""
    youden: MarginThreshold
    """The margin with the largest sum of sensitivity and specificity (Youden 1950)."""
    target: float
    """Fraction of the accepted grasps that shall hold."""
    reached: MarginThreshold
    """The smallest margin from which on at least that fraction held."""

    __repr__ = short_repr

    @property
    def is_monotone(self) -> bool:
        """Whether no bin has less success than the one before it beyond chance.

        Beyond chance: their intervals at 95 % do not overlap.
        """
        return not any(two.interval[1] < one.interval[0] for one, two in pairwise(self.bins))

    @property
    def falls(self) -> int:
        """Number of bins with less success than the one before, beyond chance or not."""
        return sum(two.fraction < one.fraction for one, two in pairwise(self.bins))


def calibrate(held: Bools, margins: Floats, *, bins: int, target: float) -> Calibration:
    """Measure success by margin.

    Both thresholds are chosen on these grasps, so new ones will do slightly worse.

    Args:
        held: Whether each grasp held, shape (n,).
        margins: Margins [rad], shape (n,); nan: the jaws do not close.
        bins: Number of bins.
        target: Fraction of the accepted grasps that shall hold.

    Example:
        >>> import numpy as np
        >>> from grasp3d.validating.success import calibrate
        >>> margins = np.array([-0.2, -0.1, 0.1, 0.2, 0.3, np.nan])
        >>> held = np.array([False, False, True, False, True, False])
        >>> calibration = calibrate(held, margins, bins=2, target=0.6)
        >>> [(one.count, one.held) for one in calibration.bins], calibration.youden.margin
        ([(3, 1), (2, 1)], 0.1)
    """
    closed = ~np.isnan(margins)
    finite, outcome = margins[closed], held[closed]
    distinct, group = np.unique(finite, return_inverse=True)
    total = np.bincount(group, minlength=len(distinct)).astype(np.float64)
    success = np.bincount(group, weights=outcome, minlength=len(distinct))
    # Of the grasps with at least each margin, how many there are and how many held, (m,) each.
    accepted, successes = (np.cumsum(each[::-1])[::-1] for each in (total, success))
    sums = successes / max(held.sum(), 1) - (accepted - successes) / max((~held).sum(), 1)
    # The best threshold, the smallest of several.
    both = 0 < held.sum() < len(held) and len(sums) > 0
    best = distinct[np.argmax(sums)] if both else math.nan
    # The smallest threshold from which on the target is reached: all grasps, or those of a margin.
    reaching = distinct[successes >= target * accepted]
    if len(held) and held.mean() >= target:
        least = -math.inf
    else:
        least = reaching[0] if len(reaching) else math.nan
    fitted = success / total
    if len(distinct):
        fitted = isotonic_regression(fitted, weights=total).x
    return Calibration(
        bins=_bins(finite, outcome, bins),
        margins=distinct,
        fitted=fitted,
        rank_correlation=_rank_correlation(held, margins),
        youden=_threshold(held, margins, float(best)),
        target=target,
        reached=_threshold(held, margins, float(least)),
    )


def _bins(margins: Floats, held: Bools, count: int) -> tuple[MarginBin, ...]:
    """Bins between quantiles, of grasps whose jaws close."""
    if not len(margins):
        return ()
    edges = np.unique(np.quantile(margins, np.linspace(0.0, 1.0, count + 1)[1:-1]))
    number = np.searchsorted(edges, margins, side="left")
    return tuple(
        MarginBin(
            low=float(margins[inside].min()),
            high=float(margins[inside].max()),
            mean=float(margins[inside].mean()),
            count=int(inside.sum()),
            held=int(held[inside].sum()),
        )
        for index in range(len(edges) + 1)
        if (inside := number == index).any()
    )


def _rank_correlation(held: Bools, margins: Floats) -> float:
    values = np.where(np.isnan(margins), -math.inf, margins)
    if held.all() or not held.any() or (values == values[0]).all():
        return math.nan
    # Ranks of infinite values are fine, but scipy would compute with the values themselves.
    _, ranks = np.unique(values, return_inverse=True)
    return float(spearmanr(ranks, held).statistic)


def _threshold(held: Bools, margins: Floats, margin: float) -> MarginThreshold:
    """What a threshold would have given; nan accepts nothing."""
    accepted = np.where(np.isnan(margins), -math.inf, margins) >= margin
    failed = ~held
    return MarginThreshold(
        margin=margin,
        accepted=int(accepted.sum()),
        held=int((accepted & held).sum()),
        sensitivity=float(accepted[held].mean()) if held.any() else math.nan,
        specificity=float((~accepted)[failed].mean()) if failed.any() else math.nan,
    )


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
        worst: Upper bounds of the critical angles, over the worst normals and locations [rad],
            shape (n,); nan: the jaws do not close.
        best: The same over the best normals and locations.
        model: All other uncertainties.
        friction: Coefficient of friction.
        resolution: Sensor resolution [rad].

    Raises:
        SettingError: The model's error of friction is not below the friction.
    """
    changed = replace(model, friction=friction, sensor_resolution=resolution)
    codes = label_angles(worst, best, changed)
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
    counts, successes = (
        tuple(np.bincount(some, minlength=len(Label)).tolist()) for some in (codes, codes[held])
    )
    return LabelSuccess(friction, resolution, counts, successes)
