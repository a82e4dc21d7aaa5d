"""Success rates of grasps, with confidence intervals."""

from dataclasses import dataclass

import numpy as np
from scipy.stats import binomtest

from grasp3d.arrays import Bools

LEVEL = 0.95
"""Confidence level of all intervals."""


@dataclass(frozen=True)
class SuccessRate:
    """Number of grasps that succeeded, of a set of grasps.

    Example:
        >>> from grasp3d.outcomes import SuccessRate
        >>> rate = SuccessRate("S", 20, 19)
        >>> print("{:.2f}, from {:.2f} to {:.2f}".format(rate.rate, *rate.interval))
        0.95, from 0.76 to 0.99
    """

    name: str
    """Name of the set of grasps."""
    count: int
    successes: int

    @property
    def rate(self) -> float:
        """Fraction that succeeded; nan if there are no grasps."""
        return self.successes / self.count if self.count else float("nan")

    @property
    def interval(self) -> tuple[float, float]:
        """Wilson's interval (JASA 1927) at 95 %; 0 and 1 if there are no grasps."""
        if not self.count:
            return 0.0, 1.0
        found = binomtest(self.successes, self.count).proportion_ci(LEVEL, method="wilson")
        return float(found.low), float(found.high)


def success_rate(name: str, success: Bools) -> SuccessRate:
    """Return the success rate of some grasps.

    Args:
        name: Name of the set of grasps.
        success: Whether each succeeded, shape (k,).
    """
    return SuccessRate(name, len(success), int(np.count_nonzero(success)))
