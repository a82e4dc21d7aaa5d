"""Printed report of `grasp3d validate`."""

import math
from pathlib import Path

import numpy as np
from rich.table import Table

from grasp3d.cli.report import WARNING, Report, escaped, label_name, table_of
from grasp3d.stability.label import Label
from grasp3d.system.counts import counted
from grasp3d.validating import sentences
from grasp3d.validating.disagreements import MEANING, Disagreement
from grasp3d.validating.intervals import wilson
from grasp3d.validating.sentences import degrees, percent
from grasp3d.validating.success import LabelSuccess
from grasp3d.validating.validation import Validation

MOST_WARNINGS = 10
"""Most warnings that are printed."""


def print_validation(found: Validation, output: Path | None) -> None:
    """Print how well the scores predict the outcomes.

    Args:
        found: The result.
        output: Folder of the report; None: it was not written.
    """
    report = Report()
    report.lines([sentences.counts_of(found), sentences.model_of(found)])
    report.lines([*sentences.sources_of(found), sentences.closing_of(found)])
    report.lines(found.warnings[:MOST_WARNINGS], WARNING)
    if len(found.warnings) > MOST_WARNINGS:
        more = counted(len(found.warnings) - MOST_WARNINGS, "warnings")
        report.paragraph(f"and {more} more")
    report.table(_scores(found))
    report.lines([sentences.intervals_of(found)])
    report.table(_labels(found))
    report.table(_calibration(found))
    report.lines(sentences.calibration_of(found))
    for kind, meaning in MEANING.items():
        shown = [_disagreement(found, one) for one in found.disagreements if one.kind == kind]
        if shown:
            report.paragraph(f"[bold]{meaning}[/]")
            report.lines(shown, " ")
    if output is not None:
        report.lines([f"written: {output / 'report.html'} and its tables"])


def _scores(found: Validation) -> Table:
    """ROC-AUC and average precision of each score."""
    rows = (
        (
            escaped(one.score.title),
            one.score.better,
            f"{_number(one.roc_auc)} {_interval(one.roc_auc_interval)}",
            f"{_number(one.average_precision)} {_interval(one.average_precision_interval)}",
        )
        for one in found.qualities
    )
    return table_of(("score", "better", "ROC-AUC, 95 %", "average precision, 95 %"), rows)


def _labels(found: Validation) -> Table:
    """Success within S, M and U over friction and resolution."""
    order = sorted(Label, reverse=True)
    rows = (
        (
            f"{one.friction:.4g}",
            f"{math.degrees(one.sensor_resolution):.4g}°",
            *(_success(one, label) for label in order),
        )
        for one in found.labels
    )
    return table_of(("μ", "α", *(f"{label_name(label)} held, 95 %, of" for label in order)), rows)


def _success(one: LabelSuccess, label: Label) -> str:
    """Fraction that held, with its interval, and the number of grasps."""
    if not one.counts[label]:
        return "none"
    low, high = one.interval(label.name)
    fraction = percent(one.fraction(label.name))
    return f"{fraction} {100.0 * low:.0f}-{100.0 * high:<3.0f}{one.counts[label]:>6,}"


def _calibration(found: Validation) -> Table:
    """Success in bins of the margin."""
    rows = []
    missing = ~found.grasps.closed
    if missing.any():
        held, count = int(found.grasps.held[missing].sum()), int(missing.sum())
        ends = _interval(wilson(held, count))
        rows.append(("jaws do not close", f"{count:,}", percent(held / count), ends))
    for one in found.calibration.bins:
        span = f"{degrees(one.low)} to {degrees(one.high)}"
        rows.append((span, f"{one.count:,}", percent(one.fraction), _interval(one.interval)))
    return table_of(("margin", "grasps", "held", "95 %"), rows)


def _disagreement(found: Validation, one: Disagreement) -> str:
    grasps = found.grasps
    number, file = int(grasps.grasp[one.row]), found.files[int(grasps.file[one.row])]
    where = f" of {Path(file.name).name}" if len(found.files) > 1 else ""
    label = Label(int(grasps.label[one.row])).name
    margin = "" if np.isnan(one.margin) else f", margin {degrees(one.margin)}"
    return f"grasp {number}{where}: {label}{margin}: {'; '.join(one.hints)}"


def _number(value: float) -> str:
    return "undefined" if math.isnan(value) else f"{value:.3f}"


def _interval(ends: tuple[float, float]) -> str:
    return "" if math.isnan(ends[0]) else f"{ends[0]:.3f}-{ends[1]:.3f}"
