"""Display of a batch's progress: a bar on a terminal, else lines at intervals; and a log file."""

import logging
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from rich.console import Console
from rich.filesize import decimal
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from grasp3d.batch.progress import BatchProgress
from grasp3d.batch.row import Outcome, Row
from grasp3d.cli.report import escaped
from grasp3d.errors import OutputError
from grasp3d.system import compiling
from grasp3d.system.counts import counted
from grasp3d.system.names import printable

LINE_INTERVAL = 10.0
"""Time between two lines where there is no terminal [s]."""

_log = logging.getLogger("grasp3d")


class ProgressDisplay:
    """Shows the progress of a batch; called with each change of it."""

    def __init__(self, bar: Progress, *, lines: Console | None) -> None:
        self._bar, self._lines = bar, lines
        self._task = bar.add_task("labelling", total=1.0, status="")
        self._started: float | None = None
        self._last_line = 0.0
        self._progress: BatchProgress | None = None

    def __call__(self, progress: BatchProgress) -> None:
        """Show the progress."""
        now = time.monotonic()
        if self._started is None:
            self._start(progress, now)
        self._progress = progress
        self._bar.update(self._task, completed=progress.fraction, status=self._status(now))
        if progress.row is None:
            return
        _log_row(progress.row)
        if self._lines is not None and (now - self._last_line > LINE_INTERVAL or not progress.left):
            self._last_line = now
            self._lines.print(self._status(now) + self._time_left())

    @property
    def counts(self) -> str:
        """How many meshes are done, as text."""
        if self._progress is None:
            return "no mesh was started"
        done = self._progress.finished + self._progress.labelled + self._progress.failed
        total = done + self._progress.left
        return f"{done} of {counted(total, 'meshes')} {'is' if total == 1 else 'are'} done"

    def _start(self, progress: BatchProgress, now: float) -> None:
        self._started = self._last_line = now
        self._bar.reset(self._task)
        what = counted(progress.left, "meshes")
        _log.info("%s to label, %d finished before", what, progress.finished)
        if self._lines is not None:
            self._lines.print(f"{what} to label, {progress.finished} finished before")
        if progress.stale:
            self._bar.console.print(
                "[yellow]warning:[/] labels made with other settings are replaced: "
                f"{counted(progress.stale, 'meshes')}"
            )

    def _status(self, now: float) -> str:
        progress = self._progress
        if progress is None or self._started is None:
            return ""
        done, seconds = progress.labelled + progress.failed, now - self._started
        rate = f", {done / seconds:.3g}/s" if done and seconds else ""
        largest = ""
        if progress.largest is not None:
            largest = f"; {escaped(progress.largest.name)} ({decimal(progress.largest.size)})"
        counts = f"{progress.labelled} labelled, {progress.failed} failed, {progress.left} left"
        return f"{counts}{rate}{largest}"

    def _time_left(self) -> str:
        left = self._bar.tasks[self._task].time_remaining
        return f"; about {_duration(left)} left" if left else ""


def _log_row(row: Row) -> None:
    if row.outcome == Outcome.LABELLED:
        _log.info("labelled %s in %.1f s", printable(row.mesh), row.seconds)
    else:
        _log.error("%s: %s", row.outcome, printable(row.error))


def _duration(seconds: float) -> str:
    """A time as text, in seconds, minutes or hours."""
    minutes, hours = seconds / 60.0, seconds / 3600.0
    if minutes < 1.5:
        return f"{seconds:.0f} s"
    return f"{minutes:.0f} min" if hours < 1.5 else f"{hours:.1f} h"


@contextmanager
def show_progress(*, quiet: bool, log: Path | None) -> Iterator[ProgressDisplay]:
    """Show the progress of a batch for the duration of the context.

    Args:
        quiet: Show nothing.
        log: File to which a line for each mesh is appended.

    Raises:
        OutputError: The log cannot be written.
    """
    console = Console(stderr=True, quiet=quiet, soft_wrap=True, emoji=False)
    bar = Progress(
        TextColumn("{task.description}"), BarColumn(bar_width=24),
        TextColumn("{task.fields[status]}"), TimeElapsedColumn(), TimeRemainingColumn(),
        console=console, transient=True, disable=quiet or not console.is_terminal,
    )  # fmt: skip
    with _logged(log, console), bar:
        yield ProgressDisplay(bar, lines=None if quiet or console.is_terminal else console)


@contextmanager
def _logged(path: Path | None, console: Console) -> Iterator[None]:
    """Append the package's log to a file, and show the messages of its modules."""
    handlers: list[logging.Handler] = [_ConsoleHandler(console)]
    if path is not None:
        try:
            handlers.append(logging.FileHandler(path, encoding="utf-8", errors="backslashreplace"))
        except OSError as error:
            raise OutputError(f"{path}: cannot be written ({error.strerror})") from error
        handlers[-1].setFormatter(logging.Formatter("%(asctime)s %(levelname)s %(message)s"))
    level = _log.level
    _log.setLevel(logging.INFO)
    for handler in handlers:
        _log.addHandler(handler)
    try:
        yield
    finally:
        _log.setLevel(level)
        for handler in handlers:
            _log.removeHandler(handler)
            handler.close()


class _ConsoleHandler(logging.Handler):
    """Prints log messages of the run; failures of meshes are counted, and printed at the end."""

    def __init__(self, console: Console) -> None:
        super().__init__(logging.INFO)
        self._console = console
        self.addFilter(lambda record: record.name != _log.name)

    def emit(self, record: logging.LogRecord) -> None:
        """Print the line."""
        warning = record.levelno >= logging.WARNING and record.name != compiling.logger.name
        mark = "[yellow]warning:[/] " if warning else ""
        self._console.print(f"{mark}{escaped(record.getMessage())}")
