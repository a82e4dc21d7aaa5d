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
from grasp3d.sweeps import Sweep

MIN_RESOLUTION = 0.05
"""Resolution below which no sensor is fine enough [degrees]."""

MAX_CREASES = 1.0 / 3.0
"""Area fraction of creases that gives a note, relative to the area that need not be S."""

MAX_COLUMNS, MAX_ANGLES = 5, 6
"""Columns that fit beside a name: of area fractions, and of angles."""


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
    console.print("area fractions of S/M/U [%] by sensor resolution:")
    console.print(_fraction_table(shown))
    console.print(escaped(_legend(shown)), soft_wrap=True)
    if fractions:
        console.print(
            "\nrequired resolution: below it at least this fraction of the surface is S "
            "(none: at no resolution)",
            soft_wrap=True,
        )
        every = dict.fromkeys(sweep for target in targets for sweep in target.sweeps)
        console.print(_required_table(list(every), fractions))


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
    columns = _shown_columns(sweeps[0])
    table = Table(box=None, pad_edge=False)
    table.add_column("", overflow="fold", min_width=12)
    table.add_column("friction", justify="right", no_wrap=True)
    for column in columns:
        degrees = math.degrees(sweeps[0].sensor_resolution[column])
        table.add_column(f"{degrees:.4g}°", justify="right", no_wrap=True)
    for sweep in sweeps:
        for row, friction in enumerate(sweep.friction):
            cells = (
                _percents(sweep.stable[row, column], sweep.ambiguous[row, column])
                for column in columns
            )
            table.add_row("" if row else escaped(sweep.name), f"{friction:g}", *cells)
    return table


def _percents(stable: float, ambiguous: float) -> str:
    """Format the fractions of S, M and U as whole percents whose sum is 100."""
    first, second = round(100.0 * stable), round(100.0 * (stable + ambiguous))
    return f"{first}/{second - first}/{100 - second}"


def _shown_columns(sweep: Sweep) -> list[int]:
    """Return indices of evenly spaced resolutions; the default one replaces its neighbour."""
    degrees = np.degrees(sweep.sensor_resolution)
    if len(degrees) <= MAX_COLUMNS:
        return list(range(len(degrees)))
    shown = np.linspace(degrees[0], degrees[-1], MAX_COLUMNS)
    default = math.degrees(GraspModel().sensor_resolution)
    if np.isclose(degrees[1:-1], default).any():
        inner = shown[1:-1]
        inner[np.argmin(np.abs(inner - default))] = default
    return sorted({int(np.argmin(np.abs(degrees - value))) for value in shown})


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
    frictions = [f"{friction:g}" for friction in sweeps[0].friction]
    wide = len(frictions) * len(fractions) <= MAX_ANGLES
    columns = [f"μ {friction}\n{percent}" for friction in frictions for percent in percents]
    for heading in columns if wide else ["friction", *percents]:
        table.add_column(heading, justify="right", no_wrap=True)
    for sweep in sweeps:
        required = np.stack([sweep.required_resolution(value) for value in fractions], axis=1)
        rows = [[_angle(angle) for angle in angles] for angles in required]
        if wide:
            table.add_row(escaped(sweep.name), *(cell for cells in rows for cell in cells))
            continue
        for number, (friction, cells) in enumerate(zip(frictions, rows, strict=True)):
            table.add_row("" if number else escaped(sweep.name), friction, *cells)
    return table


def _angle(angle: float) -> str:
    return "none" if math.degrees(angle) < MIN_RESOLUTION else f"{math.degrees(angle):.1f}°"
