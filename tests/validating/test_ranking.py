import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import mannwhitneyu

from grasp3d.validating.ranking import RankedOutcomes

SEED, COUNT = st.integers(0, 2**32), st.integers(1, 40)


def drawn(seed: int, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Outcomes and scores with ties and infinite values."""
    random = np.random.default_rng(seed)
    scores = np.round(random.normal(size=count), 1)
    scores[random.random(count) < 0.2] = -np.inf
    return random.random(count) < 0.5, scores


def auc_of_pairs(held: np.ndarray, scores: np.ndarray) -> float:
    pairs = [
        1.0 if one > two else 0.5 if one == two else 0.0
        for one in scores[held]
        for two in scores[~held]
    ]
    return float(np.mean(pairs)) if pairs else math.nan


def precision_over_thresholds(held: np.ndarray, scores: np.ndarray) -> float:
    """Average precision, threshold by threshold."""
    found, recall = 0.0, 0.0
    for threshold in sorted(set(scores.tolist()), reverse=True):
        accepted = scores >= threshold
        reached = held[accepted].sum() / held.sum() if held.any() else math.nan
        found += (reached - recall) * held[accepted].mean()
        recall = reached
    return found


@settings(deadline=None)  # the kernel is read, or compiled, at its first call
@given(SEED, COUNT)
def test_the_area_counts_pairs(seed: int, count: int) -> None:
    held, scores = drawn(seed, count)
    found = RankedOutcomes.of(held, scores)
    np.testing.assert_allclose(found.roc_auc(), auc_of_pairs(held, scores), atol=1e-12)
    expected = precision_over_thresholds(held, scores)
    np.testing.assert_allclose(found.average_precision(), expected, atol=1e-12)


def test_the_area_is_the_statistic_of_mann_and_whitney() -> None:
    held, scores = drawn(1, 300)
    statistic = mannwhitneyu(scores[held], scores[~held]).statistic
    area = RankedOutcomes.of(held, scores).roc_auc()
    assert area == pytest.approx(statistic / (held.sum() * (~held).sum()), abs=1e-12)


def test_published_examples() -> None:
    """Fawcett 2006, Fig. 3: 20 instances; and the example of scikit-learn's documentation."""
    kinds = np.array([kind == "p" for kind in "ppnpppnnpnpnpnnnpnpn"])
    found = RankedOutcomes.of(kinds, -np.arange(20.0))
    assert found.roc_auc() == pytest.approx(0.68)
    four = RankedOutcomes.of(np.array([False, False, True, True]), np.array([0.1, 0.4, 0.35, 0.8]))
    assert four.roc_auc() == 0.75
    assert four.average_precision() == pytest.approx(0.8333, abs=1e-4)


@settings(deadline=None)  # the kernel is read, or compiled, at its first call
@given(SEED, COUNT)
def test_weights_count_as_repeated_grasps(seed: int, count: int) -> None:
    held, scores = drawn(seed, count)
    weights = np.random.default_rng(seed + 1).integers(0, 4, count)
    one = RankedOutcomes.of(held, scores)
    other = RankedOutcomes.of(np.repeat(held, weights), np.repeat(scores, weights))
    np.testing.assert_allclose(one.roc_auc(weights), other.roc_auc(), atol=1e-12)
    precision = one.average_precision(weights)
    np.testing.assert_allclose(precision, other.average_precision(), atol=1e-12)


@settings(deadline=None)  # the kernel is read, or compiled, at its first call
@given(SEED, COUNT)
def test_only_the_order_matters_and_the_reverse_is_the_rest(seed: int, count: int) -> None:
    held, scores = drawn(seed, count)
    area = RankedOutcomes.of(held, scores).roc_auc()
    assert RankedOutcomes.of(held, np.arctan(scores)).roc_auc() == pytest.approx(area, nan_ok=True)
    reverse = RankedOutcomes.of(held, -scores).roc_auc()
    assert reverse == pytest.approx(1.0 - area, nan_ok=True)


@settings(deadline=None)  # the kernel is read, or compiled, at its first call
@given(SEED, COUNT)
def test_the_curve_encloses_the_area(seed: int, count: int) -> None:
    held, scores = drawn(seed, count)
    found = RankedOutcomes.of(held, scores)
    failed, right = found.roc_curve()
    if math.isnan(found.roc_auc()):
        assert np.isnan(failed[-1]) or np.isnan(right[-1])
        return
    assert (failed[0], right[0], failed[-1], right[-1]) == (0.0, 0.0, 1.0, 1.0)
    assert np.trapezoid(right, failed) == pytest.approx(found.roc_auc())


def test_nothing_is_ranked_without_both_outcomes() -> None:
    scores = np.array([1.0, 2.0])
    assert math.isnan(RankedOutcomes.of(np.array([True, True]), scores).roc_auc())
    failed = RankedOutcomes.of(np.array([False, False]), scores)
    assert math.isnan(failed.roc_auc())
    assert math.isnan(failed.average_precision())
    none = RankedOutcomes.of(np.zeros(0, bool), np.zeros(0))
    assert math.isnan(none.roc_auc())


def test_scores_that_differ_by_rounding_are_equal() -> None:
    held = np.array([True, False, True, False])
    scores = 0.1 * np.ones(4) + np.array([2e-17, 4e-17, -2e-17, 0.0])
    assert len(set(scores.tolist())) > 1
    assert RankedOutcomes.of(held, scores).roc_auc() == 0.5
