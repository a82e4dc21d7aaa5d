"""Printed report of `grasp3d sweep`."""

import math
from collections.abc import Iterable, Sequence
from itertools import chain
from pathlib import Path

import numpy as np
from rich.table import Table

from grasp3d.batch.sweeping import SweptMesh, SweptTarget, Target
from grasp3d.cli.report import FAILED, NOTE, Report, escaped, table_of
from grasp3d.plots.fractions import meaning_in
from grasp3d.settings import GraspModel
from grasp3d.surface.sweeps import Sweep
from grasp3d.surface.sweeps.axes import AXES, FRICTION, RESOLUTION, AxisName, describe_value

MIN_RESOLUTION = 0.05
"""Resolution below which no sensor is fine enough [degrees]."""

MAX_CREASES = 1.0 / 3.0
"""Area fraction of creases that gives a note, relative to the area that need not be S."""

MAX_COLUMNS, MAX_ANGLES = 5, 6
"""Columns that fit beside a name: of area fractions, and of angles."""

MAX_ROWS = 8
"""Rows of a sweep with other axes than friction and resolution that are printed."""


def print_sweeps(targets: Sequence[SweptTarget], fractions: Sequence[float]) -> None:
    """Print the area fractions at some of the resolutions, and the required resolutions.

    Args:
        targets: Swept targets; every mesh of a folder has a line in the second table.
        fractions: Area fractions of S for which the required resolution is printed.
    """
    sweeps = [sweep for target in targets for sweep in target.shown]
    if not sweeps:
        return
    report, axes = Report(), sweeps[0].axes
    fixed = "" if axes.is_default else f", {axes.fixed_text}"
    columns = _axis(sweeps, sweeps[0].columns)
    report.line(f"area fractions of S/M/U [%] by {columns}{fixed}:")
    fractions_of = (
        [list(map(_percents, *rows)) for rows in zip(one.stable, one.ambiguous, strict=True)]
        for one in sweeps
    )
    report.table(_grid_table(sweeps, fractions_of))
    legend = ", ".join(f"{label.name} {words}" for label, words in meaning_in(sweeps).items())
    report.line(escaped(legend))
    if not fractions:
        return
    report.line(
        "\nrequired resolution: below it at least this fraction of the surface is S "
        "(none: at no resolution)"
    )
    every = list(dict.fromkeys(sweep for target in targets for sweep in target.sweeps))
    if sweeps[0].columns == RESOLUTION:
        report.table(_required_table(every, fractions))
        return
    for fraction in fractions:
        report.paragraph(f"{100.0 * fraction:g} %, by {columns}:")
        required = (
            [list(map(_angle, row)) for row in one.required_resolution(fraction)] for one in every
        )
        report.table(_grid_table(every, required))


def print_notes(
    targets: Sequence[Target], meshes: Sequence[SweptMesh], fractions: Sequence[float]
) -> None:
    """Print errors, warnings and notes.

    Args:
        targets: Targets of the sweep.
        meshes: Swept meshes of the targets.
        fractions: As in `print_sweeps`.
    """
    report = Report()
    for target in targets:
        if not target.files and Path(target.name).exists():
            name = escaped(target.name)
            report.line(
                f"{NOTE} {name} is the shape in closed form; for the file or folder of that name "
                f"write ./{name}"
            )
    for mesh in meshes:
        report.lines([mesh.error] if mesh.error else [], FAILED)
        report.warnings(f"{mesh.name}: {line}" for line in mesh.warnings)
    _print_crease_note(report, meshes, fractions)
    failed = sum(1 for mesh in meshes if mesh.error)
    if failed:
        report.paragraph(f"{len(meshes) - failed} swept, {failed} failed")


def _print_crease_note(
    report: Report, meshes: Sequence[SweptMesh], fractions: Sequence[float]
) -> None:
    """Print the meshes whose required resolution depends on the length of their edges."""
    limit = MAX_CREASES * (1.0 - max(fractions, default=0.0))
    creased = [mesh for mesh in meshes if fractions and mesh.crease_fraction > limit]
    if creased:
        names = ", ".join(f"{mesh.name} {100.0 * mesh.crease_fraction:.0f} %" for mesh in creased)
        report.line(
            f"{NOTE} the area includes strips along creases, on {escaped(names)}; they are smaller "
            f"on a finer mesh (--max-edge), so the resolution required for "
            f"{100.0 * max(fractions):g} % may be larger than printed here"
        )


def _grid_table(sweeps: Sequence[Sweep], cells: Iterable[Sequence[Sequence[str]]]) -> Table:
    """Return a table with some of the columns of sweeps.

    Args:
        sweeps: The sweeps.
        cells: Their cells, by sweep, row and column.
    """
    first = sweeps[0]
    columns, values = _shown_columns(first), first.axes.values[first.columns]
    headings = [describe_value(first.columns, float(values[one]), first.unit) for one in columns]
    shown = ([[row[column] for column in columns] for row in rows] for rows in cells)
    return _named_table(sweeps, headings, shown)


def _named_table(
    sweeps: Sequence[Sweep], headings: Sequence[str], cells: Iterable[Sequence[Sequence[str]]]
) -> Table:
    """Return a table with a line for each sweep and some of its rows.

    Args:
        sweeps: The sweeps.
        headings: Of the cells.
        cells: By sweep, row and column.
    """
    first = sweeps[0]
    lines = (
        ("" if number else escaped(sweep.name), text, *rows[row])
        for sweep, rows in zip(sweeps, cells, strict=True)
        for number, (row, text) in enumerate(_row_texts(first).items())
    )
    return _wide(table_of(("", _axis(sweeps, first.rows, "\n"), *headings), lines))


def _wide(table: Table) -> Table:
    """A table whose first column has the names of sweeps."""
    table.columns[0].min_width = 12
    return table


def _axis(sweeps: Sequence[Sweep], name: AxisName, separator: str = " ") -> str:
    """Return the name of an axis, with the unit of values that are printed without unit."""
    words = AXES[name].words
    if name != "location_error" or sweeps[0].unit:
        return words
    units = {"scan": "radius = 1", "label": "in the mesh's unit"}
    modes = dict.fromkeys(sweep.mode for sweep in sweeps)
    return f"{words}{separator}({', '.join(units[mode] for mode in modes)})"


def _percents(stable: float, ambiguous: float) -> str:
    """Format the fractions of S, M and U as whole percents whose sum is 100."""
    first, second = round(100.0 * stable), round(100.0 * (stable + ambiguous))
    return f"{first}/{second - first}/{100 - second}"


def _shown_columns(sweep: Sweep) -> list[int]:
    """Return indices of evenly spaced columns; the default resolution replaces its neighbour."""
    values = sweep.axes.values[sweep.columns]
    if len(values) <= MAX_COLUMNS:
        return list(range(len(values)))
    resolutions = np.linspace(values[0], values[-1], MAX_COLUMNS)
    default = GraspModel().sensor_resolution
    if sweep.columns == RESOLUTION and np.isclose(values[1:-1], default).any():
        inner = resolutions[1:-1]
        inner[np.argmin(np.abs(inner - default))] = default
    return sorted({int(np.argmin(np.abs(values - value))) for value in resolutions})


def _row_texts(sweep: Sweep) -> dict[int, str]:
    """Return the values of rows by index: all of the default axes, otherwise evenly spaced ones."""
    count, values = len(sweep.stable), sweep.axes.values[sweep.rows]
    few = sweep.axes.is_default or count <= MAX_ROWS
    rows = range(count) if few else map(round, np.linspace(0, count - 1, MAX_ROWS))
    return {row: describe_value(sweep.rows, float(values[row]), sweep.unit) for row in rows}


def _required_table(sweeps: Sequence[Sweep], fractions: Sequence[float]) -> Table:
    """Return a table of required resolutions: a line per sweep, or per sweep and friction."""
    percents = [f"{100.0 * fraction:g} %" for fraction in fractions]
    cells = [
        [
            list(map(_angle, row))
            for row in zip(*map(sweep.required_resolution, fractions), strict=True)
        ]
        for sweep in sweeps
    ]
    texts = _row_texts(sweeps[0])
    if sweeps[0].rows != FRICTION or len(texts) * len(fractions) > MAX_ANGLES:
        return _named_table(sweeps, percents, cells)
    columns = [f"μ {text}\n{percent}" for text in texts.values() for percent in percents]
    lines = (
        (escaped(sweep.name), *chain.from_iterable(rows[row] for row in texts))
        for sweep, rows in zip(sweeps, cells, strict=True)
    )
    return _wide(table_of(("", *columns), lines))


def _angle(angle: float) -> str:
    return "none" if math.degrees(angle) < MIN_RESOLUTION else f"{math.degrees(angle):.1f}°"
