"""Intervals of fractions and of measures of ranking."""

import math
from collections.abc import Callable, Iterator, Sequence

import numpy as np
from scipy.stats import binomtest

from grasp3d.arrays import Floats, Ints
from grasp3d.system.context import report_progress

LEVEL = 0.95
"""Confidence level of all intervals."""

FEW_OBJECTS = 10
"""Objects below which intervals by object are too narrow: their spread is estimated from few."""

Measure = Callable[[Ints], float | Sequence[float]]
"""A measure, or several, of grasps that count as often as weights (n,) state."""


def wilson(held: int, count: int) -> tuple[float, float]:
    """Interval of a probability at 95 % (Wilson 1927).

    Args:
        held: Successes.
        count: Attempts.

    Returns:
        Both ends; 0 and 1 without attempts.

    Example:
        >>> from grasp3d.validating.intervals import wilson
        >>> print("{:.3f} {:.3f}".format(*wilson(9, 10)))
        0.596 0.982
    """
    if not count:
        return 0.0, 1.0
    interval = binomtest(held, count).proportion_ci(LEVEL, method="wilson")
    return float(interval.low), float(interval.high)


def resampled_weights(clusters: Ints, resamples: int, seed: int) -> Iterator[Ints]:
    """How often each grasp counts in each resample: clusters are drawn whole, with repetition.

    Grasps on one object are alike, so drawing them one by one would give intervals that are too
    narrow for other objects (Davison & Hinkley 1997, Sec. 3.8, without the second stage).

    Args:
        clusters: Cluster of each grasp, from 0, shape (n,); `arange(n)` draws single grasps.
        resamples: Number of resamples.
        seed: Seed of the draws; the same seed gives the same weights.
    """
    random, count = np.random.default_rng(seed), int(clusters.max(initial=-1)) + 1
    for _ in range(resamples):
        times = np.bincount(random.integers(count, size=count), minlength=count)
        yield times[clusters]


def resampled(measures: Sequence[Measure], clusters: Ints, *, resamples: int, seed: int) -> Floats:
    """Values of measures in resamples that all of them share.

    Args:
        measures: The measures.
        clusters: Cluster of each grasp, shape (n,).
        resamples: Number of resamples.
        seed: Seed of the draws.

    Returns:
        A row for each measure, or for each of its numbers, shape (m, resamples).

    Example:
        The mean of ten numbers, drawn one by one:

        >>> import numpy as np
        >>> from grasp3d.validating.intervals import interval_of, resampled
        >>> values = np.arange(10.0)
        >>> mean = lambda weights: float(np.average(values, weights=weights))
        >>> (means,) = resampled([mean], np.arange(10), resamples=1000, seed=0)
        >>> low, high = interval_of(means)
        >>> 2.0 < low < 3.5 and 5.5 < high < 7.0
        True
    """
    rows: list[Floats] = []
    for weights in resampled_weights(clusters, resamples, seed):
        rows.append(np.ravel([measure(weights) for measure in measures]))
        report_progress(len(rows) / resamples)
    return np.stack(rows, axis=1)


def interval_of(values: Floats) -> tuple[float, float]:
    """Percentile interval at 95 %; nan where no resample has a value.

    Args:
        values: A measure in resamples, shape (r,); nan is left out.
    """
    defined, tail = values[~np.isnan(values)], 0.5 * (1.0 - LEVEL)
    if not len(defined):
        return math.nan, math.nan
    low, high = np.quantile(defined, [tail, 1.0 - tail]).tolist()
    return low, high


def two_sided_p(values: Floats) -> float:
    """Probability that a difference as large, either way, is chance; nan: there are no values.

    It is at least 2 / (r + 1) (Davison & Hinkley 1997, Sec. 4.4), and 1 where all are 0.

    Args:
        values: The difference in resamples, shape (r,); nan is left out.
    """
    defined = values[~np.isnan(values)]
    if not len(defined):
        return math.nan
    beyond = min(int((defined <= 0.0).sum()), int((defined >= 0.0).sum()))
    return min(1.0, 2.0 * (beyond + 1) / (len(defined) + 1))
