"""How well scores predict outcomes: each, every two against each other, and on each object."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from grasp3d.arrays import Bools, Floats, Ints
from grasp3d.validating.intervals import interval_of, resampled, two_sided_p
from grasp3d.validating.ranking import RankedOutcomes
from grasp3d.validating.scores import Score

Values = Mapping[str, Floats]
"""Scores of n grasps by name, shape (n,) each."""


@dataclass(frozen=True)
class ScoreQuality:
    """How well one score predicts the outcomes; intervals at 95 %."""

    score: Score
    roc_auc: float
    """Probability that a held grasp ranks above a failed one; nan: all outcomes are the same."""
    roc_auc_interval: tuple[float, float]
    average_precision: float
    """nan: no grasp held."""
    average_precision_interval: tuple[float, float]


@dataclass(frozen=True)
class ScoreDifference:
    """By how much one score predicts the same outcomes better than another one."""

    score: Score
    other: Score
    difference: float
    """ROC-AUC of the score less that of the other one; nan: all outcomes are the same."""
    interval: tuple[float, float]
    """At 95 %, from resamples that both share."""
    p: float
    """Probability that a difference as large, either way, is chance."""


@dataclass(frozen=True)
class ObjectQuality:
    """How well scores predict the outcomes on one object."""

    number: int
    """Of the object, from 0."""
    count: int
    """Grasps on it."""
    held: int
    roc_auc: Mapping[str, float]
    """By name of the score; nan: all outcomes on it are the same."""


def compare_scores(
    scores: Sequence[Score],
    values: Values,
    held: Bools,
    clusters: Ints,
    *,
    resamples: int,
    seed: int,
) -> tuple[tuple[ScoreQuality, ...], tuple[ScoreDifference, ...]]:
    """Quality of each score, and difference of every two.

    Args:
        scores: The scores.
        values: Their values.
        held: Whether each grasp held, shape (n,).
        clusters: What is drawn whole: cluster of each grasp, shape (n,).
        resamples: Number of resamples, which all scores share.
        seed: Seed of the draws.

    Returns:
        Qualities, and differences of each score from all after it.
    """  # fmt: skip
    ranked = [RankedOutcomes.of(held, score.ranked(values[score.name])) for score in scores]
    measures = [one.measures for one in ranked]
    drawn = resampled(measures, clusters, resamples=resamples, seed=seed)
    drawn = drawn.reshape(len(scores), 2, resamples)
    found = [one.measures() for one in ranked]
    qualities = tuple(
        ScoreQuality(score, area, interval_of(areas), precision, interval_of(precisions))
        for score, (area, precision), (areas, precisions) in zip(scores, found, drawn, strict=True)
    )
    differences = tuple(
        ScoreDifference(
            scores[one],
            scores[other],
            found[one][0] - found[other][0],
            interval_of(drawn[one, 0] - drawn[other, 0]),
            two_sided_p(drawn[one, 0] - drawn[other, 0]),
        )
        for one, other in combinations(range(len(scores)), 2)
    )
    return qualities, differences


def compare_objects(
    scores: Sequence[Score], values: Values, held: Bools, objects: Ints
) -> tuple[ObjectQuality, ...]:
    """Quality of each score on each object.

    Args:
        scores: The scores.
        values: Their values.
        held: Whether each grasp held, shape (n,).
        objects: Number of the object of each grasp, from 0, shape (n,).
    """
    found = []
    for number in np.unique(objects).tolist():
        own = objects == number
        areas = {
            score.name: RankedOutcomes.of(
                held[own], score.ranked(values[score.name][own])
            ).roc_auc()
            for score in scores
        }
        found.append(ObjectQuality(number, int(own.sum()), int(held[own].sum()), areas))
    return tuple(found)


def mean_over_objects(objects: Sequence[ObjectQuality], name: str) -> float:
    """Mean of a score's ROC-AUC over the objects on which some grasps held and some failed.

    Args:
        objects: The objects.
        name: Name of the score.

    Returns:
        nan: there is no such object.
    """
    areas = [one.roc_auc[name] for one in objects if not math.isnan(one.roc_auc[name])]
    return float(np.mean(areas)) if areas else math.nan
