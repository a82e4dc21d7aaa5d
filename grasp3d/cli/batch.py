"""The command `grasp3d batch`: labels a library of meshes, and writes tables and a report."""

import logging
import re
import signal
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import PurePath
from types import FrameType

from rich.progress import Progress, TextColumn

from grasp3d.batch.batch_settings import BatchSettings
from grasp3d.batch.chunks import Library
from grasp3d.batch.library import BatchProgress, label_library
from grasp3d.batch.report_page import REPORT
from grasp3d.batch.row import Outcome, Row, headed
from grasp3d.cli.commands import Batch
from grasp3d.cli.report import FAILED, NOTE, WARNING, Report, escaped, percent_text
from grasp3d.pictures.opengl import NO_OPENGL
from grasp3d.stability.label import MEANING
from grasp3d.system.names import counted, printable

LINE_INTERVAL = 10.0
"""Time between two lines of progress without a terminal [s]."""

MAX_ROWS = 60
"""Largest number of meshes that are printed one by one."""

MAX_MESSAGES = 20
"""Largest number of failures, and of warnings, that are printed; the report has all."""

MEASURED = 20.0
"""Time after which the remaining time can be estimated [s]."""


def run(command: Batch, report: Report) -> int:
    """Run the command, and return the exit code."""
    settings = BatchSettings(
        command.reach.touching(command.model), command.sampling, command.mesh, command.best,
        command.reach, command.load.chosen, command.more_hands,
    )  # fmt: skip
    with _show_progress(report) as progress, _interrupted_once():
        try:
            library = label_library(
                command.inputs, command.output, settings, cluster=command.cluster,
                surfaces=command.surfaces, part=command.part, progress=progress,
                overwrite=command.overwrite, force=command.force,
            )  # fmt: skip
        except KeyboardInterrupt as stop:
            without = " without --overwrite" * command.overwrite
            resume = f"the same command{without} labels the others"
            text = f"{progress.counts}; finished meshes are stored; {resume}"
            raise KeyboardInterrupt(text) from stop
    names = ["mesh", "outcome", "error"]
    failed = [row for row in library.rows(names) if row.outcome is not Outcome.LABELLED]
    if not command.quiet:
        print_library(report, library, failed, progress.first.finished)
    for row in failed if command.quiet else ():
        print(f"failed: {printable(row.error)}", file=sys.stderr)  # noqa: T201
    return 1 if failed else 0


@contextmanager
def _interrupted_once() -> Iterator[None]:
    """Stop the run cleanly at the first Ctrl-C, or at the signal with which clusters end a job.

    Later signals do not interrupt the process while it stops.
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
    """Display of a batch's progress; called at each change."""

    def __init__(self, bar: Progress) -> None:
        self._bar, self._task = bar, bar.add_task("labelling", total=1.0, status="")
        self._last_line, self._measured_from = 0.0, (0.0, 0.0)
        self._reasons: set[str] = set()
        self.first = BatchProgress(0, 0, 0, 0, 0.0)
        """The progress at the beginning."""
        self.counts = "no mesh was started"
        """Number of meshes that are done, in words."""

    def __call__(self, progress: BatchProgress) -> None:
        """Show the progress."""
        now, console = time.monotonic(), self._bar.console
        if not self._last_line:
            self._last_line = now
            self.first = progress
            self._bar.reset(self._task)
            left = counted(progress.left, "meshes")
            console.print(f"{left} to label, {progress.finished} finished before")
        self.counts = (
            f"{progress.labelled} labelled, {progress.failed} failed, {progress.left} left"
        )
        if progress.labelled + progress.failed == 1:  # the kernels may be compiled before that
            self._measured_from = now, progress.fraction
        status = f"{self.counts}{self._pace(progress, now)}"
        self._bar.update(self._task, completed=progress.fraction, status=status)
        if progress.row is not None and progress.row.outcome is not Outcome.LABELLED:
            self._show_failure(progress.row)
        is_due = progress.row and (now - self._last_line > LINE_INTERVAL or not progress.left)
        if is_due and not console.is_terminal:
            self._last_line = now
            console.print(status)

    def _pace(self, progress: BatchProgress, now: float) -> str:
        """Meshes per minute since the first one, and the time left, estimated from file sizes."""
        begun, before = self._measured_from
        done, seconds = progress.labelled + progress.failed - 1, now - begun
        if done < 1 or seconds < MEASURED:
            return ""
        left = seconds * (1.0 - progress.fraction) / (progress.fraction - before)
        time_left = f"{left / 3600.0:.1f} h" if left > 5400.0 else f"{left / 60.0:.0f} min"
        return f", {60.0 * done / seconds:.3g} a minute, about {time_left} to go"

    def _show_failure(self, row: Row) -> None:
        """Show the first failure of each kind at once."""
        text = row.error.replace(row.source, "").replace(PurePath(row.source).name, "")
        reason = re.sub(r"[-+\d.e]+", "#", text)
        if reason not in self._reasons:
            self._reasons.add(reason)
            self._bar.console.print(f"{FAILED} {escaped(row.error)}")


class _Lines(logging.Handler):
    """Log handler that prints warnings above a progress bar, a line each."""

    def __init__(self, bar: Progress) -> None:
        super().__init__(logging.WARNING)
        self._console = bar.console

    def emit(self, record: logging.LogRecord) -> None:
        """Print a warning."""
        self._console.print(f"{WARNING} {escaped(record.getMessage())}")


@contextmanager
def _show_progress(report: Report) -> Iterator[ProgressDisplay]:
    """Show the progress of a batch, and the package's log, within the context."""
    bar = report.bar(TextColumn("{task.fields[status]}"))
    log, handler = logging.getLogger("grasp3d"), _Lines(bar)
    log.addHandler(handler)
    try:
        with bar:
            yield ProgressDisplay(bar)
    finally:
        log.removeHandler(handler)


def print_library(report: Report, library: Library, failed: Sequence[Row], finished: int) -> None:
    """Print the results of a library: a line per mesh if there are few, warnings and failures.

    Args:
        report: Where to print.
        library: From `label_library`.
        failed: Rows of the meshes that have no labels.
        finished: Number of meshes that were finished before.
    """
    count = len(library.meshes)
    rows = library.rows() if count <= MAX_ROWS else []
    if rows:
        _print_table(report, rows)
    texts = library.table(["mesh", "warnings", "page", "thumbnail"]).to_pylist()
    warned = [f"{row['mesh']}: {row['warnings']}" for row in texts if row["warnings"]]
    for mark, lines in ((FAILED, [row.error for row in failed]), (WARNING, warned)):
        report.lines(lines[:MAX_MESSAGES], mark)
        if len(lines) > MAX_MESSAGES:
            report.line(f"{mark} {len(lines) - MAX_MESSAGES} more: see the report")
    before = f"; {finished} of them were finished before" if finished else ""
    report.line(f"{count - len(failed)} labelled, {len(failed)} failed{before}")
    if any(row["page"] and not row["thumbnail"] for row in texts):
        report.line(f"{NOTE} the report has no pictures: {NO_OPENGL}")
    report.written(str(library.folder), f"{library.folder}/{REPORT}")


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
