"""Printed reports of grasps."""

import math
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from grasp3d.arrays import Floats
from grasp3d.cli.load_report import LEGEND, holding_cells, holding_headings, print_load_of_grasps
from grasp3d.cli.report import angle_text, escaped, print_table
from grasp3d.cli.uncertainty_report import (
    MARGIN,
    is_uncertain,
    margin_text,
    uncertainty_lines,
)
from grasp3d.grasps.evaluation import DISTANCE_ROUNDING
from grasp3d.settings.model_text import epsilon_min_text, friction_text
from grasp3d.stability.label import COLORS, MEANING, Label
from grasp3d.surface.closed_grasps import UNKNOWN, ClosedGrasps
from grasp3d.surface.grasp_table import GraspTable
from grasp3d.system.counts import counted

MAX_ROWS = 10
"""Largest number of evaluated grasps in the table."""

LEVELS = (0.1, 0.5, 0.9)
"""Levels of the quantiles."""
_PERCENTS = "/".join(f"{100.0 * level:.0f}" for level in LEVELS)

_LEGEND = (
    "β*: critical friction angle; α*: the grasp is surely stable at any smaller sensor resolution; "
)

_APPROACH = "approach: how far the approach may turn about the closing axis; "

_CLOSED = (
    "closed: label at what the jaws touch when they close, and its margin, the friction angle to "
    "spare; "
)


def print_evaluated(grasps: GraspTable, output: Path) -> None:
    """Print the number of grasps of each label, and a table of the first grasps.

    Args:
        grasps: Evaluated grasps.
        output: The file that they were written to.
    """
    console = Console(emoji=False)
    _print_heading(console, grasps)
    counts = np.bincount(grasps.label, minlength=len(Label))
    table = Table("label", "", box=None, pad_edge=False)
    table.add_column("grasps", justify="right")
    table.add_column("fraction", justify="right")
    for label in sorted(Label, reverse=True):
        fraction = f"{100.0 * counts[label] / grasps.size:.1f} %"
        table.add_row(label_name(label), MEANING["scan"][label], str(counts[label]), fraction)
    console.print(table)
    console.print(
        f"critical friction angle, {_PERCENTS} % of the grasps: {_angles(grasps.critical_angle)}"
    )
    for line in uncertainty_lines(grasps, None, of="grasps", unit=grasps.mesh.unit):
        console.print(escaped(line), soft_wrap=True)
    console.print(_distance_text(grasps))
    print_load_of_grasps(console, grasps.holding)
    warnings = grasps.mesh.report.warnings
    for line in warnings:
        console.print(f"[yellow]warning:[/] {escaped(line)}", soft_wrap=True)
    if grasps.size > MAX_ROWS:
        console.print(f"the first {MAX_ROWS} of {grasps.size}:")
    print_table(console, _table(grasps, MAX_ROWS, distances=True))
    console.print(_legend(grasps), soft_wrap=True)
    _print_written(console, output)


def print_best(
    grasps: GraspTable, requested: int, output: Path, *, drawn: bool, written: bool = True
) -> None:
    """Print the best distinct grasps of a surface, best first.

    Args:
        grasps: The grasps.
        requested: Number of grasps that the user requested.
        output: The file that they were written to.
        drawn: Whether pictures of them were written to a file of the same name.
        written: Whether that file was written.
    """
    console = Console(emoji=False)
    if not grasps.size:
        console.print("best grasps: none found")
    else:
        what = "best distinct grasp" if grasps.size == 1 else f"{grasps.size} best distinct grasps"
        console.print(f"the {what}:")
        print_table(console, _table(grasps, grasps.size))
        console.print(_legend(grasps), soft_wrap=True)
        note = "" if grasps.closed is None else grasps.closed.note(grasps.label)
        if note:
            console.print(f"[yellow]warning:[/] {note}", soft_wrap=True)
        if grasps.size < requested:
            console.print(f"{requested} were requested; all others are similar to one of these")
    if grasps.size and not drawn:
        console.print(
            "no pictures: they need OpenGL, which is not available (on Debian: libegl1 libgl1)",
            soft_wrap=True,
        )
    if written:
        _print_written(console, output, *([output.with_suffix(".png")] if drawn else []))


def _print_heading(console: Console, grasps: GraspTable) -> None:
    mesh, model = grasps.mesh, grasps.model
    console.print(
        f"[bold]{escaped(mesh.report.source)}[/]: "
        f"{counted(grasps.size, 'grasps')} of {model.fingers} fingers; friction "
        f"{friction_text(model)}, sensor resolution "
        f"{math.degrees(model.sensor_resolution):.4g}°",
        soft_wrap=True,
    )


def _legend(grasps: GraspTable) -> str:
    approach = "" if grasps.reach is None else _APPROACH
    approach += "" if grasps.closed is None else _CLOSED
    forces = "" if grasps.holding is None else LEGEND
    forces += MARGIN if is_uncertain(grasps.model) else ""
    unit = grasps.mesh.unit or "the unit of the mesh, which is not stated"
    return f"{approach}{forces}{_LEGEND}{epsilon_min_text(grasps.model)}; lengths in {unit}"


def _print_written(console: Console, *outputs: Path) -> None:
    console.print("written: " + escaped(", ".join(map(str, outputs))), soft_wrap=True)


def _distance_text(grasps: GraspTable) -> str:
    """Return the median and the largest distance of the contacts from the surface."""
    unit = grasps.mesh.unit or "(unit not stated)"
    median, most = (_distance(grasps, value) for value in np.quantile(grasps.distance, [0.5, 1.0]))
    return f"distance of the contacts from the surface: median {median}, at most {most} {unit}"


def _distance(grasps: GraspTable, distance: float) -> str:
    """Format a distance from the surface; rounding errors are 0."""
    return "0" if distance < DISTANCE_ROUNDING * grasps.mesh.size else f"{distance:.3g}"


def _table(grasps: GraspTable, count: int, *, distances: bool = False) -> Table:
    """Return a table of the first grasps, optionally with their distances from the surface."""
    several = grasps.contacts.count > 2
    table = Table(box=None, pad_edge=False)
    uncertain = is_uncertain(grasps.model)
    headings = ["grasp", "label", "β*", "α*", *["margin"] * uncertain, "ε", "ε_min", "opening"]
    reach, holding = grasps.reach, grasps.holding
    headings += ["separation"] * several + ["distance"] * distances
    headings += ["approach"] * (grasps.has_poses and reach is not None)
    headings += ["closed"] * (grasps.closed is not None)
    headings += holding_headings(holding)
    for heading in headings:
        table.add_column(heading, justify="right", no_wrap=True)
    for row in range(min(count, grasps.size)):
        cells = [
            str(row + 1),
            label_name(Label(int(grasps.label[row]))),
            angle_text(grasps.critical_angle[row]),
            angle_text(grasps.max_resolution[row]) if grasps.max_resolution[row] > 0.0 else "none",
            *([margin_text(grasps.margin[row])] if uncertain else []),
            _number(grasps.epsilon[row]),
            _number(grasps.epsilon_min[row]),
            f"{grasps.opening[row]:.4g}",
        ]
        cells += [f"{grasps.separation[row]:.4g}"] * several
        cells += [_distance(grasps, grasps.distance[row].max())] * distances
        if grasps.has_poses and reach is not None:
            cells.append(f"±{math.degrees(reach.approach_margin[row]):.0f}°")
        if grasps.closed is not None:
            cells.append(_closed_text(grasps.closed, row))
        cells += holding_cells(holding, row)
        table.add_row(*cells)
    return table


def _closed_text(closed: ClosedGrasps, row: int) -> str:
    """Label and margin of a grasp after closing; empty where they are not known."""
    code, margin = int(closed.label[row]), closed.margin[row]
    if code == UNKNOWN:
        return ""
    name = label_name(Label(code))
    return name if math.isnan(margin) else f"{name} {margin_text(margin)}"


def label_name(label: Label) -> str:
    """Return a label with a square of its colour."""
    color = "#{:02X}{:02X}{:02X}".format(*COLORS[label])
    return f"[{color}]■[/] {label.name}"


def _angles(angles: Floats) -> str:
    """Return the quantiles of angles; angles of grasps that cannot balance forces are infinite."""
    ordered = np.sort(angles)
    rows = np.ceil(np.array(LEVELS) * len(ordered)).astype(np.int64) - 1
    return ", ".join(angle_text(angle) for angle in ordered[np.maximum(rows, 0)])


def _number(value: float) -> str:
    return "none" if math.isnan(value) else f"{value:.3f}"
