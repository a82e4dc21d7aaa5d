"""What `grasp3d batch` prints: its progress, and the meshes and failures at the end."""

import logging
import time
from collections import Counter
from collections.abc import Collection, Iterator, Sequence
from contextlib import contextmanager
from typing import get_args

from rich.console import Console
from rich.filesize import decimal
from rich.progress import Progress, TextColumn, TimeRemainingColumn

from grasp3d._kernels import compilations
from grasp3d.batch.library import BatchProgress, LibraryLabels
from grasp3d.batch.report.pages import REPORT
from grasp3d.batch.row import Outcome, Row
from grasp3d.cli.progress_bars import bar_of
from grasp3d.cli.report import (
    CHECK_HINT,
    FAILED,
    MARGIN,
    WARNING,
    Report,
    angle_text,
    duration_text,
    escaped,
    table_of,
)
from grasp3d.grasps.verdict import Word
from grasp3d.settings import GraspModel
from grasp3d.settings.model_text import EPSILON_MIN, SAFE_LABELS, epsilon_min_text
from grasp3d.stability.label import MEANING
from grasp3d.system.counts import counted, noun

LINE_INTERVAL = 10.0
"""Time between two lines where there is no terminal [s]."""

_log = logging.getLogger("grasp3d")

MAX_ROWS = 60
"""Meshes up to which each of them is printed."""

MAX_MESSAGES = 20
"""Failures, and warnings, that are printed; the others are in the summary and the report."""


class ProgressDisplay:
    """Shows the progress of a batch; called with each change of it."""

    def __init__(self, bar: Progress, *, lines: Console | None) -> None:
        self._bar, self._lines = bar, lines
        self._task = bar.add_task("labelling", total=1.0, status="")
        self._started = self._last_line = 0.0
        self._progress: BatchProgress | None = None

    def __call__(self, progress: BatchProgress) -> None:
        """Show the progress."""
        now = time.monotonic()
        if self._progress is None:
            self._start(progress, now)
        self._progress = progress
        self._bar.update(self._task, completed=progress.fraction, status=self._status(now))
        if progress.row is None:
            return
        if self._lines is not None and (now - self._last_line > LINE_INTERVAL or not progress.left):
            self._last_line = now
            self._lines.print(self._status(now) + self._time_left())

    @property
    def counts(self) -> str:
        """How many meshes are done, as text."""
        if self._progress is None:
            return "no mesh was started"
        count = self._progress.finished + self._progress.labelled + self._progress.failed
        total = count + self._progress.left
        return f"{count} of {counted(total, 'meshes')} {'is' if total == 1 else 'are'} done"

    def _start(self, progress: BatchProgress, now: float) -> None:
        self._started = self._last_line = now
        self._bar.reset(self._task)
        what = counted(progress.left, "meshes")
        if self._lines is not None:
            self._lines.print(f"{what} to label, {progress.finished} finished before")
        if progress.stale:
            self._bar.console.print(
                "[yellow]warning:[/] labels made with other settings are replaced: "
                f"{counted(progress.stale, 'meshes')}"
            )

    def _status(self, now: float) -> str:
        progress = self._progress
        if progress is None:
            return ""
        count, seconds = progress.labelled + progress.failed, now - self._started
        rate = f", {count / seconds:.3g}/s" if count and seconds else ""
        largest = ""
        if progress.largest is not None:
            largest = f"; {escaped(progress.largest.name)} ({decimal(progress.largest.size)})"
        counts = f"{progress.labelled} labelled, {progress.failed} failed, {progress.left} left"
        return f"{counts}{rate}{largest}"

    def _time_left(self) -> str:
        seconds = self._bar.tasks[self._task].time_remaining
        return f"; about {duration_text(seconds)} left" if seconds else ""


@contextmanager
def show_progress(*, quiet: bool) -> Iterator[ProgressDisplay]:
    """Show the progress of a batch, and the package's log, for the duration of the context.

    Args:
        quiet: Show nothing.
    """
    bar = bar_of(TextColumn("{task.fields[status]}"), TimeRemainingColumn(), quiet=quiet)
    console = bar.console
    handler, level = _ConsoleHandler(console), _log.level
    _log.setLevel(logging.INFO)
    _log.addHandler(handler)
    try:
        with bar:
            yield ProgressDisplay(bar, lines=None if quiet or console.is_terminal else console)
    finally:
        _log.setLevel(level)
        _log.removeHandler(handler)


class _ConsoleHandler(logging.Handler):
    """Prints log messages of the run."""

    def __init__(self, console: Console) -> None:
        super().__init__(logging.INFO)
        self._console = console

    def emit(self, record: logging.LogRecord) -> None:
        """Print the line."""
        warning = record.levelno >= logging.WARNING and record.name != compilations.name
        mark = "[yellow]warning:[/] " if warning else ""
        self._console.print(f"{mark}{escaped(record.getMessage())}")


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
    output.warnings(library.warnings)
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
        unsure = [row for row in rows if row.verdict in {"perhaps", "not"}]
        lines = [f"{row.mesh}: {row.verdict_text}" for row in unsure]
        _print_some(output, "[bold]verdict:[/]", lines, "verdicts")
        output.paragraph(verdicts)
    before = f"; {library.finished} of them were finished before" if library.finished else ""
    output.paragraph(f"{len(rows) - len(failed)} labelled, {len(failed)} failed{before}")
    output.written(library.output)
    if report:
        output.lines([f"{library.output}/{REPORT}"], "report:")


def _verdicts(rows: Collection[Row]) -> str:
    """Return how many objects have which verdict; empty: none has one."""
    counts = Counter(row.verdict for row in rows if row.verdict)
    words = ", ".join(f"{counts[word]} {word}" for word in get_args(Word) if counts[word])
    return f"{words} held" if words else ""


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
    uncertain = model.is_uncertain
    margin = ["margin"] * uncertain
    names = ("vertices", "S %", "M %", "U %", "β* 10/50/90 %", *margin, EPSILON_MIN, "s")
    cells = (_cells(row, uncertain=uncertain) for row in rows)
    report.table(table_of(("mesh", *names), cells))
    legend = ", ".join(f"{code.name} {meaning}" for code, meaning in MEANING["label"].items())
    safe = f" ({SAFE_LABELS})" if model.location_error != 0.0 else ""
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
        *(["" if row.margin_p50 is None else angle_text(row.margin_p50)] * uncertain),
        "" if row.epsilon_min_p50 is None else f"{row.epsilon_min_p50:.3f}",
        f"{row.seconds:.1f}",
    ]
