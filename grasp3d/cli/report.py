"""Printed reports: lines, tables, and the marks and numbers in them.

Lines on what is uncertain, the margin that it leaves, and the load of grasps are those of several
commands. What prints them is imported when that is done: the help of a command does without it.
"""

import math
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from grasp3d.arrays import Floats
from grasp3d.quality.force_ranges import Certainty
from grasp3d.settings import GraspModel
from grasp3d.settings.model_text import SAFE_LABELS, friction_text
from grasp3d.settings.units import Unit, small_length
from grasp3d.stability.label import COLORS, MEANING, Label, Mode
from grasp3d.stability.thresholds import margin_budget
from grasp3d.surface.area_statistics import quantiles
from grasp3d.surface.load_case import LoadCase
from grasp3d.surface.load_result import LoadResult
from grasp3d.system.counts import counted, short_number
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

    def table(self, table: "Table") -> None:
        """Print a table from `table_of`."""
        self.console.print(table)

    def columns(self, columns: Sequence[Column], which: Sequence[int]) -> None:
        """Print all of a table of numbers, also where the console is too narrow for them.

        A narrow terminal shows its columns in several tables, each of which begins with the first.

        Args:
            columns: Their headings and cells.
            which: The rows.
        """
        parts, room = [columns], self.console.width if self.console.is_terminal else UNLIMITED
        if self._width(columns, which) > room:
            first, *others = columns
            parts = []
            for column in others:
                if not parts or self._width([*parts[-1], column], which) > room:
                    parts.append([first])
                parts[-1] = [*parts[-1], column]
        for part in parts:
            width = self._width(part, which)
            # A column of texts that is too wide by itself is folded.
            table = _table_of_columns(part, which, texts=len(part) if width > room else 0)
            table.width = min(width, room)
            self.console.print(table, crop=False)

    def _width(self, columns: Sequence[Column], which: Sequence[int]) -> int:
        """Characters in a line of a table."""
        unlimited = self.console.options.update(max_width=UNLIMITED)
        return self.console.measure(_table_of_columns(columns, which), options=unlimited).maximum

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


def _table_of_columns(
    columns: Sequence[Column], which: Iterable[int], *, texts: int = 0
) -> "Table":
    """Make a table from its columns, of which so many are texts."""
    rows = ([cell(row) for _, cell in columns] for row in which)
    return table_of([heading for heading, _ in columns], rows, texts=texts)


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
    """Format an angle in degrees; one that is not finite means that there is no grasp."""
    return f"{math.degrees(angle) + 0.0:.1f}°" if math.isfinite(angle) else "none"


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
    """Format a length of a mesh."""
    stated = "" if unit else " (unit not stated)"
    return f"{small_length(length, metres=unit is not None)}{stated}"


def model_words(model: GraspModel) -> str:
    """Friction and sensor resolution in words."""
    resolution = math.degrees(model.sensor_resolution)
    return f"friction {friction_text(model)}, sensor resolution {resolution:.4g}°"


MARGIN = "margin: friction angle to spare, S: above 0; "
LOAD = (
    "force: grip force that holds the load at the worst normals, in N; payload: mass that is held, "
    "in kg; "
)
"""Parts of the legend of a table."""

_HOW: dict[Certainty, str] = {
    "exact": "at the worst normals",
    "bound": "at the worst normals, a safe bound",
}


ROUNDING = 1e-9
"""Rounding error of sums of area fractions."""


class _Labelled(Protocol):
    """A surface or grasps with labels."""

    @property
    def model(self) -> Any: ...
    @property
    def critical_angle(self) -> Floats: ...
    @property
    def margin(self) -> Floats: ...


def uncertainty_lines(
    labelled: _Labelled, areas: Floats | None, *, of: str, unit: Unit | None
) -> list[str]:
    """What is uncertain, the margins, and the mean budget; nothing if only normals are.

    Args:
        labelled: Labels of a surface, or grasps.
        areas: Area of each vertex, shape (k,); None: all grasps equally.
        of: What the margins are of: 'area', 'grasps'.
        unit: Unit of the mesh.
    """
    model = labelled.model
    if not model.is_uncertain:
        return []
    lines = [f"uncertain: {'; '.join(_uncertainties(model, unit))}"]
    if model.location_error != 0.0:
        lines.append(f"safe labels: {SAFE_LABELS}")
    critical = np.where(np.isfinite(labelled.critical_angle), labelled.critical_angle, np.inf)
    areas = np.ones(len(critical)) if areas is None else areas
    of_grasps = np.where(np.isfinite(critical), areas, 0.0)
    if not of_grasps.sum() > 0.0:
        return lines
    margin = np.where(np.isfinite(critical), labelled.margin, -np.inf)
    texts = ", ".join(map(angle_text, quantiles(margin, LEVELS, areas)))
    return [
        *lines,
        f"margin, {PERCENTS} of the {of}: {texts} (S: above 0)",
        f"mean budget: {_mean_budget(model, critical, margin, of_grasps)}",
    ]


def _mean_budget(model: GraspModel, critical: Floats, margin: Floats, weights: Floats) -> str:
    """The means of the parts of the friction angle, over the grasps with a weight above 0."""
    rows = weights > 0.0
    budget = margin_budget(model, critical[rows], model.sure_angle - margin[rows])
    means = {name: float(np.average(one, weights=weights[rows])) for name, one in budget.items()}
    parts = [
        f"{name} {exact_angle(mean)}"
        for name, mean in means.items()
        if mean != 0.0 or name in {"critical angle", "margin"}
    ]
    return f"friction angle {exact_angle(sum(means.values()))} = {' + '.join(parts)}"


def margin_columns(grasps: _Labelled) -> list[Column]:
    """The margin of each grasp, if anything but the sensor's normals is uncertain."""
    margin: Column = ("margin", lambda row: angle_text(grasps.margin[row]))
    return [margin] * grasps.model.is_uncertain


def _uncertainties(model: GraspModel, unit: Unit | None) -> Sequence[str]:
    smallest, largest = model.friction_interval
    parts = [f"friction {friction_text(model)}"] if smallest < largest else []
    if model.location_error:
        parts.append(f"contact locations by {length_with_unit(model.location_error, unit)}")
    return parts


def load_line(case: LoadCase) -> str:
    """A load, and the force at hand."""
    mass = "mass not given" if case.mass is None else f"{short_number(case.mass)} kg"
    text = escaped(str(case.load.task))
    per_finger = f"{case.at_hand} per finger" if case.at_hand else "none given"
    return f"[bold]load[/]: {mass}, {text}; force at hand: {per_finger}"


def print_load(report: Report, load_result: LoadResult | None, areas: Floats | None = None) -> None:
    """Print a load, which part of the surface or which grasps hold it, and forces and payloads.

    Args:
        report: Where to print.
        load_result: What is held; None: there is no load, and nothing is printed.
        areas: Area fraction of each vertex of a surface, shape (k,); None: grasps are given.
    """
    if load_result is None:
        return
    report.line(load_line(load_result.case))
    force = load_result.case.at_hand
    if (
        load_result.remedy and np.isfinite(load_result.grip_force_largest).any()
    ):  # else the verdict says it
        report.line(f"  most grasps hold nothing: {escaped(load_result.remedy)}")
    count = len(load_result.grip_force)
    weights = np.ones(count) if areas is None else areas
    if load_result.label is not None:
        sums = {
            label.name: weights[load_result.label == label].sum() for label in sorted(Label)[::-1]
        }
        number = percent_text if areas is not None else "{:.0f}".format
        whole = "the surface" if areas is not None else f"{count} grasps"
        parts = ", ".join(f"{name} {number(part)}" for name, part in sums.items())
        report.paragraph(f"  held by {number(sums['S'])} of {whole} ({parts})")
    of, per = "grasps" if areas is None else "area", "" if load_result.case.decided else " per kg"
    part = _part_text(load_result.grip_force_largest, weights, f"of the {of}", "need at most", "N")
    report.line(f"  grip force{per} {_HOW[load_result.how]}: some suffices on {part}")
    if load_result.has_payload:
        payloads = np.where(load_result.payload > 0.0, load_result.payload, math.inf)
        part = _part_text(payloads, weights, f"of the {of}", "hold at most", "kg")
        report.line(f"  payload with {force}: above 0 on {part}")


def _part_text(values: Floats, weights: Floats, of: str, verb: str, unit: str) -> str:
    """Which part of the grasps has a finite value, and the quantiles over that part."""
    where = np.isfinite(values)
    part = weights[where].sum() / weights.sum()
    if not part > 0.0:
        return f"none {of}"
    numbers = quantiles(values[where], LEVELS, weights[where])
    texts = ", ".join(map(short_number, numbers))
    some = "all" if part > 1.0 - ROUNDING else percent_text(part)
    return f"{some} {of}, {PERCENTS} of which {verb} {texts} {unit}"


def force_text(force: float) -> str:
    """Format a force; inf: none suffices."""
    return "none" if not math.isfinite(force) else short_number(force)


def load_columns(load_result: LoadResult | None) -> list[Column]:
    """The grip force at the worst normals and the payload of grasps, as far as known."""
    if load_result is None:
        return []
    force: Column = ("force", lambda row: force_text(load_result.grip_force_largest[row]))
    payload: Column = ("payload", lambda row: short_number(load_result.payload[row]))
    return [force, *[payload] * load_result.has_payload]
