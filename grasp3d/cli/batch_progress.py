"""How a batch goes, as it is shown: a bar on a terminal, else now and then a line; and a log."""

import logging
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from rich.console import Console
from rich.filesize import decimal
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from grasp3d.batch.row import Outcome, Row
from grasp3d.batch.state import BatchState
from grasp3d.cli.report import as_printed
from grasp3d.errors import OutputError
from grasp3d.system.names import printable

EVERY = 10.0
"""Time between two lines where there is no terminal [s]."""

_log = logging.getLogger("grasp3d")


class BatchProgress:
    """Shows how far a batch has come; called with each state."""

    def __init__(self, bar: Progress, *, lines: Console | None) -> None:
        self._bar, self._lines = bar, lines
        self._task = bar.add_task("labelling", total=1.0, told="")
        self._begun: float | None = None
        self._told_at = 0.0
        self._state: BatchState | None = None

    def __call__(self, state: BatchState) -> None:
        """Show a state."""
        now = time.monotonic()
        if self._begun is None:
            self._begin(state, now)
        self._state = state
        self._bar.update(self._task, completed=state.share, told=self._told(now))
        if state.row is None:
            return
        _log_row(state.row)
        if self._lines is not None and (now - self._told_at > EVERY or not state.left):
            self._told_at = now
            self._lines.print(self._told(now) + self._to_go())

    @property
    def counts(self) -> str:
        """How much is done, in words."""
        if self._state is None:
            return "nothing was begun"
        done = self._state.finished + self._state.labelled + self._state.failed
        return f"{done} of {done + self._state.left} meshes are done"

    def _begin(self, state: BatchState, now: float) -> None:
        self._begun = self._told_at = now
        self._bar.reset(self._task)
        _log.info("%d meshes to label, %d finished before", state.left, state.finished)
        if self._lines is not None:
            self._lines.print(f"{state.left} meshes to label, {state.finished} finished before")
        if state.stale:
            self._bar.console.print(
                f"[yellow]warning:[/] {state.stale} of them have labels of other settings, which "
                "are replaced"
            )

    def _told(self, now: float) -> str:
        state = self._state
        if state is None or self._begun is None:
            return ""
        done, seconds = state.labelled + state.failed, now - self._begun
        rate = f", {done / seconds:.3g}/s" if done and seconds else ""
        largest = ""
        if state.largest is not None:
            largest = f"; {as_printed(state.largest.name)} ({decimal(state.largest.size)})"
        return f"{state.labelled} labelled, {state.failed} failed, {state.left} left{rate}{largest}"

    def _to_go(self) -> str:
        left = self._bar.tasks[self._task].time_remaining
        return f"; about {_duration(left)} to go" if left else ""


def _log_row(row: Row) -> None:
    if row.outcome == Outcome.LABELLED:
        _log.info("labelled %s in %.1f s", printable(row.mesh), row.seconds)
    else:
        _log.error("%s: %s", row.outcome, printable(row.error))


def _duration(seconds: float) -> str:
    """Write a time as people say it."""
    minutes, hours = seconds / 60.0, seconds / 3600.0
    if minutes < 1.5:
        return f"{seconds:.0f} s"
    return f"{minutes:.0f} min" if hours < 1.5 else f"{hours:.1f} h"


@contextmanager
def batch_progress(*, quiet: bool, log: Path | None) -> Iterator[BatchProgress]:
    """Show how a batch goes until its end.

    Args:
        quiet: Show nothing.
        log: File that a line for each mesh is added to.

    Raises:
        OutputError: The log cannot be written.
    """
    console = Console(stderr=True, quiet=quiet, soft_wrap=True, emoji=False)
    bar = Progress(
        TextColumn("{task.description}"), BarColumn(bar_width=24),
        TextColumn("{task.fields[told]}"), TimeElapsedColumn(), TimeRemainingColumn(),
        console=console, transient=True, disable=quiet or not console.is_terminal,
    )  # fmt: skip
    with _logged(log, console), bar:
        yield BatchProgress(bar, lines=None if quiet or console.is_terminal else console)


@contextmanager
def _logged(path: Path | None, console: Console) -> Iterator[None]:
    """Add what the package tells to a file, and its warnings to what is shown."""
    handlers: list[logging.Handler] = [_Told(console)]
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


class _Told(logging.Handler):
    """Shows what the run itself tells; failures of meshes are counted, and told at the end."""

    def __init__(self, console: Console) -> None:
        super().__init__(logging.INFO)
        self._console = console
        self.addFilter(lambda record: record.name != _log.name)

    def emit(self, record: logging.LogRecord) -> None:
        """Print the line."""
        mark = "[yellow]warning:[/] " if record.levelno >= logging.WARNING else ""
        self._console.print(f"{mark}{as_printed(record.getMessage())}")
