"""What `grasp3d batch` prints: a table of the meshes, what failed, and where the results are."""

from collections.abc import Collection, Sequence

from rich.console import Console
from rich.table import Table

from grasp3d.batch.library import REPORT, LibraryLabels
from grasp3d.batch.row import Outcome, Row
from grasp3d.cli.report import MORE, angle_text, as_printed
from grasp3d.stability.label import MEANING

MOST_ROWS = 60
"""Meshes of a library that are printed one by one."""

MOST_TOLD = 20
"""Failures, and warnings, that are printed; the others are in the summary and the report."""


def print_library(library: LibraryLabels, *, report: bool) -> None:
    """Print what came of a library: a line per mesh where they are few, and what to mind.

    Args:
        library: From `label_library`.
        report: Whether the report was written.
    """
    console = Console(emoji=False)
    rows = library.rows.values()
    if len(rows) <= MOST_ROWS:
        _print_table(console, rows)
    for told in library.told:
        console.print(f"[yellow]warning:[/] {as_printed(told)}", soft_wrap=True)
    failed = [as_printed(row.error) for row in library.failed]
    _print_some(console, "[red]failed:[/]", failed, "failures")
    warned = [
        as_printed(f"{row.mesh}: {row.warnings}")
        for row in rows
        if row.outcome == Outcome.LABELLED and row.warnings
    ]
    _print_some(console, "[yellow]warning:[/]", warned, "warnings")
    if failed or warned:
        console.print(MORE)
    before = f"; {library.finished} of them were finished before" if library.finished else ""
    console.print(f"{len(rows) - len(failed)} labelled, {len(failed)} failed{before}")
    console.print(f"written: {as_printed(library.output)}", soft_wrap=True)
    if report:
        console.print(f"report: {as_printed(f'{library.output}/{REPORT}')}", soft_wrap=True)


def print_failed(library: LibraryLabels) -> None:
    """Print on standard error what failed, and nothing else."""
    console = Console(stderr=True, emoji=False)
    _print_some(console, "failed:", [as_printed(row.error) for row in library.failed], "failures")


def _print_some(console: Console, mark: str, lines: Sequence[str], what: str) -> None:
    for line in lines[:MOST_TOLD]:
        console.print(f"{mark} {line}", soft_wrap=True)
    if len(lines) > MOST_TOLD:
        console.print(f"{mark} {len(lines) - MOST_TOLD} more {what}: see the summary or the report")


def _print_table(console: Console, rows: Collection[Row]) -> None:
    table = Table(box=None, pad_edge=False)
    table.add_column("mesh", overflow="fold")
    for heading in ("vertices", "S %", "M %", "U %", "β* 10/50/90 %", "ε_min", "s"):
        table.add_column(heading, justify="right", no_wrap=True)
    for row in rows:
        table.add_row(*_cells(row))
    console.print(table)
    legend = ", ".join(f"{code.name} {meaning}" for code, meaning in MEANING["label"].items())
    console.print(
        f"{legend}; shares of the area; β* critical friction angle; "
        "ε_min: smallest epsilon over the tilts, at half of the area"
    )


def _cells(row: Row) -> list[str]:
    if row.outcome != Outcome.LABELLED:
        return [as_printed(row.mesh), f"[red]{row.outcome}[/]", *[""] * 5, f"{row.seconds:.1f}"]
    shares = (row.stable, row.ambiguous, row.no_grasp_found)
    angles = (row.critical_angle_p10, row.critical_angle_p50, row.critical_angle_p90)
    return [
        as_printed(row.mesh),
        str(row.vertices),
        *(f"{100.0 * share:.1f}" for share in shares if share is not None),
        " ".join(angle_text(angle) for angle in angles if angle is not None),
        "" if row.epsilon_min_p50 is None else f"{row.epsilon_min_p50:.3f}",
        f"{row.seconds:.1f}",
    ]
