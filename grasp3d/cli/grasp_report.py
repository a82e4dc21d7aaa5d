"""What the commands show of whole grasps."""

import math
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from grasp3d.arrays import Floats
from grasp3d.cli.report import angle_text, as_printed
from grasp3d.grasps.evaluation import ROUNDING
from grasp3d.grasps.surface_grasps import SurfaceGrasps
from grasp3d.stability.label import COLORS, MEANING, Label

FIRST = 10
"""Grasps of many that are shown."""

LEVELS = (0.1, 0.5, 0.9)
_TOLD = "/".join(f"{100.0 * level:.0f}" for level in LEVELS)

_LEGEND = (
    "β* critical friction angle; α* with any finer sensor the grasp is surely stable; "
    "ε_min smallest epsilon over the tilts"
)


def print_evaluated(grasps: SurfaceGrasps, output: Path) -> None:
    """Print how reliable given grasps are: how many of each label, and the first ones."""
    console = Console(emoji=False)
    _print_heading(console, grasps)
    counts = np.bincount(grasps.label, minlength=len(Label))
    table = Table("label", "", box=None, pad_edge=False)
    table.add_column("grasps", justify="right")
    table.add_column("share", justify="right")
    for label in sorted(Label, reverse=True):
        share = f"{100.0 * counts[label] / grasps.size:.1f} %"
        table.add_row(_name(label), MEANING["scan"][label], str(counts[label]), share)
    console.print(table)
    console.print(
        f"critical friction angle, {_TOLD} % of the grasps: {_angles(grasps.critical_angle)}"
    )
    console.print(_told_distances(grasps))
    warnings = grasps.mesh.report.warnings
    for line in warnings:
        console.print(f"[yellow]warning:[/] {as_printed(line)}", soft_wrap=True)
    if grasps.size > FIRST:
        console.print(f"the first {FIRST} of {grasps.size}:")
    console.print(_table(grasps, FIRST, off=True))
    console.print(_LEGEND, soft_wrap=True)
    _print_written(console, output)


def print_best(grasps: SurfaceGrasps, asked: int, output: Path, *, drawn: bool) -> None:
    """Print the best distinct grasps of a surface, best first.

    Args:
        grasps: The grasps.
        asked: How many were asked for.
        output: The JSON file that they were written to.
        drawn: Whether the file beside it holds pictures of them.
    """
    console = Console(emoji=False)
    if not grasps.size:
        console.print("best grasps: none was found")
    else:
        console.print(f"the {grasps.size} best grasps that are distinct:")
        console.print(_table(grasps, grasps.size))
        console.print(_LEGEND, soft_wrap=True)
        if grasps.size < asked:
            console.print(f"{asked} were asked for; all others are near one of these")
    if grasps.size and not drawn:
        console.print(
            "no pictures: they need OpenGL, which is not here (on Debian: libegl1 libgl1)",
            soft_wrap=True,
        )
    _print_written(console, output, *([output.with_suffix(".png")] if drawn else []))


def _print_heading(console: Console, grasps: SurfaceGrasps) -> None:
    mesh, model = grasps.mesh, grasps.model
    console.print(
        f"[bold]{as_printed(mesh.report.source)}[/]: {grasps.size} "
        f"{'grasp' if grasps.size == 1 else 'grasps'} of {model.fingers} fingers; friction "
        f"{model.friction:g}, sensor resolution {math.degrees(model.sensor_resolution):.4g}°",
        soft_wrap=True,
    )


def _print_written(console: Console, *outputs: Path) -> None:
    console.print("written: " + as_printed(", ".join(map(str, outputs))), soft_wrap=True)


def _told_distances(grasps: SurfaceGrasps) -> str:
    """Say how far off the surface the contacts were."""
    unit = grasps.mesh.unit or "(unit not stated)"
    half, most = (_off(grasps, value) for value in np.quantile(grasps.distance, [0.5, 1.0]))
    return f"off the surface: half of the contacts at most {half}, all at most {most} {unit}"


def _off(grasps: SurfaceGrasps, distance: float) -> str:
    """A distance from the surface; rounding is none."""
    return "0" if distance < ROUNDING * grasps.mesh.size else f"{distance:.3g}"


def _table(grasps: SurfaceGrasps, count: int, *, off: bool = False) -> Table:
    """The first grasps, a line each; `off`: with how far they were off the surface."""
    several = grasps.contacts.count > 2
    table = Table(box=None, pad_edge=False)
    headings = ["grasp", "label", "β*", "α*", "ε", "ε_min", "opening"]
    headings += ["nearest two"] * several + ["off surface"] * off
    for heading in headings:
        table.add_column(heading, justify="right", no_wrap=True)
    for row in range(min(count, grasps.size)):
        cells = [
            str(row + 1),
            _name(Label(int(grasps.label[row]))),
            angle_text(grasps.critical_angle[row]),
            angle_text(grasps.max_resolution[row]) if grasps.max_resolution[row] > 0.0 else "none",
            _number(grasps.epsilon[row]),
            _number(grasps.epsilon_min[row]),
            f"{grasps.opening[row]:.4g}",
        ]
        cells += [f"{grasps.separation[row]:.4g}"] * several
        cells += [_off(grasps, grasps.distance[row].max())] * off
        table.add_row(*cells)
    return table


def _name(label: Label) -> str:
    color = "#{:02X}{:02X}{:02X}".format(*COLORS[label])
    return f"[{color}]■[/] {label.name}"


def _angles(angles: Floats) -> str:
    """Quantiles of angles; where forces cannot balance they are infinite."""
    order = np.sort(angles)
    numbers = np.ceil(np.array(LEVELS) * len(order)).astype(np.int64) - 1
    return ", ".join(angle_text(angle) for angle in order[np.maximum(numbers, 0)])


def _number(value: float) -> str:
    return "none" if math.isnan(value) else f"{value:.3f}"
