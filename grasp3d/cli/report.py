"""Printed reports: lines, tables, and the marks and numbers in them.

What prints them is imported when that is done: the help of a command does without it.
"""

import math
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from grasp3d.settings import GraspModel
from grasp3d.settings.lengths import Unit
from grasp3d.settings.model_text import friction_text
from grasp3d.stability.label import COLORS, MEANING, Label, Mode
from grasp3d.system.counts import counted
from grasp3d.system.names import printable

if TYPE_CHECKING:
    from rich.table import Table

    from grasp3d.mesh import ObjectMesh

WARNING, NOTE, FAILED = "[yellow]warning:[/]", "[yellow]note:[/]", "[red]failed:[/]"
"""Marks at the beginning of a message."""

CHECK_HINT = "`grasp3d check` reports the defects of a mesh and their remedies"

Column = tuple[str, Callable[[int], str]]
"""Heading of a table's column, and the cell of each row."""

LEVELS = (0.1, 0.5, 0.9)
"""Levels of the quantiles that are printed."""
PERCENTS = "/".join(f"{100.0 * level:.0f}" for level in LEVELS) + " %"

UNLIMITED = 1000
"""Characters in a line, more than any table has."""


class Report:
    """What a command prints, in order.

    Texts have the markup of rich: what may contain brackets is `escaped`.
    """

    def __init__(self, *, errors: bool = False) -> None:
        """Begin a report.

        Args:
            errors: Print on standard error.
        """
        from rich.console import Console

        self.console = Console(stderr=errors, emoji=False)

    def line(self, text: str) -> None:
        """Print a line, which nothing but a terminal wraps."""
        self.console.print(text, soft_wrap=True)

    def lines(self, texts: Iterable[str], mark: str = "") -> None:
        """Print texts without markup, a line each, after a mark."""
        for text in texts:
            self.line(f"{mark} {escaped(text)}" if mark else escaped(text))

    def paragraph(self, text: str) -> None:
        """Print a text that is wrapped at words."""
        self.console.print(text)

    def written(self, *paths: Path | str) -> None:
        """Print the names of the files that were written."""
        self.line(f"written: {escaped(', '.join(map(str, paths)))}")

    def table(self, table: "Table", *, whole: bool = False) -> None:
        """Print a table.

        Args:
            table: From `table_of`.
            whole: Print all of its numbers, also where the console is too narrow for them.
        """
        if whole:
            unlimited = self.console.options.update(max_width=UNLIMITED)
            table.width = self.console.measure(table, options=unlimited).maximum
        self.console.print(table, crop=not whole)

    def heading(self, name: str, text: str) -> None:
        """Print a line on what has a name, which has no markup."""
        self.line(f"[bold]{escaped(name)}[/]: {text}")

    def mesh(self, mesh: "ObjectMesh", text: str) -> None:
        """Print the name and the size of a mesh, and a text with markup."""
        count, size = len(mesh.vertices), length_with_unit(mesh.size, mesh.unit)
        self.heading(mesh.report.source, f"{counted(count, 'vertices')}, size {size}; {text}")

    def warnings(self, texts: Iterable[str]) -> None:
        """Print warnings without markup, a line each."""
        self.lines(texts, WARNING)

    def labels(
        self,
        mode: Mode,
        headings: Sequence[str],
        cells: Callable[[Label], Sequence[str]],
        *,
        texts: int = 2,
    ) -> None:
        """Print a table with a line for each label.

        Args:
            mode: What labels are of, which gives their meaning.
            headings: Of the columns after label and meaning.
            cells: What a label has in them.
            texts: Number of columns of texts, see `table_of`.
        """
        rows = (
            (label_name(label), MEANING[mode][label], *cells(label))
            for label in sorted(Label)[::-1]
        )
        self.table(table_of(("label", "", *headings), rows, texts=texts))

    def fields(self, rows: Iterable[tuple[str, str]]) -> None:
        """Print names and their values, which have no markup."""
        cells = ((name, escaped(value)) for name, value in rows)
        self.table(table_of(("", ""), cells, texts=2))


def table_of(
    headings: Sequence[str], rows: Iterable[Sequence[str]], *, texts: int = 1, folded: bool = False
) -> "Table":
    """Make a table whose first columns are texts, which are folded where the console is narrow.

    Args:
        headings: Of all columns; all empty: the table has no line of headings.
        rows: Cells with markup.
        texts: Number of columns of texts; the others are numbers, aligned to the right.
        folded: Whether numbers are folded as well.
    """
    from rich.table import Table

    table = Table(box=None, pad_edge=False, show_header=any(headings))
    for number, heading in enumerate(headings):
        is_number = number >= texts
        cut = is_number and not folded
        table.add_column(
            heading, justify="right" if is_number else "left", no_wrap=cut,
            overflow="ellipsis" if cut else "fold",
        )  # fmt: skip
    for row in rows:
        table.add_row(*row)
    return table


def table_of_columns(columns: Sequence[Column], which: Iterable[int]) -> "Table":
    """Make a table of numbers from its columns.

    Args:
        columns: Their headings and cells.
        which: The rows.
    """
    rows = ([cell(row) for _, cell in columns] for row in which)
    return table_of([heading for heading, _ in columns], rows, texts=0)


def escaped(text: str) -> str:
    """Return a text for a report: one line, with markup characters escaped."""
    from rich.markup import escape

    return escape(printable(text))


def label_name(label: Label) -> str:
    """Return a label with a square of its colour."""
    color = "#{:02X}{:02X}{:02X}".format(*COLORS[label])
    return f"[{color}]■[/] {label.name}"


def percent_text(fraction: float) -> str:
    """Format a fraction in percent."""
    return f"{100.0 * fraction:.1f} %"


def angle_text(angle: float) -> str:
    """Format an angle in degrees; an infinite angle means that there is no grasp."""
    return "none" if math.isinf(angle) else f"{math.degrees(angle):.1f}°"


def exact_angle(angle: float) -> str:
    """Format an angle in hundredths of a degree."""
    return f"{round(math.degrees(angle), 2) + 0.0:.2f}°"  # never -0.00


def duration_text(seconds: float) -> str:
    """Format a time in seconds, minutes or hours."""
    minutes, hours = seconds / 60.0, seconds / 3600.0
    if minutes < 1.5:
        return f"{seconds:.0f} s"
    return f"{minutes:.0f} min" if hours < 1.5 else f"{hours:.1f} h"


def length_with_unit(length: float, unit: Unit | None) -> str:
    """Format a length in the mesh's unit."""
    return f"{length:.4g} {unit or '(unit not stated)'}"


def model_words(model: GraspModel) -> str:
    """Friction and sensor resolution in words."""
    resolution = math.degrees(model.sensor_resolution)
    return f"friction {friction_text(model)}, sensor resolution {resolution:.4g}°"
