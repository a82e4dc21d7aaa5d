"""Scores against each other, held against the test of DeLong, DeLong & Clarke-Pearson 1988."""

import math

import numpy as np
import pytest
from scipy.stats import norm

from grasp3d.validating import SCORES
from grasp3d.validating.qualities import (
    ScoreDifference,
    ScoreQuality,
    compare_objects,
    compare_scores,
    mean_over_objects,
)

LARGER = [score for score in SCORES if score.better == "larger"][:3]


def delong(held: np.ndarray, one: np.ndarray, other: np.ndarray) -> tuple[float, float, float]:
    """Difference of the areas, its standard error, and the two-sided p."""

    def placements(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        good, bad = values[held][:, None], values[~held][None]
        above = (good > bad) + 0.5 * (good == bad)
        return above.mean(axis=1), above.mean(axis=0)

    (good1, bad1), (good2, bad2) = placements(one), placements(other)
    difference = float(good1.mean() - good2.mean())
    variance = np.var(good1 - good2, ddof=1) / len(good1) + np.var(bad1 - bad2, ddof=1) / len(bad1)
    error = math.sqrt(variance)
    return difference, error, float(2.0 * norm.sf(abs(difference) / error))


def simulated(seed: int, count: int, gap: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Outcomes and two correlated scores, of which the first separates them better by a gap."""
    random = np.random.default_rng(seed)
    held = random.random(count) < 0.6
    shared, own1, own2 = random.normal(size=(3, count))
    return held, (1.0 + gap) * held + shared + 0.6 * own1, held + shared + 0.6 * own2


def compared(
    held: np.ndarray, *values: np.ndarray, resamples: int = 1000, clusters: np.ndarray | None = None
) -> tuple[tuple[ScoreQuality, ...], tuple[ScoreDifference, ...]]:
    scores = LARGER[: len(values)]
    own = np.arange(len(held)) if clusters is None else clusters
    named = {score.name: each for score, each in zip(scores, values, strict=True)}
    return compare_scores(scores, named, held, own, resamples=resamples, seed=0)


@pytest.mark.parametrize(("count", "gap"), [(300, 0.0), (300, 0.3), (800, 0.15)])
def test_paired_differences_agree_with_delong(count: int, gap: float) -> None:
    held, one, other = simulated(1, count, gap)
    _, (found,) = compared(held, one, other)
    difference, error, p = delong(held, one, other)
    assert found.difference == pytest.approx(difference, abs=1e-6)
    ends = (difference - 1.96 * error, difference + 1.96 * error)
    assert found.interval == pytest.approx(ends, abs=0.25 * error)
    assert found.p == pytest.approx(p, abs=0.03 + 0.2 * p)
    assert (found.p < 0.05) == (found.interval[0] > 0.0 or found.interval[1] < 0.0)


def test_pairing_is_narrower_than_two_intervals() -> None:
    (one, other), (found,) = compared(*simulated(2, 300, 0.2), resamples=300)
    apart = math.hypot(*(np.diff(each.roc_auc_interval)[0] for each in (one, other)))
    assert np.diff(found.interval)[0] < 0.7 * apart


@pytest.mark.slow
def test_equal_scores_differ_by_chance_as_often_as_stated() -> None:
    p = [compared(*simulated(seed, 150, 0.0), resamples=200)[1][0].p for seed in range(200)]
    assert 0.01 <= np.mean(np.array(p) < 0.05) <= 0.1
    assert np.mean(p) == pytest.approx(0.5, abs=0.08)


def test_every_two_scores_are_compared_once() -> None:
    held, one, other = simulated(3, 100, 0.1)
    _, found = compared(held, one, other, one, resamples=100)
    pairs = [(each.score.name, each.other.name) for each in found]
    first, second, third = (score.name for score in LARGER)
    assert pairs == [(first, second), (first, third), (second, third)]
    assert (found[1].difference, found[1].interval, found[1].p) == (0.0, (0.0, 0.0), 1.0)
    assert found[2].difference == -found[0].difference
    assert found[2].interval == pytest.approx([-end for end in found[0].interval[::-1]])
    assert found[2].p == found[0].p


def test_differences_by_object_are_as_uncertain_as_objects_differ() -> None:
    """Each object's grasps repeated nine times say no more about others."""
    held, one, other = simulated(4, 40, 0.4)
    clusters = np.repeat(np.arange(40), 9)
    _, (single,) = compared(held, one, other, resamples=300)
    _, (whole,) = compared(
        *(np.repeat(each, 9) for each in (held, one, other)), resamples=300, clusters=clusters
    )
    assert (whole.interval, whole.p) == (single.interval, single.p)
    _, (drawn,) = compared(*(np.repeat(each, 9) for each in (held, one, other)), resamples=300)
    assert np.diff(drawn.interval)[0] < 0.5 * np.diff(whole.interval)[0]


def test_objects_are_compared_each_and_on_average() -> None:
    held = np.array([1, 0, 1, 0, 1, 1], bool)
    values = np.array([2.0, 1.0, 1.0, 2.0, 1.0, 2.0])
    objects = np.array([0, 0, 1, 1, 2, 2])
    name = LARGER[0].name
    found = compare_objects(LARGER[:1], {name: values}, held, objects)
    assert [(one.number, one.count, one.held) for one in found] == [(0, 2, 1), (1, 2, 1), (2, 2, 2)]
    assert [one.roc_auc[name] for one in found[:2]] == [1.0, 0.0]
    assert math.isnan(found[2].roc_auc[name])
    assert mean_over_objects(found, name) == 0.5
    assert math.isnan(mean_over_objects(found[2:], name))
    (pooled,), _ = compared(held, values, resamples=10)
    assert pooled.roc_auc == 0.5
