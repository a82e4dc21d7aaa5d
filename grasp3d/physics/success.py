"""Fractions of successes with intervals, over labels and margins."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.stats import binomtest

from grasp3d.arrays import ArrayLike, Bools, Floats

CONFIDENCE = 0.95
"""Of the intervals."""


@dataclass(frozen=True)
class SuccessRate:
    """How many of some grasps succeeded.

    Example:
        >>> from grasp3d.physics import SuccessRate
        >>> rate = SuccessRate("S", 20, 19)
        >>> print(f"{rate.rate:.2f}, from {rate.low:.2f} to {rate.high:.2f}")
        0.95, from 0.76 to 0.99
    """

    name: str
    """Which grasps."""
    count: int
    successes: int

    @property
    def rate(self) -> float:
        """Fraction that succeeded; nan: there are none."""
        return self.successes / self.count if self.count else float("nan")

    @property
    def low(self) -> float:
        """Lower end of Wilson's interval (JASA 1927) at 95 %."""
        return self._interval[0]

    @property
    def high(self) -> float:
        """Upper end of that interval."""
        return self._interval[1]

    @property
    def _interval(self) -> tuple[float, float]:
        if not self.count:
            return 0.0, 1.0
        found = binomtest(self.successes, self.count).proportion_ci(CONFIDENCE, method="wilson")
        return float(found.low), float(found.high)


def success_rate(name: str, success: Bools) -> SuccessRate:
    """Rate of some grasps.

    Args:
        name: Which grasps.
        success: Whether each succeeded, shape (k,).
    """
    return SuccessRate(name, len(success), int(np.count_nonzero(success)))


def rates_by(values: Floats, success: Bools, edges: ArrayLike) -> Iterator[SuccessRate]:
    """Rates in bins of a number, such as the margin in degrees.

    Args:
        values: The number of each grasp, shape (k,).
        success: Whether each succeeded, shape (k,).
        edges: Borders of the bins, in increasing order; the outer ones may be infinite.
    """
    borders = np.asarray(edges, dtype=np.float64)
    for low, high in pairwise(borders.tolist()):
        chosen = (values >= low) & (values < high)
        yield success_rate(_name(low, high), success[chosen])


def _name(low: float, high: float) -> str:
    if math.isinf(low):
        return f"below {high:g}"
    return f"from {low:g}" if math.isinf(high) else f"{low:g} to {high:g}"
