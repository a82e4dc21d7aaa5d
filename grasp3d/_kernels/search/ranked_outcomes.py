"""How well a score ranks outcomes, from the numbers of both in each group of equal scores."""

import math

from grasp3d._kernels.compiling import kernel


@kernel("Ints1, Ints1, Bools1 | FixedBools1, Ints1")
def rank_outcomes(order, starts, held, weights):
    """Area under the ROC curve, and average precision.

    Args:
        order: Grasps from the best score to the worst (n,).
        starts: Where each group of equal scores begins in that order (g,).
        held: Whether each grasp held (n,).
        weights: How often each counts (n,).

    Returns:
        Both; the first is nan where all outcomes are the same, the second where none held.
    """
    all_held, all_failed, lost, precision = 0.0, 0.0, 0.0, 0.0
    for g in range(starts.shape[0]):
        last = starts[g + 1] if g + 1 < starts.shape[0] else order.shape[0]
        good, bad = 0.0, 0.0
        for i in range(starts[g], last):
            times = weights[order[i]]
            good += held[order[i]] * times  # without a branch, which chance would mispredict
            bad += (1 - held[order[i]]) * times
        all_held, all_failed = all_held + good, all_failed + bad
        lost += good * (all_failed - 0.5 * bad)
        precision += good * (all_held / max(all_held + all_failed, 1.0))
    pairs = all_held * all_failed
    area = (pairs - lost) / pairs if pairs > 0.0 else math.nan
    return area, precision / all_held if all_held > 0.0 else math.nan
