"""What `grasp3d sweep` shows."""

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from grasp3d.batch.sweeping import SweptMesh, SweptTarget, Target
from grasp3d.cli.report import as_printed
from grasp3d.settings import GraspModel
from grasp3d.stability.label import MEANING, Label
from grasp3d.sweeps import Sweep

LEAST_DEGREES = 0.05
"""What is printed with one digit; a finer resolution is none that a sensor has."""

MUCH = 1.0 / 3.0
"""Of what a share leaves over, how much may be creases before it is told."""

MOST_COLUMNS, MOST_ANGLES = 5, 6
"""Columns that fit beside a name: shares, and angles."""


def print_sweeps(targets: Sequence[SweptTarget], shares: Sequence[float]) -> None:
    """Print the shares at some of the resolutions, and the resolution that each share needs.

    Args:
        targets: What was swept; every mesh of a folder has a line in the second table.
        shares: Shares of the surface that are to be S.
    """
    console = Console(emoji=False)
    shown = [one for target in targets for one in target.shown]
    if not shown:
        return
    console.print("shares of S/M/U [%] by sensor resolution:")
    console.print(_fractions(shown))
    console.print(as_printed(_legend(shown)), soft_wrap=True)
    if shares:
        console.print(
            "\nrequired resolution: with any finer sensor so much of the surface is S (none: no "
            "sensor is fine enough)",
            soft_wrap=True,
        )
        every = dict.fromkeys(one for target in targets for one in target.sweeps)
        console.print(_required(list(every), shares))


def print_notes(
    targets: Sequence[Target], meshes: Sequence[SweptMesh], shares: Sequence[float]
) -> None:
    """Print what failed and what to mind; `shares` as in `print_sweeps`."""
    console = Console(emoji=False)
    for target in targets:
        if not target.files and Path(target.name).exists():
            name = as_printed(target.name)
            console.print(
                f"[yellow]note:[/] {name} is the shape in closed form; for the file or folder of "
                f"that name write ./{name}",
                soft_wrap=True,
            )
    for mesh in meshes:
        if mesh.error:
            console.print(f"[red]failed:[/] {as_printed(mesh.error)}", soft_wrap=True)
        for line in mesh.warnings:
            console.print(
                f"[yellow]warning:[/] {as_printed(f'{mesh.name}: {line}')}", soft_wrap=True
            )
    _print_creased(console, meshes, shares)
    failed = sum(1 for mesh in meshes if mesh.error)
    if failed:
        console.print(f"{len(meshes) - failed} swept, {failed} failed")


def _print_creased(console: Console, meshes: Sequence[SweptMesh], shares: Sequence[float]) -> None:
    """Print for which meshes the required resolution hangs on how finely they are divided."""
    unsure = MUCH * (1.0 - max(shares, default=0.0))
    creased = [mesh for mesh in meshes if shares and mesh.crease_fraction > unsure]
    if creased:
        told = as_printed(
            ", ".join(f"{mesh.name} {100.0 * mesh.crease_fraction:.0f} %" for mesh in creased)
        )
        console.print(
            f"[yellow]note:[/] strips along creases count as area, on {told}; they shrink "
            f"on a finer mesh (--max-edge), so {100.0 * max(shares):g} % may need a less fine "
            "sensor than is said here",
            soft_wrap=True,
        )


def print_written(paths: Sequence[Path]) -> None:
    """Print which files were written."""
    console = Console(emoji=False)
    console.print("written: " + as_printed(", ".join(map(str, paths))), soft_wrap=True)


def _fractions(sweeps: Sequence[Sweep]) -> Table:
    columns = _shown(sweeps[0])
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
            table.add_row("" if row else as_printed(sweep.name), f"{friction:g}", *cells)
    return table


def _percents(stable: float, ambiguous: float) -> str:
    """S, M and U in whole percents whose sum is 100."""
    first, second = round(100.0 * stable), round(100.0 * (stable + ambiguous))
    return f"{first}/{second - first}/{100 - second}"


def _shown(sweep: Sweep) -> list[int]:
    """Some of the resolutions, evenly spread; the usual one instead of one beside it."""
    degrees = np.degrees(sweep.sensor_resolution)
    if len(degrees) <= MOST_COLUMNS:
        return list(range(len(degrees)))
    wanted = np.linspace(degrees[0], degrees[-1], MOST_COLUMNS)
    usual = math.degrees(GraspModel().sensor_resolution)
    if np.isclose(degrees[1:-1], usual).any():
        inner = wanted[1:-1]
        inner[np.argmin(np.abs(inner - usual))] = usual
    return sorted({int(np.argmin(np.abs(degrees - value))) for value in wanted})


def _legend(sweeps: Sequence[Sweep]) -> str:
    meaning = MEANING[sweeps[0].mode]
    if len({sweep.mode for sweep in sweeps}) > 1:
        given = ", ".join(sweep.name for sweep in sweeps if sweep.mode == "scan")
        searched, scanned = (MEANING[mode][Label.U] for mode in ("label", "scan"))
        meaning = {**meaning, Label.U: f"{searched} (on {given}: {scanned})"}
    return ", ".join(f"{label.name} {said}" for label, said in meaning.items())


def _required(sweeps: Sequence[Sweep], shares: Sequence[float]) -> Table:
    """One line for each sweep where the columns fit, else one for each sweep and friction."""
    table = Table(box=None, pad_edge=False)
    table.add_column("", overflow="fold", min_width=12)
    told = [f"{100.0 * share:g} %" for share in shares]
    frictions = [f"{friction:g}" for friction in sweeps[0].friction]
    wide = len(frictions) * len(shares) <= MOST_ANGLES
    columns = [f"μ {friction}\n{share}" for friction in frictions for share in told]
    for heading in columns if wide else ["friction", *told]:
        table.add_column(heading, justify="right", no_wrap=True)
    for sweep in sweeps:
        needed = np.stack([sweep.required_resolution(share) for share in shares], axis=1)
        rows = [[_angle(angle) for angle in angles] for angles in needed]
        if wide:
            table.add_row(as_printed(sweep.name), *(cell for cells in rows for cell in cells))
            continue
        for number, (friction, cells) in enumerate(zip(frictions, rows, strict=True)):
            table.add_row("" if number else as_printed(sweep.name), friction, *cells)
    return table


def _angle(angle: float) -> str:
    return "none" if math.degrees(angle) < LEAST_DEGREES else f"{math.degrees(angle):.1f}°"
