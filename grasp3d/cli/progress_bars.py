"""Progress bars on standard error."""

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import TypeVar

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

ResultT = TypeVar("ResultT")


@contextmanager
def progress(text: str, *, quiet: bool) -> Iterator[None]:
    """Show a progress bar for the computation inside."""
    with bar_of(TextColumn("{task.percentage:>3.0f} %"), quiet=quiet) as bar:
        task = bar.add_task(escaped(text), total=1.0)
        with running(progress=lambda fraction: bar.update(task, completed=fraction)):
            yield


def measure(compute: Callable[[], object], text: str, *, quiet: bool) -> None:
    """Compute something with a progress bar, as a step that a time limit names."""
    with progress(text, quiet=quiet):
        compute()


def counted_results(
    results: Iterable[ResultT], text: str, total: int, *, quiet: bool
) -> Iterator[ResultT]:
    """Pass on the results of meshes, with a progress bar that counts them."""
    with bar_of(MofNCompleteColumn(), quiet=quiet) as bar:
        yield from bar.track(results, total=total, description=text)


def bar_of(*columns: ProgressColumn, quiet: bool) -> Progress:
    """Make a progress bar with some columns after the bar, which only a terminal shows."""
    console = Console(stderr=True, quiet=quiet, soft_wrap=True, emoji=False)
    return Progress(
        TextColumn("{task.description}"), BarColumn(), *columns, TimeElapsedColumn(),
        console=console, transient=True, disable=quiet or not console.is_terminal,
    )  # fmt: skip
