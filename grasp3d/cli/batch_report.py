"""Printed report of `grasp3d batch`: the meshes, the failures, and the paths of the results."""

from collections import Counter
from collections.abc import Collection, Sequence
from typing import get_args

from grasp3d.batch.library import REPORT, LibraryLabels
from grasp3d.batch.row import Outcome, Row
from grasp3d.cli.report import (
    CHECK_HINT,
    FAILED,
    WARNING,
    Report,
    angle_text,
    escaped,
    table_of,
)
from grasp3d.cli.uncertainty_report import MARGIN, is_uncertain, margin_text
from grasp3d.grasps.verdict import Word
from grasp3d.settings import GraspModel
from grasp3d.settings.model_text import EPSILON_MIN, SAFE_LABELS, epsilon_min_text
from grasp3d.stability.label import MEANING
from grasp3d.system.counts import noun

MAX_ROWS = 60
"""Meshes up to which each of them is printed."""

MAX_MESSAGES = 20
"""Failures, and warnings, that are printed; the others are in the summary and the report."""


def print_library(library: LibraryLabels, model: GraspModel, *, report: bool) -> None:
    """Print the results of a library: a line per mesh where they are few, warnings and failures.

    Args:
        library: From `label_library`.
        model: Model of the labels.
        report: Whether the report was written.
    """
    output, rows = Report(), library.rows.values()
    if len(rows) <= MAX_ROWS:
        _print_table(output, rows, model)
    output.lines(library.warnings, WARNING)
    failed = [row.error for row in library.failed]
    _print_some(output, FAILED, failed, "failures")
    warned = [
        f"{row.mesh}: {row.warnings}"
        for row in rows
        if row.outcome == Outcome.LABELLED and row.warnings
    ]
    _print_some(output, WARNING, warned, "warnings")
    if failed or warned:
        output.paragraph(CHECK_HINT)
    verdicts = _verdicts(rows)
    if verdicts:
        output.paragraph(verdicts)
    before = f"; {library.finished} of them were finished before" if library.finished else ""
    output.paragraph(f"{len(rows) - len(failed)} labelled, {len(failed)} failed{before}")
    output.written(library.output)
    if report:
        output.lines([f"{library.output}/{REPORT}"], "report:")


def _verdicts(rows: Collection[Row]) -> str:
    """Return how many objects have which verdict; empty: none has one."""
    counts = Counter(row.verdict for row in rows if row.verdict)
    return ", ".join(f"{counts[word]} {word}" for word in get_args(Word) if counts[word])


def print_failed(library: LibraryLabels) -> None:
    """Print only the failures, to standard error."""
    errors = [row.error for row in library.failed]
    _print_some(Report(errors=True), "failed:", errors, "failures")


def _print_some(report: Report, mark: str, lines: Sequence[str], what: str) -> None:
    report.lines(lines[:MAX_MESSAGES], mark)
    more = len(lines) - MAX_MESSAGES
    if more > 0:
        report.paragraph(f"{mark} {more} more {noun(more, what)}: see the summary or the report")


def _print_table(report: Report, rows: Collection[Row], model: GraspModel) -> None:
    uncertain = is_uncertain(model)
    margin = ["margin"] * uncertain
    names = ("vertices", "S %", "M %", "U %", "β* 10/50/90 %", *margin, EPSILON_MIN, "s")
    cells = (_cells(row, uncertain=uncertain) for row in rows)
    report.table(table_of(("mesh", *names), cells))
    legend = ", ".join(f"{code.name} {meaning}" for code, meaning in MEANING["label"].items())
    safe = f" ({SAFE_LABELS})" if model.certainty == "safe" else ""
    spare, medians = (
        (MARGIN, "margin and ε_min are medians") if uncertain else ("", "ε_min is a median")
    )
    report.paragraph(
        f"{legend}{safe}; area fractions; β* critical friction angle; {spare}"
        f"{epsilon_min_text(model)}; {medians} over the area; s: seconds"
    )


def _cells(row: Row, *, uncertain: bool) -> list[str]:
    empty = 6 if uncertain else 5
    if row.outcome != Outcome.LABELLED:
        return [escaped(row.mesh), "[red]failed[/]", *[""] * empty, f"{row.seconds:.1f}"]
    fractions = (row.stable, row.ambiguous, row.no_grasp_found)
    angles = (row.critical_angle_p10, row.critical_angle_p50, row.critical_angle_p90)
    return [
        escaped(row.mesh),
        str(row.vertices),
        *(f"{100.0 * one:.1f}" for one in fractions if one is not None),
        " ".join(angle_text(angle) for angle in angles if angle is not None),
        *(["" if row.margin_p50 is None else margin_text(row.margin_p50)] * uncertain),
        "" if row.epsilon_min_p50 is None else f"{row.epsilon_min_p50:.3f}",
        f"{row.seconds:.1f}",
    ]
