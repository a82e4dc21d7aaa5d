"""`grasp3d batch`: labels a library of meshes, and writes tables and a report."""

import logging
import signal
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from types import FrameType

from rich.logging import RichHandler
from rich.progress import Progress, TextColumn, TimeRemainingColumn

from grasp3d.batch.batch_settings import BatchSettings
from grasp3d.batch.library import BatchProgress, LibraryLabels, label_library
from grasp3d.batch.report.index import REPORT
from grasp3d.batch.row import Outcome, Row, headed
from grasp3d.cli.commands import Batch
from grasp3d.cli.report import FAILED, NOTE, WARNING, Report, escaped, percent_text
from grasp3d.pictures.opengl import NO_OPENGL
from grasp3d.stability.label import MEANING
from grasp3d.system.counts import counted
from grasp3d.system.names import printable

LINE_INTERVAL = 10.0
"""Time between two lines where there is no terminal [s]."""

MAX_ROWS = 60
"""Meshes up to which each of them is printed."""

MAX_MESSAGES = 20
"""Failures, and warnings, that are printed; the others are in the summary and the report."""


def run(command: Batch, report: Report) -> int:
    """Run the command; returns the exit code."""
    settings = BatchSettings(
        command.reach.touching(command.model), command.sampling, command.mesh, command.best,
        command.reach, command.load.chosen,
    )  # fmt: skip
    with _show_progress(report) as progress, _interrupted_once():
        try:
            library = label_library(
                command.inputs, command.output, settings, cluster=command.cluster,
                progress=progress, overwrite=command.overwrite, force=command.force,
            )  # fmt: skip
        except KeyboardInterrupt as stop:
            without = " without --overwrite" * command.overwrite
            resume = f"the same command{without} labels the others"
            text = f"{progress.counts}; labelled meshes are stored; {resume}"
            raise KeyboardInterrupt(text) from stop
    if not command.quiet:
        print_library(report, library)
    for row in library.failed if command.quiet else ():
        print(f"failed: {printable(row.error)}", file=sys.stderr)  # noqa: T201
    return 1 if library.failed else 0


@contextmanager
def _interrupted_once() -> Iterator[None]:
    """End the run in order at the first Ctrl-C, or the signal by which clusters end a job.

    From then on the process, which ends, is not interrupted again.
    """
    signals = (signal.SIGINT, signal.SIGTERM)

    def interrupt(_number: int, _frame: FrameType | None) -> None:
        for number in signals:
            signal.signal(number, signal.SIG_IGN)
        raise KeyboardInterrupt

    before = {number: signal.signal(number, interrupt) for number in signals}
    try:
        yield
    finally:
        for number, handler in before.items():
            if signal.getsignal(number) is not signal.SIG_IGN:
                signal.signal(number, handler)


class ProgressDisplay:
    """Shows the progress of a batch; called with each change of it."""

    def __init__(self, bar: Progress) -> None:
        self._bar, self._task = bar, bar.add_task("labelling", total=1.0, status="")
        self._last_line = 0.0
        self.counts = "no mesh was started"
        """How many meshes are done."""

    def __call__(self, progress: BatchProgress) -> None:
        """Show the progress."""
        now, console = time.monotonic(), self._bar.console
        done = progress.labelled + progress.failed
        if not self._last_line:
            self._last_line = now
            self._bar.reset(self._task)
            left = counted(progress.left, "meshes")
            console.print(f"{left} to label, {progress.finished} finished before")
            if progress.stale:
                stale = counted(progress.stale, "meshes")
                console.print(f"{WARNING} labels made with other settings are replaced: {stale}")
        finished = progress.finished + done
        self.counts = f"{finished} of {counted(finished + progress.left, 'meshes')} are done"
        status = f"{progress.labelled} labelled, {progress.failed} failed, {progress.left} left"
        self._bar.update(self._task, completed=progress.fraction, status=status)
        is_due = progress.row and (now - self._last_line > LINE_INTERVAL or not progress.left)
        if is_due and not console.is_terminal:
            self._last_line = now
            console.print(status)


@contextmanager
def _show_progress(report: Report) -> Iterator[ProgressDisplay]:
    """Show the progress of a batch, and the package's log, for the duration of the context."""
    bar = report.bar(TextColumn("{task.fields[status]}"), TimeRemainingColumn())
    log = logging.getLogger("grasp3d")
    handler, level = RichHandler(console=bar.console, show_time=False, show_path=False), log.level
    log.setLevel(logging.INFO)
    log.addHandler(handler)
    try:
        with bar:
            yield ProgressDisplay(bar)
    finally:
        log.setLevel(level)
        log.removeHandler(handler)


def print_library(report: Report, library: LibraryLabels) -> None:
    """Print the results of a library: a line per mesh where they are few, warnings and failures.

    Args:
        report: Where to print.
        library: From `label_library`.
    """
    rows = list(library.rows.values())
    if len(rows) <= MAX_ROWS:
        _print_table(report, rows)
    warned = [f"{row.mesh}: {row.warnings}" for row in rows if row.warnings]
    for mark, lines in ((FAILED, [row.error for row in library.failed]), (WARNING, warned)):
        report.lines(lines[:MAX_MESSAGES], mark)
        if len(lines) > MAX_MESSAGES:
            report.line(f"{mark} {len(lines) - MAX_MESSAGES} more: see the report")
    before = f"; {library.finished} of them were finished before" if library.finished else ""
    failed = len(library.failed)
    report.line(f"{len(rows) - failed} labelled, {failed} failed{before}")
    if any(row.page and not row.thumbnail for row in rows):
        report.line(f"{NOTE} the report has no pictures: {NO_OPENGL}")
    report.written(library.output, f"{library.output}/{REPORT}")


def _print_table(report: Report, rows: Sequence[Row]) -> None:
    """Print a line for each mesh, with the columns of the report."""
    columns, lines = headed(rows), []
    for row in rows:
        texts = [""] * (len(columns) + 3)
        if row.outcome == Outcome.LABELLED:
            areas = (row.stable, row.ambiguous, row.no_grasp_found)
            texts = [*(percent_text(one or 0.0) for one in areas), *map(row.text, columns)]
        lines.append([escaped(row.mesh), row.verdict or row.outcome, *texts])
    headings = [column.heading.replace(" ", "\n", 1) for column in columns.values()]
    report.table(("mesh", "held", "S", "M", "U", *headings), lines, texts=(0, 1))
    letters = ", ".join(f"{code.name} {meaning}" for code, meaning in MEANING["label"].items())
    report.line(f"{letters}, of the area; the report says what the columns mean")
