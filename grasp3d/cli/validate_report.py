"""Printed report of `grasp3d validate`."""

import math
from collections.abc import Iterable
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from grasp3d.cli.grasp_report import label_name
from grasp3d.cli.report import escaped
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
    console = Console(emoji=False)
    _lines(console, [sentences.counts_of(found), sentences.model_of(found)])
    _lines(console, [*sentences.sources_of(found), sentences.closing_of(found)])
    for line in found.warnings[:MOST_WARNINGS]:
        console.print(f"[yellow]warning:[/] {escaped(line)}", soft_wrap=True)
    if len(found.warnings) > MOST_WARNINGS:
        more = counted(len(found.warnings) - MOST_WARNINGS, "warnings")
        console.print(f"and {more} more")
    console.print(_scores(found))
    _lines(console, [sentences.intervals_of(found)])
    console.print(_labels(found))
    console.print(_calibration(found))
    _lines(console, sentences.calibration_of(found))
    _print_disagreements(console, found)
    if output is not None:
        _lines(console, [f"written: {output / 'report.html'} and its tables"])


def _lines(console: Console, lines: Iterable[str]) -> None:
    for line in lines:
        console.print(escaped(line), soft_wrap=True)


def _table(*headings: str) -> Table:
    """A table whose first column is text."""
    table = Table(box=None, pad_edge=False)
    for number, heading in enumerate(headings):
        table.add_column(heading, justify="right" if number else "left", no_wrap=True)
    return table


def _scores(found: Validation) -> Table:
    """ROC-AUC and average precision of each score."""
    table = _table("score", "better", "ROC-AUC, 95 %", "average precision, 95 %")
    for one in found.qualities:
        table.add_row(
            escaped(one.score.title),
            one.score.better,
            f"{_number(one.roc_auc)} {_interval(one.roc_auc_interval)}",
            f"{_number(one.average_precision)} {_interval(one.average_precision_interval)}",
        )
    return table


def _labels(found: Validation) -> Table:
    """Success within S, M and U over friction and resolution."""
    order = sorted(Label, reverse=True)
    table = _table("μ", "α", *(f"{label_name(label)} held, 95 %, of" for label in order))
    for one in found.labels:
        table.add_row(
            f"{one.friction:.4g}",
            f"{math.degrees(one.sensor_resolution):.4g}°",
            *(_success(one, label) for label in order),
        )
    return table


def _success(one: LabelSuccess, label: Label) -> str:
    """Fraction that held, with its interval, and the number of grasps."""
    if not one.counts[label]:
        return "none"
    low, high = one.interval(label.name)
    fraction = percent(one.fraction(label.name))
    return f"{fraction} {100.0 * low:.0f}-{100.0 * high:<3.0f}{one.counts[label]:>6,}"


def _calibration(found: Validation) -> Table:
    """Success in bins of the margin."""
    table = _table("margin", "grasps", "held", "95 %")
    missing = ~found.grasps.closed
    if missing.any():
        held, count = int(found.grasps.held[missing].sum()), int(missing.sum())
        ends = _interval(wilson(held, count))
        table.add_row("jaws do not close", f"{count:,}", percent(held / count), ends)
    for one in found.calibration.bins:
        span = f"{degrees(one.low)} to {degrees(one.high)}"
        table.add_row(span, f"{one.count:,}", percent(one.fraction), _interval(one.interval))
    return table


def _print_disagreements(console: Console, found: Validation) -> None:
    """Print the greatest disagreements with their likely causes."""
    for kind, meaning in MEANING.items():
        shown = [one for one in found.disagreements if one.kind == kind]
        if shown:
            console.print(f"[bold]{meaning}[/]")
            for one in shown:
                console.print(f"  {escaped(_disagreement(found, one))}", soft_wrap=True)


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
