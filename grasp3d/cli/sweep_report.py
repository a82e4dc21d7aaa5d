"""Printed report of `grasp3d sweep`."""

import math
from collections.abc import Iterable, Sequence
from itertools import chain
from pathlib import Path

import numpy as np
from rich.table import Table

from grasp3d.batch.sweeping import SweptMesh
from grasp3d.cli.report import FAILED, NOTE, Report, escaped, table_of
from grasp3d.plots.fractions import meaning_in
from grasp3d.settings import GraspModel
from grasp3d.surface.sweeps import Sweep

MIN_RESOLUTION = 0.05
"""Resolution below which no sensor is fine enough [degrees]."""

MAX_CREASES = 1.0 / 3.0
"""Area fraction of creases that gives a note, relative to the area that need not be S."""

MAX_COLUMNS, MAX_ANGLES = 5, 6
"""Columns that fit beside a name: of area fractions, and of angles."""


def print_sweeps(
    shown: Sequence[Sweep], every: Sequence[Sweep], fractions: Sequence[float]
) -> None:
    """Print the area fractions at some of the resolutions, and the required resolutions.

    Args:
        shown: Sweeps whose fractions are printed.
        every: Sweeps whose required resolutions are printed.
        fractions: Area fractions of S for which the required resolution is printed.
    """
    if not shown:
        return
    report = Report()
    report.line("area fractions of S/M/U [%] by sensor resolution:")
    columns = _shown_columns(shown[0])
    headings = [f"{math.degrees(shown[0].sensor_resolution[one]):.4g}°" for one in columns]
    cells = (
        [
            [_percents(stable[column], ambiguous[column]) for column in columns]
            for stable, ambiguous in zip(sweep.stable, sweep.ambiguous, strict=True)
        ]
        for sweep in shown
    )
    report.table(_named_table(shown, headings, cells))
    legend = ", ".join(f"{label.name} {words}" for label, words in meaning_in(shown).items())
    report.line(escaped(legend))
    if fractions:
        report.line(
            "\nrequired resolution: below it at least this fraction of the surface is S "
            "(none: at no resolution)"
        )
        report.table(_required_table(every, fractions))


def print_notes(
    shapes: Sequence[str], meshes: Sequence[SweptMesh], fractions: Sequence[float]
) -> None:
    """Print errors, warnings and notes.

    Args:
        shapes: Names of the swept shapes.
        meshes: The swept meshes.
        fractions: As in `print_sweeps`.
    """
    report = Report()
    for name in shapes:
        if Path(name).exists():
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


def _named_table(
    sweeps: Sequence[Sweep], headings: Sequence[str], cells: Iterable[Sequence[Sequence[str]]]
) -> Table:
    """Return a table with a line for each sweep and friction.

    Args:
        sweeps: The sweeps.
        headings: Of the cells.
        cells: By sweep, friction and column.
    """
    lines = (
        ("" if number else escaped(sweep.name), f"{friction:.4g}", *row)
        for sweep, rows in zip(sweeps, cells, strict=True)
        for number, (friction, row) in enumerate(zip(sweep.friction, rows, strict=True))
    )
    return _wide(table_of(("", "friction", *headings), lines))


def _wide(table: Table) -> Table:
    """A table whose first column has the names of sweeps."""
    table.columns[0].min_width = 12
    return table


def _percents(stable: float, ambiguous: float) -> str:
    """Format the fractions of S, M and U as whole percents whose sum is 100."""
    first, second = round(100.0 * stable), round(100.0 * (stable + ambiguous))
    return f"{first}/{second - first}/{100 - second}"


def _shown_columns(sweep: Sweep) -> list[int]:
    """Return indices of evenly spaced columns; the default resolution replaces its neighbour."""
    values = sweep.sensor_resolution
    if len(values) <= MAX_COLUMNS:
        return list(range(len(values)))
    resolutions = np.linspace(values[0], values[-1], MAX_COLUMNS)
    default = GraspModel().sensor_resolution
    if np.isclose(values[1:-1], default).any():
        inner = resolutions[1:-1]
        inner[np.argmin(np.abs(inner - default))] = default
    return sorted({int(np.argmin(np.abs(values - value))) for value in resolutions})


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
    texts = [f"{friction:.4g}" for friction in sweeps[0].friction]
    if len(texts) * len(fractions) > MAX_ANGLES:
        return _named_table(sweeps, percents, cells)
    columns = [f"μ {text}\n{percent}" for text in texts for percent in percents]
    lines = (
        (escaped(sweep.name), *chain.from_iterable(rows))
        for sweep, rows in zip(sweeps, cells, strict=True)
    )
    return _wide(table_of(("", *columns), lines))


def _angle(angle: float) -> str:
    return "none" if math.degrees(angle) < MIN_RESOLUTION else f"{math.degrees(angle):.1f}°"
