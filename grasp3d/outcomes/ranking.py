"""How well a score ranks grasps that held above grasps that failed."""

import math

import numpy as np
from scipy.special import expit, logit
from scipy.stats import rankdata, t

from grasp3d.arrays import Bools, Floats, Ints
from grasp3d.outcomes.success import LEVEL


def roc_auc(held: Bools, scores: Floats, clusters: Ints) -> tuple[float, float, float]:
    """The area under the ROC curve, with its interval at 95 %.

    The area is the probability that a grasp that held has a better score than one that failed;
    equal scores count half (Mann & Whitney 1947). Its variance is that of DeLong et al. 1988, and
    where grasps come in clusters, such as those on one object, of Obuchowski 1997: grasps of a
    cluster are alike, so only other clusters say how much areas differ. The interval is that of
    Student's t in the logit of the area.

    Args:
        held: Whether each grasp held, shape (n,).
        scores: Larger is better; -inf is the worst, nan is not allowed; shape (n,).
        clusters: Number of the cluster of each grasp, from 0, shape (n,); `arange(n)`: each is one.

    Returns:
        Area and both ends; nan where all outcomes are the same. The ends are 0 and 1 where an
        outcome is of a single cluster, and the area itself where it is 0 or 1.

    Example:
        Two of three grasps that held have a better score than both that failed:

        >>> import numpy as np
        >>> from grasp3d.outcomes.ranking import roc_auc
        >>> held = np.array([True, True, False, True, False])
        >>> area, low, high = roc_auc(held, np.array([0.9, 0.8, 0.7, 0.6, 0.5]), np.arange(5))
        >>> round(area, 4)
        0.8333
    """
    kinds = [held, ~held]
    if not all(kind.any() for kind in kinds):
        return math.nan, math.nan, math.nan
    # In single precision scores that differ by rounding, as of symmetric grasps, are equal.
    compared = scores.astype(np.float32)
    below = rankdata(compared)  # how many of the other outcome are worse, of equal ones half
    for kind in kinds:
        below[kind] -= rankdata(compared[kind])
    shares = [below[held] / kinds[1].sum(), 1.0 - below[~held] / kinds[0].sum()]
    area = float(shares[0].mean())
    counts = [len(np.unique(clusters[kind])) for kind in kinds]
    if area in (0.0, 1.0):
        return area, area, area
    if min(counts) == 1:
        return area, 0.0, 1.0
    every, most = len(np.unique(clusters)), int(clusters.max()) + 1
    parts = [np.bincount(clusters[kind], share - area, most) / len(share)
             for kind, share in zip(kinds, shares, strict=True)]  # fmt: skip
    own = (n / (n - 1) * float(part @ part) for part, n in zip(parts, counts, strict=True))
    variance = sum(own) + 2.0 * every / (every - 1) * float(parts[0] @ parts[1])
    spread = float(t.ppf(0.5 + 0.5 * LEVEL, min(counts) - 1)) * math.sqrt(max(variance, 0.0))
    low, high = expit(logit(area) + np.array([-1.0, 1.0]) * spread / (area * (1.0 - area))).tolist()
    return area, low, high


def roc_curve(held: Bools, scores: Floats) -> tuple[Floats, Floats]:
    """Fractions of the failed and of the held grasps that thresholds accept, from none to all.

    Args:
        held: Whether each grasp held, shape (n,), of both kinds.
        scores: As for `roc_auc`.

    Returns:
        Both of shape (m + 1,), for m different scores.
    """
    _, group = np.unique(-scores.astype(np.float32), return_inverse=True)
    failed, right = (
        np.append(0.0, np.cumsum(np.bincount(group, kind))) / kind.sum() for kind in (~held, held)
    )
    return failed, right
