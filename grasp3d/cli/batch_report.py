"""What `grasp3d batch` prints: its progress, and the meshes and failures at the end."""

import logging
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from rich.console import Console
from rich.progress import Progress, TextColumn, TimeRemainingColumn

from grasp3d._kernels import compilations
from grasp3d.batch.library import BatchProgress, LibraryLabels
from grasp3d.batch.report.pages import COLUMNS, REPORT
from grasp3d.batch.row import Outcome, Row
from grasp3d.cli.progress_bars import bar_of
from grasp3d.cli.report import (
    CHECK_HINT,
    FAILED,
    WARNING,
    Report,
    duration_text,
    escaped,
    percent_text,
)
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
        now, left = time.monotonic(), counted(progress.left, "meshes")
        if self._progress is None:
            self._started = self._last_line = now
            self._bar.reset(self._task)
            if self._lines is not None:
                self._lines.print(f"{left} to label, {progress.finished} finished before")
            if progress.stale:
                stale = counted(progress.stale, "meshes")
                text = f"labels made with other settings are replaced: {stale}"
                self._bar.console.print(f"{WARNING} {text}")
        self._progress = progress
        status = self._status(progress, now)
        self._bar.update(self._task, completed=progress.fraction, status=status)
        if self._lines is None or progress.row is None:
            return
        if now - self._last_line > LINE_INTERVAL or not progress.left:
            self._last_line = now
            seconds = self._bar.tasks[self._task].time_remaining
            rest = f"; about {duration_text(seconds)} left" if seconds else ""
            self._lines.print(f"{status}{rest}")

    @property
    def counts(self) -> str:
        """How many meshes are done, as text."""
        if self._progress is None:
            return "no mesh was started"
        count = self._progress.finished + self._progress.labelled + self._progress.failed
        total = count + self._progress.left
        return f"{count} of {counted(total, 'meshes')} {'is' if total == 1 else 'are'} done"

    def _status(self, progress: BatchProgress, now: float) -> str:
        count, seconds = progress.labelled + progress.failed, now - self._started
        rate = f", {count / seconds:.3g}/s" if count and seconds else ""
        return f"{progress.labelled} labelled, {progress.failed} failed, {progress.left} left{rate}"


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
        mark = f"{WARNING} " if warning else ""
        self._console.print(f"{mark}{escaped(record.getMessage())}")


def print_library(library: LibraryLabels, *, report: bool) -> None:
    """Print the results of a library: a line per mesh where they are few, warnings and failures.

    Args:
        library: From `label_library`.
        report: Whether the report was written.
    """
    output, rows = Report(), list(library.rows.values())
    if len(rows) <= MAX_ROWS:
        _print_table(output, rows)
    output.warnings(library.warnings)
    failed = [row.error for row in library.failed]
    _print_some(output, FAILED, failed, "failures")
    labelled = [row for row in rows if row.outcome == Outcome.LABELLED]
    warned = [f"{row.mesh}: {row.warnings}" for row in labelled if row.warnings]
    _print_some(output, WARNING, warned, "warnings")
    if failed or warned:
        output.line(CHECK_HINT)
    unsure = [f"{row.mesh}: {row.verdict_text}" for row in rows if row.verdict in UNSURE]
    _print_some(output, "[bold]verdict:[/]", unsure, "verdicts")
    if verdicts := Counter(row.verdict for row in rows if row.verdict):
        output.line(f"{', '.join(f'{count} {word}' for word, count in verdicts.items())} held")
    before = f"; {library.finished} of them were finished before" if library.finished else ""
    output.line(f"{len(rows) - len(failed)} labelled, {len(failed)} failed{before}")
    output.written(library.output, *[f"{library.output}/{REPORT}"] * report)


UNSURE = {"perhaps", "not"}
"""Verdicts whose reasons are printed."""


def print_failed(library: LibraryLabels) -> None:
    """Print only the failures, to standard error."""
    errors = [row.error for row in library.failed]
    _print_some(Report(errors=True), "failed:", errors, "failures")


def _print_some(report: Report, mark: str, lines: Sequence[str], what: str) -> None:
    report.lines(lines[:MAX_MESSAGES], mark)
    more = len(lines) - MAX_MESSAGES
    if more > 0:
        report.line(f"{mark} {more} more {noun(more, what)}: see the summary or the report")


def _print_table(report: Report, rows: Sequence[Row]) -> None:
    """Print a line for each mesh, with the columns of the report."""
    labelled = [row for row in rows if row.outcome == Outcome.LABELLED]
    columns = [column for column in COLUMNS if any(map(column.text, labelled))]
    lines = []
    for row in rows:
        texts = [""] * (len(columns) + 3)
        if row.outcome == Outcome.LABELLED:
            areas = (row.stable, row.ambiguous, row.no_grasp_found)
            texts = [percent_text(one or 0.0) for one in areas]
            texts += [column.text(row) for column in columns]
        lines.append([escaped(row.mesh), row.outcome, *texts])
    headings = [column.title.replace(" ", "\n", 1) for column in columns]
    report.table(("mesh", "", "S", "M", "U", *headings), lines, texts=(0, 1))
    letters = ", ".join(f"{code.name} {meaning}" for code, meaning in MEANING["label"].items())
    report.line(f"{letters}, of the area; the report says what the columns mean")
