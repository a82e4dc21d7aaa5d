"""Progress bars on standard error."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from typing import Any

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    ProgressColumn,
    TextColumn,
    TimeElapsedColumn,
)

from grasp3d.cli.report import escaped
from grasp3d.system.context import running


@contextmanager
def progress(text: str, *, quiet: bool) -> Iterator[None]:
    """Show a progress bar for the computation inside."""
    with bar_of(TextColumn("{task.percentage:>3.0f} %"), quiet=quiet) as bar:
        task = bar.add_task(escaped(text), total=1.0)
        with running(progress=lambda fraction: bar.update(task, completed=fraction)):
            yield


def each_mesh(
    work: Callable[..., Any], files: list[Any], settings: Any, *, lost: Callable[..., Any],
    text: str, command: Any,
) -> list[Any]:  # fmt: skip
    """Work on each mesh: on one here, on several in child processes; show a progress bar.

    Args:
        work: Called with a mesh, the settings and `force`; returns a result with a name.
        files: The meshes.
        settings: Passed on.
        lost: Makes the result of a mesh whose process failed.
        text: What is done.
        command: The options, with those of the processes.

    Returns:
        The results, by name.
    """
    from grasp3d.batch.run import run as run_each  # which most commands need not

    work = partial(work, force=command.force)
    if len(files) == 1:
        with progress(f"{text} {files[0].name}", quiet=command.quiet):
            return [work(files[0], settings)]
    results = run_each(work, files, settings, lost=lost, cluster=command.cluster, compiled=True)
    with bar_of(MofNCompleteColumn(), quiet=command.quiet) as bar:
        rows = bar.track(results, total=len(files), description=text)
        return sorted(rows, key=lambda row: row.name)


def bar_of(*columns: ProgressColumn, quiet: bool) -> Progress:
    """Make a progress bar with some columns after the bar, which only a terminal shows."""
    console = Console(stderr=True, quiet=quiet, soft_wrap=True, emoji=False)
    return Progress(
        TextColumn("{task.description}"), BarColumn(), *columns, TimeElapsedColumn(),
        console=console, transient=True, disable=quiet or not console.is_terminal,
    )  # fmt: skip
