"""How well a score ranks grasps that held above grasps that failed."""

import math
from dataclasses import dataclass

import numpy as np
from scipy.stats import rankdata

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

    def counts(self, weights: Ints | None = None) -> tuple[Floats, Floats]:
        """Grasps of each group that held, and that failed, from the best group, shape (g,) each.

        Args:
            weights: How often each grasp counts, shape (n,); None: once.
        """
        each = np.ones(len(self.held)) if weights is None else weights.astype(np.float64)
        held, failed = (
            np.asarray(np.bincount(self.groups, weights=each * outcomes), dtype=np.float64)
            for outcomes in (self.held, ~self.held)
        )
        return held, failed

    def roc_auc(self, weights: Ints | None = None) -> float:
        """Area under the ROC curve: the probability that a held grasp ranks above a failed one.

        Equal scores count half (Mann & Whitney 1947; Fawcett 2006, Sec. 7).

        Args:
            weights: How often each grasp counts, shape (n,); None: once.

        Returns:
            From 0 to 1; nan where all outcomes are the same.
        """
        held, failed = self.counts(weights)
        pairs = held.sum() * failed.sum()
        if not pairs:
            return math.nan
        below = failed.sum() - np.cumsum(failed)
        return float((held * (below + 0.5 * failed)).sum() / pairs)

    def average_precision(self, weights: Ints | None = None) -> float:
        """Average precision: the sum of precision times gain of recall, over the groups.

        Without interpolation; equal scores are accepted together.

        Args:
            weights: How often each grasp counts, shape (n,); None: once.

        Returns:
            Above 0, at most 1; the fraction that held for a score without information; nan where
            no grasp held.
        """
        held, failed = self.counts(weights)
        total = held.sum()
        if not total:
            return math.nan
        accepted = np.cumsum(held + failed)
        precision = np.cumsum(held) / np.maximum(accepted, 1.0)
        return float((precision * held).sum() / total)

    def roc_curve(self) -> tuple[Floats, Floats]:
        """Fractions of the failed and of the held grasps that are accepted, from none to all.

        Returns:
            Both of shape (g + 1,); nan where there are none.
        """
        held, failed = self.counts()
        with np.errstate(invalid="ignore"):
            return (
                np.append(0.0, np.cumsum(failed)) / failed.sum(),
                np.append(0.0, np.cumsum(held)) / held.sum(),
            )
