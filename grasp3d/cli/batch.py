"""`grasp3d batch`: labels a library of meshes, and writes tables and a report."""

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

from grasp3d.batch.batch_settings import BatchSettings
from grasp3d.batch.library import label_library
from grasp3d.cli import batch_report
from grasp3d.cli.commands import Batch


def run(command: Batch) -> int:
    """Run the command; returns the exit code."""
    settings = BatchSettings(
        command.reach.touching(command.model),
        command.sampling,
        command.mesh,
        command.best,
        command.reach,
        command.load.chosen,
    )
    with (
        batch_report.show_progress(quiet=command.quiet) as progress,
        _interrupted_once(),
    ):
        try:
            library = label_library(
                command.inputs,
                command.output,
                settings,
                cluster=command.cluster,
                progress=progress,
                overwrite=command.overwrite,
                force=command.force,
                report=command.report,
            )
        except KeyboardInterrupt as stop:
            raise KeyboardInterrupt(f"{progress.counts}; {_how_to_resume(command)}") from stop
    if command.quiet:
        batch_report.print_failed(library)
    else:
        batch_report.print_library(library, report=command.report)
    return 1 if library.failed else 0


def _how_to_resume(command: Batch) -> str:
    """How to resume an interrupted run."""
    if command.overwrite:
        return "labelled meshes are stored; the same command without --overwrite labels the others"
    return "labelled meshes are stored; the same command labels the others"


@contextmanager
def _interrupted_once() -> Iterator[None]:
    """End the run in order at the first Ctrl-C, or the signal by which clusters end a job."""
    signals = (signal.SIGINT, signal.SIGTERM)

    def interrupt(_number: int, _frame: FrameType | None) -> None:
        for number in signals:
            signal.signal(number, signal.SIG_IGN)
        raise KeyboardInterrupt

    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = [signal.signal(number, interrupt) for number in signals]
    try:
        yield
    finally:
        if signal.getsignal(signal.SIGINT) is interrupt:  # not interrupted
            for number, handler in zip(signals, before, strict=True):
                signal.signal(number, handler)
