"""Intervals of fractions and of measures of ranking."""

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


def bootstrap(measures: Sequence[Measure], clusters: Ints, *, resamples: int, seed: int) -> Floats:
    """Percentile intervals of measures at 95 %, from the same resamples for all of them.

    Args:
        measures: The measures.
        clusters: Cluster of each grasp, shape (n,).
        resamples: Number of resamples; those in which a measure is nan are left out of its
            interval.
        seed: Seed of the draws.

    Returns:
        Low and high ends of each measure, shape (m, 2); nan without any resample with a value.

    Example:
        The mean of ten numbers, drawn one by one:

        >>> import numpy as np
        >>> from grasp3d.validating.intervals import bootstrap
        >>> values = np.arange(10.0)
        >>> mean = lambda weights: float(np.average(values, weights=weights))
        >>> ends = bootstrap([mean], np.arange(10), resamples=1000, seed=0)
        >>> bool(2.0 < ends[0, 0] < 3.5 and 5.5 < ends[0, 1] < 7.0)
        True
    """
    rows: list[Floats] = []
    for weights in resampled_weights(clusters, resamples, seed):
        rows.append(np.ravel([measure(weights) for measure in measures]))
        report_progress(len(rows) / resamples)
    values = np.stack(rows, axis=1)
    ends = np.full((len(values), 2), np.nan)
    defined = ~np.isnan(values).all(axis=1)
    tail = 0.5 * (1.0 - LEVEL)
    if defined.any():
        ends[defined] = np.nanquantile(values[defined], [tail, 1.0 - tail], axis=1).T
    return ends
