"""How well a score ranks grasps that held above grasps that failed."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.stats import rankdata

from grasp3d._kernels.search.ranked_outcomes import rank_outcomes
from grasp3d.arrays import Bools, Floats, Ints


@dataclass(frozen=True, eq=False)
class RankedOutcomes:
    """Outcomes of grasps in the order of a score; equal scores are one group.

    Example:
        Two of three grasps that held have a better score than both that failed:

        >>> import numpy as np
        >>> from grasp3d.validating.ranking import RankedOutcomes
        >>> held = np.array([True, True, False, True, False])
        >>> ranked = RankedOutcomes.of(held, np.array([0.9, 0.8, 0.7, 0.6, 0.5]))
        >>> round(ranked.roc_auc(), 4), round(ranked.average_precision(), 4)
        (0.8333, 0.9167)
    """

    held: Bools
    """Whether each grasp held, shape (n,)."""
    groups: Ints
    """Group of each grasp, 0 the best, shape (n,)."""

    @classmethod
    def of(cls, held: Bools, scores: Floats) -> "RankedOutcomes":
        """Rank grasps by a score of which larger values are better.

        Args:
            held: Whether each grasp held, shape (n,).
            scores: Shape (n,); -inf is the worst, nan is not allowed.
        """
        if not len(scores):
            return cls(held, np.zeros(0, dtype=np.int64))
        # In single precision scores that differ by rounding, as of symmetric grasps, are equal.
        compared = -scores.astype(np.float32)
        return cls(held, rankdata(compared, method="dense").astype(np.int64) - 1)

    @cached_property
    def _order(self) -> Ints:
        """Grasps from the best group to the worst, shape (n,)."""
        return np.argsort(self.groups, kind="stable")

    @cached_property
    def _starts(self) -> Ints:
        """Where each group begins in that order, shape (g,)."""
        return np.flatnonzero(np.diff(self.groups[self._order], prepend=-1))

    def measures(self, weights: Ints | None = None) -> tuple[float, float]:
        """The area under the ROC curve, and the average precision.

        The area is the probability that a held grasp ranks above a failed one; equal scores count
        half (Mann & Whitney 1947; Fawcett 2006, Sec. 7). The average precision is the sum of
        precision times gain of recall, over the groups, without interpolation: equal scores are
        accepted together.

        Args:
            weights: How often each grasp counts, shape (n,); None: once.

        Returns:
            From 0 to 1, nan where all outcomes are the same; and above 0, at most 1, the fraction
            that held for a score without information, nan where no grasp held.
        """
        each = np.ones(len(self.held), dtype=np.int64) if weights is None else weights
        area, precision = rank_outcomes(self._order, self._starts, self.held, each)
        return float(area), float(precision)

    def roc_auc(self, weights: Ints | None = None) -> float:
        """The area; see `measures`."""
        return self.measures(weights)[0]

    def average_precision(self, weights: Ints | None = None) -> float:
        """The average precision; see `measures`."""
        return self.measures(weights)[1]

    def roc_curve(self) -> tuple[Floats, Floats]:
        """Fractions of the failed and of the held grasps that are accepted, from none to all.

        Returns:
            Both of shape (g + 1,); nan where there are none.
        """
        held, failed = (
            np.bincount(self.groups, weights=outcomes) for outcomes in (self.held, ~self.held)
        )
        with np.errstate(invalid="ignore"):
            return (
                np.append(0.0, np.cumsum(failed)) / failed.sum(),
                np.append(0.0, np.cumsum(held)) / held.sum(),
            )
