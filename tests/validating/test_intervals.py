import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from grasp3d.validating.intervals import (
    interval_of,
    resampled,
    resampled_weights,
    two_sided_p,
    wilson,
)


@given(st.integers(1, 10_000), st.floats(0.0, 1.0))
def test_wilson_solves_its_equation(count: int, part: float) -> None:
    """Its ends are where the score test just rejects: (p - x)^2 = z^2 x (1 - x) / n."""
    held = round(part * count)
    low, high = wilson(held, count)
    assert 0.0 <= low <= held / count <= high <= 1.0
    for end in (low, high):
        difference = (held / count - end) ** 2 - 1.959964**2 * end * (1.0 - end) / count
        assert difference == pytest.approx(0.0, abs=1e-6)


def test_wilson_of_known_counts() -> None:
    """Newcombe 1998, Table I: 81 of 263, 15 of 148, 0 of 20, 1 of 29."""
    for held, count, low, high in (
        (81, 263, 0.2553, 0.3662), (15, 148, 0.0624, 0.1605), (0, 20, 0.0, 0.1611),
        (1, 29, 0.0061, 0.1718),
    ):  # fmt: skip
        assert wilson(held, count) == pytest.approx((low, high), abs=5e-5)
    assert wilson(0, 0) == (0.0, 1.0)


def test_clusters_are_drawn_whole() -> None:
    clusters = np.array([0, 0, 0, 1, 1, 2])
    seen = set()
    for weights in resampled_weights(clusters, 50, 0):
        assert len(set(weights[:3].tolist())) == 1
        assert weights[3] == weights[4]
        assert weights[0] + weights[3] + weights[5] == 3
        seen.add(tuple(weights.tolist()))
    assert len(seen) > 5


def test_the_same_seed_gives_the_same_intervals() -> None:
    values = np.random.default_rng(0).normal(size=40)

    def mean(weights: np.ndarray) -> float:
        return float(np.average(values, weights=weights))

    one, same, other = (
        resampled([mean], np.arange(40), resamples=200, seed=seed) for seed in (3, 3, 4)
    )
    assert (one == same).all()
    assert (one != other).any()


def test_intervals_by_object_are_as_wide_as_objects_differ() -> None:
    """Ten objects whose grasps all have the value of their object: grasps add nothing."""
    of_objects = np.random.default_rng(1).normal(size=10)
    clusters = np.repeat(np.arange(10), 50)
    values = of_objects[clusters]

    def mean(weights: np.ndarray) -> float:
        return float(np.average(values, weights=weights))

    def width(clusters: np.ndarray) -> float:
        low, high = interval_of(resampled([mean], clusters, resamples=500, seed=0)[0])
        return high - low

    expected = 2.0 * 1.96 * of_objects.std() / math.sqrt(10)
    assert width(clusters) == pytest.approx(expected, rel=0.2)
    assert width(np.arange(500)) < 0.25 * width(clusters)


def test_resamples_without_a_value_are_left_out() -> None:
    assert interval_of(np.array([1.0, math.nan, 3.0, math.nan])) == pytest.approx((1.05, 2.95))
    assert np.isnan(interval_of(np.full(4, math.nan))).all()
    assert two_sided_p(np.array([1.0, math.nan, 3.0, -1.0])) == 1.0
    assert math.isnan(two_sided_p(np.full(4, math.nan)))


def test_p_is_bounded_by_the_resamples() -> None:
    assert two_sided_p(np.zeros(99)) == 1.0
    assert two_sided_p(np.full(99, 0.1)) == two_sided_p(np.full(99, -0.1)) == 0.02
    assert two_sided_p(np.arange(-4.0, 95.0)) == pytest.approx(2.0 * 6 / 100)
