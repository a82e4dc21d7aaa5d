"""Printed report of `grasp3d sweep`."""

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from grasp3d.batch.sweeping import SweptMesh, SweptTarget, Target
from grasp3d.cli.report import escaped
from grasp3d.settings import GraspModel
from grasp3d.stability.label import MEANING, Label
from grasp3d.surface.sweeps import Sweep
from grasp3d.surface.sweeps.axes import AXES, COLUMN, ROW, AxisName, describe_value

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
    console = Console(emoji=False)
    shown = [sweep for target in targets for sweep in target.shown]
    if not shown:
        return
    axes = shown[0].axes
    fixed = "" if axes.is_default else f", {axes.fixed_text}"
    console.print(
        f"area fractions of S/M/U [%] by {_axis(shown, shown[0].columns)}{fixed}:",
        soft_wrap=True,
    )
    console.print(_fraction_table(shown))
    console.print(escaped(_legend(shown)), soft_wrap=True)
    if fractions:
        console.print(
            "\nrequired resolution: below it at least this fraction of the surface is S "
            "(none: at no resolution)",
            soft_wrap=True,
        )
        every = list(dict.fromkeys(sweep for target in targets for sweep in target.sweeps))
        if shown[0].columns == COLUMN:
            console.print(_required_table(every, fractions))
            return
        for fraction in fractions:
            console.print(f"{100.0 * fraction:g} %, by {_axis(shown, shown[0].columns)}:")
            console.print(_required_entries(every, fraction))


def print_notes(
    targets: Sequence[Target], meshes: Sequence[SweptMesh], fractions: Sequence[float]
) -> None:
    """Print errors, warnings and notes.

    Args:
        targets: Targets of the sweep.
        meshes: Swept meshes of the targets.
        fractions: As in `print_sweeps`.
    """
    console = Console(emoji=False)
    for target in targets:
        if not target.files and Path(target.name).exists():
            name = escaped(target.name)
            console.print(
                f"[yellow]note:[/] {name} is the shape in closed form; for the file or folder of "
                f"that name write ./{name}",
                soft_wrap=True,
            )
    for mesh in meshes:
        if mesh.error:
            console.print(f"[red]failed:[/] {escaped(mesh.error)}", soft_wrap=True)
        for line in mesh.warnings:
            console.print(f"[yellow]warning:[/] {escaped(f'{mesh.name}: {line}')}", soft_wrap=True)
    _print_crease_note(console, meshes, fractions)
    failed = sum(1 for mesh in meshes if mesh.error)
    if failed:
        console.print(f"{len(meshes) - failed} swept, {failed} failed")


def _print_crease_note(
    console: Console, meshes: Sequence[SweptMesh], fractions: Sequence[float]
) -> None:
    """Print the meshes whose required resolution depends on the length of their edges."""
    limit = MAX_CREASES * (1.0 - max(fractions, default=0.0))
    creased = [mesh for mesh in meshes if fractions and mesh.crease_fraction > limit]
    if creased:
        names = escaped(
            ", ".join(f"{mesh.name} {100.0 * mesh.crease_fraction:.0f} %" for mesh in creased)
        )
        console.print(
            f"[yellow]note:[/] the area includes strips along creases, on {names}; they are "
            f"smaller on a finer mesh (--max-edge), so the resolution required for "
            f"{100.0 * max(fractions):g} % may be larger than printed here",
            soft_wrap=True,
        )


def print_written(paths: Sequence[Path]) -> None:
    """Print the names of the written files."""
    console = Console(emoji=False)
    console.print("written: " + escaped(", ".join(map(str, paths))), soft_wrap=True)


def _fraction_table(sweeps: Sequence[Sweep]) -> Table:
    return _grid_table(
        sweeps,
        [
            [list(map(_percents, *rows)) for rows in zip(one.stable, one.ambiguous, strict=True)]
            for one in sweeps
        ],
    )


def _required_entries(sweeps: Sequence[Sweep], fraction: float) -> Table:
    """Return a table of required resolutions over rows and columns of sweeps."""
    required = [one.required_resolution(fraction) for one in sweeps]
    return _grid_table(sweeps, [[list(map(_angle, row)) for row in one] for one in required])


def _grid_table(sweeps: Sequence[Sweep], cells: Sequence[Sequence[Sequence[str]]]) -> Table:
    """Return a table with a line for each sweep and row, and some of the columns.

    Args:
        sweeps: The sweeps.
        cells: Their cells, by sweep, row and column.
    """
    first = sweeps[0]
    columns, rows = _shown_columns(first), _shown_rows(first)
    table = Table(box=None, pad_edge=False)
    table.add_column("", overflow="fold", min_width=12)
    table.add_column(_axis(sweeps, first.rows, "\n"), justify="right", no_wrap=True)
    for column in columns:
        value = float(first.axes.values[first.columns][column])
        heading = describe_value(first.columns, value, first.unit)
        table.add_column(heading, justify="right", no_wrap=True)
    for sweep, entries in zip(sweeps, cells, strict=True):
        for number, row in enumerate(rows):
            value = float(first.axes.values[first.rows][row])
            table.add_row(
                "" if number else escaped(sweep.name),
                describe_value(first.rows, value, first.unit),
                *(entries[row][column] for column in columns),
            )
    return table


def _axis(sweeps: Sequence[Sweep], name: AxisName, separator: str = " ") -> str:
    """Return the name of an axis, with the unit of values that are printed without one."""
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
    shown = np.linspace(values[0], values[-1], MAX_COLUMNS)
    default = GraspModel().sensor_resolution
    if sweep.columns == COLUMN and np.isclose(values[1:-1], default).any():
        inner = shown[1:-1]
        inner[np.argmin(np.abs(inner - default))] = default
    return sorted({int(np.argmin(np.abs(values - value))) for value in shown})


def _shown_rows(sweep: Sweep) -> list[int]:
    """Return indices of rows: all frictions of the default axes, otherwise evenly spaced ones."""
    count = len(sweep.stable)
    if sweep.axes.is_default or count <= MAX_ROWS:
        return list(range(count))
    return [round(index) for index in np.linspace(0, count - 1, MAX_ROWS)]


def _legend(sweeps: Sequence[Sweep]) -> str:
    meaning = MEANING[sweeps[0].mode]
    if len({sweep.mode for sweep in sweeps}) > 1:
        names = ", ".join(sweep.name for sweep in sweeps if sweep.mode == "scan")
        searched, scanned = (MEANING[mode][Label.U] for mode in ("label", "scan"))
        meaning = {**meaning, Label.U: f"{searched} (on {names}: {scanned})"}
    return ", ".join(f"{label.name} {words}" for label, words in meaning.items())


def _required_table(sweeps: Sequence[Sweep], fractions: Sequence[float]) -> Table:
    """Return a table of required resolutions: a line per sweep, or per sweep and friction."""
    table = Table(box=None, pad_edge=False)
    table.add_column("", overflow="fold", min_width=12)
    percents = [f"{100.0 * fraction:g} %" for fraction in fractions]
    first, shown = sweeps[0], _shown_rows(sweeps[0])
    texts = [
        describe_value(first.rows, float(value), first.unit)
        for value in first.axes.values[first.rows][shown]
    ]
    wide = first.rows == ROW and len(texts) * len(fractions) <= MAX_ANGLES
    columns = [f"μ {text}\n{percent}" for text in texts for percent in percents]
    for heading in columns if wide else [_axis(sweeps, first.rows, "\n"), *percents]:
        table.add_column(heading, justify="right", no_wrap=True)
    for sweep in sweeps:
        required = np.stack([sweep.required_resolution(value) for value in fractions], axis=1)
        rows = [[_angle(angle) for angle in angles] for angles in required[shown]]
        if wide:
            table.add_row(escaped(sweep.name), *(cell for cells in rows for cell in cells))
            continue
        for number, (text, cells) in enumerate(zip(texts, rows, strict=True)):
            table.add_row("" if number else escaped(sweep.name), text, *cells)
    return table


def _angle(angle: float) -> str:
    return "none" if math.degrees(angle) < MIN_RESOLUTION else f"{math.degrees(angle):.1f}°"
