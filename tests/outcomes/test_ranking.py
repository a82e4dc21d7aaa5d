import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from grasp3d.outcomes import SuccessRate
from grasp3d.outcomes.validation import roc_auc, roc_curve

SEED, COUNT = st.integers(0, 2**32), st.integers(1, 40)


def drawn(seed: int, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Outcomes and scores with ties and infinite values."""
    random = np.random.default_rng(seed)
    scores = np.round(random.normal(size=count), 1)
    scores[random.random(count) < 0.2] = -np.inf
    return random.random(count) < 0.5, scores


def area(held: np.ndarray, scores: np.ndarray) -> float:
    return roc_auc(held, scores, np.arange(len(held)))[0]


def wins(held: np.ndarray, scores: np.ndarray) -> np.ndarray:
    """Pair by pair: 1 where the grasp that held (rows) is better, 1/2 where both are equal."""
    one, other = scores[held][:, None], scores[~held]
    return np.where(one == other, 0.5, one > other)


@given(SEED, COUNT)
def test_the_area_counts_pairs(seed: int, count: int) -> None:
    held, scores = drawn(seed, count)
    found, expected = area(held, scores), wins(held, scores)
    assert found == pytest.approx(expected.mean() if expected.size else math.nan, nan_ok=True)
    reverse = area(held, -scores)
    assert reverse == pytest.approx(1.0 - found, nan_ok=True)
    assert area(held, np.arctan(scores)) == pytest.approx(found, nan_ok=True)
    kinds = np.array([kind == "p" for kind in "ppnpppnnpnpnpnnnpnpn"])  # Fawcett 2006, Fig. 3
    assert area(kinds, -np.arange(20.0)) == pytest.approx(0.68)


@given(SEED, COUNT)
def test_the_curve_encloses_the_area(seed: int, count: int) -> None:
    held, scores = drawn(seed, count)
    if held.all() or not held.any():
        return
    failed, right = roc_curve(held, scores)
    assert (failed[0], right[0], failed[-1], right[-1]) == (0.0, 0.0, 1.0, 1.0)
    assert np.trapezoid(right, failed) == pytest.approx(area(held, scores))


def spread(found: tuple[float, float, float]) -> float:
    """Half the width of an interval in the logit, which is symmetric there."""
    middle, low, high = (math.log(one / (1.0 - one)) for one in found)
    assert high - middle == pytest.approx(middle - low)
    return high - middle


def test_the_interval_of_single_grasps_is_that_of_delong() -> None:
    """Variances of what each grasp wins on average (DeLong et al. 1988, eq. 3), from all pairs."""
    held, scores = drawn(5, 200)
    won = wins(held, scores)
    variance = won.mean(axis=1).var(ddof=1) / len(won) + won.mean(axis=0).var(ddof=1) / won.shape[1]
    found = roc_auc(held, scores, np.arange(200))
    expected = 1.985 * math.sqrt(variance) / (won.mean() * (1.0 - won.mean()))
    assert spread(found) == pytest.approx(expected, rel=2e-3)


def test_the_interval_is_as_wide_as_objects_drawn_anew_differ() -> None:
    random = np.random.default_rng(0)
    objects = np.repeat(np.arange(40), 30)
    scores = random.normal(size=1200) + random.normal(size=40)[objects]
    shifts = random.normal(size=40)[objects]
    held = random.random(1200) < 1.0 / (1.0 + np.exp(-scores - 2.0 * shifts))
    areas = []
    for _ in range(400):
        chosen = random.integers(40, size=40)
        rows = np.concatenate([np.flatnonzero(objects == one) for one in chosen])
        areas.append(area(held[rows], scores[rows]))
    found = roc_auc(held, scores, objects)
    assert found[2] - found[1] == pytest.approx(4.0 * np.std(areas), rel=0.15)
    assert spread(roc_auc(held, scores, np.arange(1200))) < 0.6 * spread(found)


def test_ends_where_little_is_known() -> None:
    held, scores = np.array([True, False, True, False]), np.array([2.0, 1.0, 0.0, 0.0])
    assert roc_auc(held, scores, np.array([1, 1, 1, 2])) == (0.625, 0.0, 1.0)
    assert roc_auc(held, held.astype(float), np.arange(4)) == (1.0, 1.0, 1.0)
    rounded = 0.1 * np.ones(4) + np.array([2e-17, 4e-17, -2e-17, 0.0])
    assert area(held, rounded) == 0.5
    for outcome in (True, False):
        assert np.isnan(roc_auc(np.full(4, outcome), scores, np.arange(4))).all()


@given(st.integers(1, 10_000), st.floats(0.0, 1.0))
def test_wilson_solves_its_equation(count: int, part: float) -> None:
    """Its ends are where the score test just rejects: (p - x)^2 = z^2 x (1 - x) / n."""
    held = round(part * count)
    low, high = SuccessRate("", count, held).interval
    assert 0.0 <= low <= held / count <= high <= 1.0
    for end in (low, high):
        difference = (held / count - end) ** 2 - 1.959964**2 * end * (1.0 - end) / count
        assert difference == pytest.approx(0.0, abs=1e-6)


def test_wilson_of_a_known_count_and_of_none() -> None:
    """Newcombe 1998, Table I."""
    assert SuccessRate("", 263, 81).interval == pytest.approx((0.2553, 0.3662), abs=5e-5)
    none = SuccessRate("S", 0, 0)
    assert none.interval == (0.0, 1.0)
    assert math.isnan(none.rate)
