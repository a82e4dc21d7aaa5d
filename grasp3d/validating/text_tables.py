"""A validation in tables of texts, as the command and its report print them."""

import math
from collections.abc import Sequence
from typing import TypeAlias

from grasp3d.stability.label import Label
from grasp3d.validating.intervals import wilson
from grasp3d.validating.qualities import mean_over_objects
from grasp3d.validating.sentences import degrees, percent
from grasp3d.validating.success import LabelSuccess
from grasp3d.validating.validation import Validation

TextTable: TypeAlias = tuple[Sequence[str], list[Sequence[str]]]
"""A heading for each column, and rows of texts."""


def scores_of(result: Validation) -> TextTable:
    """ROC-AUC and average precision of each score; on several objects also the mean over them.

    Args:
        result: The validation.
    """
    rows: list[Sequence[str]] = []
    for one in result.qualities:
        cells = [
            one.score.title,
            one.score.better,
            f"{number(one.roc_auc)} {interval(one.roc_auc_interval)}",
            f"{number(one.average_precision)} {interval(one.average_precision_interval)}",
        ]
        if result.by_object:
            cells.append(number(mean_over_objects(result.by_objects, one.score.name)))
        rows.append(cells)
    heads = ["score", "better", "ROC-AUC, 95 %", "precision, 95 %"]
    return [*heads, *["by object"] * result.by_object], rows


def differences_of(result: Validation) -> TextTable:
    """By how much the first score predicts better than all others.

    Args:
        result: The validation.
    """
    first = result.qualities[0].score
    rows: list[Sequence[str]] = [
        (
            one.other.title,
            f"{one.difference:+.3f} {one.interval[0]:+.3f} to {one.interval[1]:+.3f}",
            number(one.p),
        )
        for one in result.differences
        if one.score == first
    ]
    return (f"{first.title} less", "ROC-AUC, 95 %, paired", "p"), rows


def labels_of(result: Validation) -> TextTable:
    """Success within S, M and U over friction and resolution.

    Args:
        result: The validation.
    """
    order = sorted(Label, reverse=True)
    rows: list[Sequence[str]] = [
        (
            f"{success.friction:.4g}",
            f"{math.degrees(success.sensor_resolution):.4g}°",
            *(_success(success, label) for label in order),
        )
        for success in result.labels
    ]
    return ("μ", "α", *(f"{label.name} held, 95 %, of" for label in order)), rows


def calibration_of(result: Validation) -> TextTable:
    """Success in bins of the margin, and of grasps at which the jaws do not close.

    Args:
        result: The validation.
    """
    parts = [
        (f"{degrees(part.low)} to {degrees(part.high)}", part.count, part.held)
        for part in result.calibration.bins
    ]
    missing = ~result.grasps.closed
    if missing.any():
        held = int(result.grasps.held[missing].sum())
        parts.insert(0, ("jaws do not close", int(missing.sum()), held))
    rows: list[Sequence[str]] = [
        (name, f"{count:,}", f"{held:,}", percent(held / count), interval(wilson(held, count)))
        for name, count, held in parts
    ]
    return ("margin", "grasps", "held", "success", "95 %"), rows


def number(value: float) -> str:
    """A number with three digits after the point."""
    return "undefined" if math.isnan(value) else f"{value:.3f}"


def interval(ends: tuple[float, float]) -> str:
    """Both ends of an interval; empty: it is not known."""
    return "" if math.isnan(ends[0]) else f"{ends[0]:.3f}-{ends[1]:.3f}"


def _success(success: LabelSuccess, label: Label) -> str:
    """Fraction that held, with its interval, and the number of grasps."""
    if not success.counts[label]:
        return "none"
    low, high = success.interval(label.name)
    fraction = percent(success.fraction(label.name))
    return f"{fraction} {100.0 * low:.0f}-{100.0 * high:<3.0f}{success.counts[label]:>6,}"
