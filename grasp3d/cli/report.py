"""Printed reports: lines, tables and named values, with their marks and numbers.

During a computation a report shows its progress on standard error.
"""

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from rich.console import Console
from rich.markup import escape
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    ProgressColumn,
    TextColumn,
    TimeElapsedColumn,
)
from rich.table import Table
from rich.text import Text

from grasp3d.grasps.evaluated_poses import EvaluatedPoses
from grasp3d.hand.frames import ObjectPose
from grasp3d.outcomes.success import SuccessRate
from grasp3d.settings.units import Unit, small_length
from grasp3d.stability.label import COLORS, MEANING, Label, Mode, hex_color
from grasp3d.surface.fields import GRASPS, LETTERS, NONE, Array, Field
from grasp3d.surface.grasp_table import GraspTable
from grasp3d.surface.load_case import LoadCase
from grasp3d.surface.sweeps import quantiles
from grasp3d.system.context import running
from grasp3d.system.names import counted, printable, short_number

if TYPE_CHECKING:
    from grasp3d.arrays import Floats
    from grasp3d.batch.inputs import MeshFile
    from grasp3d.jobs.running import Done
    from grasp3d.mesh import ObjectMesh

Grasps = GraspTable | EvaluatedPoses

WARNING, NOTE, FAILED = "[yellow]warning:[/]", "[yellow]note:[/]", "[red]failed:[/]"
"""Marks at the beginning of a message."""

LEVELS = (0.1, 0.5, 0.9)
"""Levels of the printed quantiles."""
PERCENTS = "/".join(f"{100.0 * level:.0f}" for level in LEVELS) + " %"

LEAST_WIDTH = 16
"""Width in characters below which a narrow terminal does not fold a text."""

UNLIMITED = 10_000
"""Line width of a file or a pipe in characters, more than any table needs."""


class Report:
    """Output of a command, in order.

    Texts have the markup of rich; `escaped` is applied to what may contain brackets. Lines wrap at
    the width of a terminal, and are whole in a file or a pipe.
    """

    def __init__(self, *, quiet: bool = False) -> None:
        """Begin a report.

        Args:
            quiet: Print nothing.
        """
        self.console = Console(quiet=quiet, emoji=False)
        if not self.console.is_terminal:
            self.console.width = UNLIMITED

    def bar(self, *columns: ProgressColumn) -> Progress:
        """Return a progress bar with columns after the bar, which only a terminal shows."""
        quiet = self.console.quiet
        console = Console(stderr=True, quiet=quiet, soft_wrap=True, emoji=False)
        return Progress(
            TextColumn("{task.description}"), BarColumn(), *columns, TimeElapsedColumn(),
            console=console, transient=True, disable=quiet or not console.is_terminal,
        )  # fmt: skip

    @contextmanager
    def progress(self, text: str) -> Iterator[None]:
        """Show a progress bar for the computation in the context."""
        with self.bar(TextColumn("{task.percentage:>3.0f} %")) as bar:
            task = bar.add_task(escaped(text), total=1.0)
            with running(progress=lambda fraction: bar.update(task, completed=fraction)):
                yield

    def each_mesh(
        self, work: Callable[..., Any], files: list["MeshFile"], settings: Any, *,
        text: str, command: Any,
    ) -> "list[Done[MeshFile, Any]]":  # fmt: skip
        """Process each mesh with a progress bar: a single one here, several in child processes.

        Args:
            work: Called with a mesh, the settings and `force`.
            files: The meshes.
            settings: Settings, passed on.
            text: Description of the work.
            command: Options of the command, including those of the processes.

        Returns:
            The result or error of each mesh, sorted by name.
        """
        from grasp3d.jobs.child import LostError  # most commands do not need it
        from grasp3d.jobs.running import run

        task, cluster = partial(work, settings=settings, force=command.force), command.cluster
        if len(files) == 1:
            with self.progress(f"{text} {files[0].name}"):
                return list(run(task, files, cluster=replace(cluster, workers=0, scheduler=None)))
        results = run(task, files, cluster=cluster, compiled=True)
        with self.bar(MofNCompleteColumn()) as bar:
            every = list(bar.track(results, total=len(files), description=text))
        named = [
            replace(one, error=LostError(f"{one.job.source}: {one.error}"))
            if isinstance(one.error, LostError)
            else one
            for one in every
        ]
        return sorted(named, key=lambda done: done.job.name)

    def line(self, text: str) -> None:
        """Print a line, which a terminal wraps at words."""
        self.console.print(text)

    def lines(self, texts: Iterable[str], mark: str = "") -> None:
        """Print texts without markup, one per line, after a mark."""
        for text in texts:
            self.line(f"{mark} {escaped(text)}" if mark else escaped(text))

    def warnings(self, texts: Iterable[str]) -> None:
        """Print warnings without markup, a line each."""
        self.lines(texts, WARNING)

    def written(self, *paths: Path | str) -> None:
        """Print the names of the written files."""
        self.line(f"written: {escaped(', '.join(map(str, paths)))}")

    def heading(self, name: str, text: str) -> None:
        """Print a line of text after a name, which has no markup."""
        self.line(f"[bold]{escaped(name)}[/]: {text}")

    def mesh(self, mesh: "ObjectMesh", text: str) -> None:
        """Print the name and the size of a mesh, and a text with markup."""
        count, size = len(mesh.vertices), length_with_unit(mesh.size, mesh.unit)
        self.heading(mesh.report.source, f"{counted(count, 'vertices')}, size {size}; {text}")

    def table(
        self, headings: Sequence[str], rows: Iterable[Sequence[str]], *, texts: Sequence[int] = (0,)
    ) -> None:
        """Print a table, in full even if the console is too narrow for it.

        Args:
            headings: Headings of all columns; all empty: the table has no line of headings.
            rows: Cells with markup.
            texts: Numbers of the text columns, which a narrow terminal folds; others are numbers.
        """
        if self.console.quiet:
            return
        table, cells = Table(box=None, pad_edge=False, show_header=any(headings)), list(rows)
        for number, heading in enumerate(headings):
            is_text = number in texts
            longest = max((Text.from_markup(row[number]).cell_len for row in cells), default=0)
            table.add_column(
                heading, justify="left" if is_text else "right", no_wrap=not is_text,
                overflow="fold", min_width=min(longest, LEAST_WIDTH),
            )  # fmt: skip
        for row in cells:
            table.add_row(*row)
        unlimited = self.console.options.update(max_width=UNLIMITED)
        least = self.console.measure(table, options=unlimited).minimum
        width = self.console.width
        self.console.width = max(least, width)
        with self.console.capture() as printed:
            self.console.print(table)
        self.console.width = width
        lines = (line.rstrip() for line in printed.get().splitlines())
        print(*lines, sep="\n", file=self.console.file)

    def values(self, rows: Iterable[tuple[str, str]]) -> None:
        """Print names with their values, which have no markup."""
        self.table(("", ""), ((name, escaped(value)) for name, value in rows), texts=(0, 1))

    def letters(self, mode: Mode, columns: Mapping[str, Callable[[Label], str]]) -> None:
        """Print a table with a line for each label.

        Args:
            mode: What the labels describe, which gives their meaning.
            columns: For each further column its heading, and its text for a label.
        """
        rows = (
            (label_name(one), MEANING[mode][one], *(cell(one) for cell in columns.values()))
            for one in sorted(Label)[::-1]
        )
        self.table(("label", "", *columns), rows, texts=(0, 1))

    def rates(self, of: str, rates: Iterable[tuple[str, SuccessRate]]) -> None:
        """Print success rates of grasps, with confidence intervals.

        Args:
            of: Heading of the first column.
            rates: First cells of the rows, with markup, and rates; those of no grasps are omitted.
        """
        rows = (
            (name, f"{one.count:,}", f"{100.0 * one.rate:.0f} %",
             "{:.0f} to {:.0f} %".format(*(100.0 * end for end in one.interval)))
            for name, one in rates
            if one.count
        )  # fmt: skip
        self.table((of, "grasps", "held", "95 %"), rows)

    def grasps(self, grasps: Grasps, which: Sequence[int]) -> None:
        """Print a table of grasps, with the columns that have a heading and their meanings.

        Args:
            grasps: The grasps; columns that they lack are left out.
            which: Rows to print.
        """
        fields = GRASPS if isinstance(grasps, GraspTable) else grasps.fields
        metres = grasps.mesh.unit is not None
        headed = ((field, field.values_of(grasps)) for field in fields if field.heading)
        shown = [(field, values) for field, values in headed if values is not None]
        texts = [number for number, (field, _) in enumerate(shown, 1) if field.kind == "U"]
        rows = (
            [str(row + 1), *(cell(field, values[row], metres=metres) for field, values in shown)]
            for row in which
        )
        of = "grasp" if isinstance(grasps, GraspTable) else "pose"
        self.table([of, *(one.title(metres=metres) for one, _ in shown)], rows, texts=texts)
        meanings = [f"{field.heading}: {field.meaning}" for field, _ in shown if field.meaning]
        self.line("; ".join(meanings))


def cell(field: Field, value: Any, *, metres: bool) -> str:
    """Format a value of a declared column, a label with its colour; see `Field.text`."""
    if field.texts == LETTERS:
        return label_name(Label(int(value)))
    return escaped(field.text(value, metres=metres))


def quantiles_text(field: Field, values: Array, weights: "Floats", *, metres: bool) -> str:
    """Format the quantiles of a declared column, with its heading.

    Args:
        field: The column.
        values: Its values, shape (k,).
        weights: Weight of each row, shape (k,), not all 0.
        metres: As in `cell`.
    """
    numbers = quantiles(np.where(np.isnan(values), field.worst, values), LEVELS, weights)
    heading = field.title(metres=metres).replace("\n", " in ")
    return f"{heading} {', '.join(cell(field, one, metres=metres) for one in numbers)}"


def escaped(text: str) -> str:
    """Return a text for a report: one line, with markup characters escaped."""
    return escape(printable(text))


def label_name(label: Label) -> str:
    """Return a label with a square of its colour."""
    return f"[{hex_color(COLORS[label])}]■[/] {label.name}"


def percent_text(fraction: float) -> str:
    """Format a fraction in percent."""
    return f"{100.0 * fraction:.1f} %"


def label_meaning(label: Label) -> str:
    """Return a label with a square of its colour, and its meaning for given contacts."""
    return f"{label_name(label)} {MEANING['scan'][label]}"


def angle_text(angle: float) -> str:
    """Format an angle in degrees; an angle that is not finite means that there is no grasp."""
    return f"{math.degrees(angle) + 0.0:.1f}°" if math.isfinite(angle) else NONE


def exact_angle(angle: float) -> str:
    """Format an angle in degrees with two decimals."""
    return f"{round(math.degrees(angle), 2) + 0.0:.2f}°"  # never -0.00


def length_with_unit(length: float, unit: Unit | None) -> str:
    """Format a length of a mesh."""
    stated = "" if unit else " (unit not stated)"
    return f"{small_length(length, metres=unit is not None)}{stated}"


def frame_text(pose: ObjectPose | None) -> str:
    """State the frame of the poses in a file."""
    frame = "mesh's frame" if pose is None else f"robot's frame {pose.frame!r}"
    return f"poses in the file: in the {frame}"


def load_line(case: LoadCase) -> str:
    """Describe a load and the available force."""
    mass = "mass not given" if case.mass is None else f"{short_number(case.mass)} kg"
    text = escaped(str(case.load.task))
    per_finger = f"{case.force_text} per finger" if case.force_text else "none given"
    force = "" if case.by_motors else f"; available force: {per_finger}"
    return f"[bold]load[/]: {mass}, {text}{force}"
