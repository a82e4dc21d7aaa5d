import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from grasp3d.validating.success import calibrate

SEED, COUNT = st.integers(0, 2**32), st.integers(1, 30)


def drawn(seed: int, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Outcomes and margins with ties, some without margin."""
    random = np.random.default_rng(seed)
    margins = np.round(random.normal(0.0, 0.3, count), 1)
    margins[random.random(count) < 0.2] = np.nan
    return random.random(count) < 0.5, margins


@given(SEED, COUNT, st.integers(2, 6))
def test_bins_contain_each_grasp_once_in_order(seed: int, count: int, bins: int) -> None:
    held, margins = drawn(seed, count)
    found = calibrate(held, margins, bins=bins, target=0.9).bins
    closed = ~np.isnan(margins)
    assert sum(one.count for one in found) == closed.sum()
    assert sum(one.held for one in found) == held[closed].sum()
    assert len(found) <= bins
    for one, two in pairwise(found):
        assert one.high < two.low  # equal margins are in one bin
    for one in found:
        inside = (margins >= one.low) & (margins <= one.high)
        assert one.count == inside.sum()
        assert one.mean == pytest.approx(margins[inside].mean())


def test_bins_of_distinct_margins_are_of_one_size() -> None:
    margins = np.random.default_rng(0).normal(size=1000)
    found = calibrate(margins > 0.0, margins, bins=10, target=0.9).bins
    assert [one.count for one in found] == [100] * 10


@given(SEED, COUNT)
def test_the_fit_is_the_isotonic_regression(seed: int, count: int) -> None:
    """By its formula of maxima and minima of means (Robertson et al. 1988, Sec. 1.4)."""
    held, margins = drawn(seed, count)
    found = calibrate(held, margins, bins=2, target=0.9)
    size = len(found.margins)
    for k in range(size):
        expected = max(
            min(
                held[(margins >= found.margins[i]) & (margins <= found.margins[j])].mean()
                for j in range(k, size)
            )
            for i in range(k + 1)
        )
        assert found.fitted[k] == pytest.approx(expected)


@given(SEED, COUNT)
def test_the_thresholds_are_those_of_a_search(seed: int, count: int) -> None:
    held, margins = drawn(seed, count)
    found = calibrate(held, margins, bins=2, target=0.6)
    values = np.where(np.isnan(margins), -np.inf, margins)
    tried = sorted(set(values[np.isfinite(values)].tolist()))
    if held.any() and not held.all() and tried:
        sums = [(values[held] >= t).mean() + (values[~held] < t).mean() for t in tried]
        best = found.youden
        assert best.sensitivity + best.specificity == pytest.approx(max(sums))
    reaching = [t for t in [-math.inf, *tried] if held[values >= t].mean() >= 0.6]
    if reaching:
        assert found.reached.margin == min(reaching)
        assert found.reached.held >= 0.6 * found.reached.accepted
        assert found.reached.accepted == (values >= min(reaching)).sum()
    else:
        assert math.isnan(found.reached.margin)
        assert found.reached.accepted == 0


def test_perfect_margins() -> None:
    margins = np.linspace(-1.0, 1.0, 41)
    found = calibrate(margins > 0.02, margins, bins=4, target=0.9)
    assert found.youden.margin == pytest.approx(0.05)
    assert (found.youden.sensitivity, found.youden.specificity) == (1.0, 1.0)
    assert found.is_monotone
    assert found.falls == 0
    assert found.rank_correlation > 0.85
    worse = calibrate(margins < 0.02, margins, bins=4, target=0.9)
    assert not worse.is_monotone
    assert worse.rank_correlation == pytest.approx(-found.rank_correlation, abs=0.02)


def test_a_fall_within_chance_is_no_proof() -> None:
    margins = np.arange(20.0)
    held = np.array([True, False] * 8 + [False, False, True, False])
    found = calibrate(held, margins, bins=2, target=0.9)
    assert found.falls == 1
    assert found.is_monotone


def test_grasps_without_margin_rank_below_all_others() -> None:
    held = np.array([False, False, True, True])
    found = calibrate(held, np.array([np.nan, np.nan, -1.0, -0.5]), bins=2, target=0.9)
    assert found.rank_correlation > 0.8
    assert found.reached.margin == -1.0
    assert found.youden.accepted == 2


def test_nothing_is_known_where_all_is_the_same() -> None:
    found = calibrate(np.ones(4, bool), np.arange(4.0), bins=2, target=0.9)
    assert math.isnan(found.youden.margin)
    assert math.isnan(found.rank_correlation)
    assert found.reached.margin == -math.inf
    none = calibrate(np.zeros(3, bool), np.full(3, np.nan), bins=2, target=0.9)
    assert none.bins == ()
    assert math.isnan(none.reached.margin)
