"""How many of some grasps succeeded, with the interval of the probability."""

from dataclasses import dataclass

import numpy as np
from scipy.stats import binomtest

from grasp3d.arrays import Bools

LEVEL = 0.95
"""Confidence level of all intervals."""


@dataclass(frozen=True)
class SuccessRate:
    """How many of some grasps succeeded.

    Example:
        >>> from grasp3d.outcomes import SuccessRate
        >>> rate = SuccessRate("S", 20, 19)
        >>> print("{:.2f}, from {:.2f} to {:.2f}".format(rate.rate, *rate.interval))
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
    def interval(self) -> tuple[float, float]:
        """Wilson's interval (JASA 1927) at 95 %; 0 and 1 where there are none."""
        if not self.count:
            return 0.0, 1.0
        found = binomtest(self.successes, self.count).proportion_ci(LEVEL, method="wilson")
        return float(found.low), float(found.high)


def success_rate(name: str, success: Bools) -> SuccessRate:
    """Rate of some grasps.

    Args:
        name: Which grasps.
        success: Whether each succeeded, shape (k,).
    """
    return SuccessRate(name, len(success), int(np.count_nonzero(success)))
