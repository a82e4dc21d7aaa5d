"""Output of `grasp3d batch`: a table of the meshes, the failures, and the paths of the results."""

from collections import Counter
from collections.abc import Collection, Sequence
from typing import get_args

from rich.console import Console
from rich.table import Table

from grasp3d.batch.library import REPORT, LibraryLabels
from grasp3d.batch.row import Outcome, Row
from grasp3d.cli.report import CHECK_HINT, angle_text, escaped
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
    console = Console(emoji=False)
    rows = library.rows.values()
    if len(rows) <= MAX_ROWS:
        _print_table(console, rows, model)
    for warning in library.warnings:
        console.print(f"[yellow]warning:[/] {escaped(warning)}", soft_wrap=True)
    failed = [escaped(row.error) for row in library.failed]
    _print_some(console, "[red]failed:[/]", failed, "failures")
    warned = [
        escaped(f"{row.mesh}: {row.warnings}")
        for row in rows
        if row.outcome == Outcome.LABELLED and row.warnings
    ]
    _print_some(console, "[yellow]warning:[/]", warned, "warnings")
    if failed or warned:
        console.print(CHECK_HINT)
    verdicts = _verdicts(rows)
    if verdicts:
        console.print(verdicts)
    before = f"; {library.finished} of them were finished before" if library.finished else ""
    console.print(f"{len(rows) - len(failed)} labelled, {len(failed)} failed{before}")
    console.print(f"written: {escaped(library.output)}", soft_wrap=True)
    if report:
        console.print(f"report: {escaped(f'{library.output}/{REPORT}')}", soft_wrap=True)


def _verdicts(rows: Collection[Row]) -> str:
    """Return how many objects have which verdict; empty: none has one."""
    counts = Counter(row.verdict for row in rows if row.verdict)
    return ", ".join(f"{counts[word]} {word}" for word in get_args(Word) if counts[word])


def print_failed(library: LibraryLabels) -> None:
    """Print only the failures, to standard error."""
    console = Console(stderr=True, emoji=False)
    _print_some(console, "failed:", [escaped(row.error) for row in library.failed], "failures")


def _print_some(console: Console, mark: str, lines: Sequence[str], what: str) -> None:
    for line in lines[:MAX_MESSAGES]:
        console.print(f"{mark} {line}", soft_wrap=True)
    more = len(lines) - MAX_MESSAGES
    if more > 0:
        console.print(f"{mark} {more} more {noun(more, what)}: see the summary or the report")


def _print_table(console: Console, rows: Collection[Row], model: GraspModel) -> None:
    table = Table(box=None, pad_edge=False)
    table.add_column("mesh", overflow="fold")
    uncertain = is_uncertain(model)
    margin = ["margin"] if uncertain else []
    for heading in ("vertices", "S %", "M %", "U %", "β* 10/50/90 %", *margin, EPSILON_MIN, "s"):
        table.add_column(heading, justify="right", no_wrap=True)
    for row in rows:
        table.add_row(*_cells(row, uncertain=uncertain))
    console.print(table)
    legend = ", ".join(f"{code.name} {meaning}" for code, meaning in MEANING["label"].items())
    safe = f" ({SAFE_LABELS})" if model.certainty == "safe" else ""
    spare, medians = (
        (MARGIN, "margin and ε_min are medians") if uncertain else ("", "ε_min is a median")
    )
    console.print(
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
