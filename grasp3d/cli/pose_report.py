"""Printed reports of evaluated poses."""

import math
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from grasp3d.cli.grasp_report import MAX_ROWS, label_name
from grasp3d.cli.load_report import LEGEND, holding_cells, holding_headings, print_load_of_grasps
from grasp3d.cli.report import angle_text, escaped, print_table
from grasp3d.cli.uncertainty_report import (
    MARGIN,
    is_uncertain,
    margin_text,
    uncertainty_lines,
)
from grasp3d.grasps.evaluated_poses import EvaluatedPoses
from grasp3d.hand.closed_jaws import MEANING as CLOSINGS
from grasp3d.hand.closed_jaws import Closing
from grasp3d.settings.model_text import friction_text
from grasp3d.stability.label import MEANING, Label
from grasp3d.system.counts import counted

_LEGEND = (
    "β*: critical friction angle at the mean normals of the touched patches; α*: the grasp is "
    "surely stable at any smaller sensor resolution; area: the smaller patch; opening in "
)


_CONTACTS = {
    "point": "",
    "soft": "; contacts resist torsion",
    "patch": "; contacts resist torsion and rolling",
}
"""What contacts are, beside points."""


def print_poses(found: EvaluatedPoses, output: Path) -> None:
    """Print the numbers of poses by label and by what the jaws do, and the first poses.

    Args:
        found: Evaluated poses.
        output: The file that they were written to.
    """
    console = Console(emoji=False)
    mesh, model = found.mesh, found.model
    console.print(
        f"[bold]{escaped(mesh.report.source)}[/]: {counted(found.size, 'poses')} of gripper "
        f"{escaped(found.hand.name)}; friction {friction_text(model)}, sensor resolution "
        f"{math.degrees(model.sensor_resolution):.4g}°{_CONTACTS[model.contact]}",
        soft_wrap=True,
    )
    console.print(_counts(found))
    for line in uncertainty_lines(found, None, of="poses", unit=mesh.unit):
        console.print(escaped(line), soft_wrap=True)
    if not np.isnan(found.outcome).all():
        console.print(_outcomes(found), soft_wrap=True)
    print_load_of_grasps(console, found.holding)
    for line in found.warnings:
        console.print(f"[yellow]warning:[/] {escaped(line)}", soft_wrap=True)
    if found.size > MAX_ROWS:
        console.print(f"the first {MAX_ROWS} of {found.size}:")
    print_table(console, _rows(found))
    forces = "" if found.holding is None else LEGEND
    forces += MARGIN if is_uncertain(model) else ""
    console.print(f"{forces}{_LEGEND}{mesh.unit}", soft_wrap=True)
    console.print(f"written: {escaped(str(output))}", soft_wrap=True)


def _counts(found: EvaluatedPoses) -> Table:
    """Return the numbers of labels, of jaws that do not close, and of collisions."""
    table = Table("", "", box=None, pad_edge=False)
    table.add_column("poses", justify="right")
    table.add_column("fraction", justify="right")
    closed = found.jaws.closed
    rows: list[tuple[str, str, int]] = [
        (label_name(label), MEANING["scan"][label], int((closed & (found.label == label)).sum()))
        for label in sorted(Label, reverse=True)
    ]
    rows += [
        ("", meaning, int((found.state == state).sum()))
        for state, meaning in CLOSINGS.items()
        if state != Closing.CLOSED
    ]
    rows.append(("", "closed, but the gripper collides", int((closed & found.collides).sum())))
    rows.append(("", "closed and reachable", int(found.reachable.sum())))
    for name, meaning, count in rows:
        table.add_row(name, meaning, str(count), f"{100.0 * count / found.size:.1f} %")
    return table


def _outcomes(found: EvaluatedPoses) -> str:
    """Return the fraction of the poses of each label that held, of those that were tried."""
    parts = []
    for label in sorted(Label, reverse=True):
        tried = found.outcome[(found.label == label) & ~np.isnan(found.outcome)]
        if len(tried):
            parts.append(f"{label.name} {100.0 * tried.mean():.1f} % of {len(tried)}")
    return "held when tried: " + ", ".join(parts)


def _rows(found: EvaluatedPoses) -> Table:
    """Return a table of the first poses."""
    table = Table(box=None, pad_edge=False)
    margin = ["margin"] * is_uncertain(found.model)
    headings = ["pose", "label", "β*", "α*", *margin, "ε", "ε_min", "opening", "area"]
    for heading in (*headings, *holding_headings(found.holding), "jaws"):
        table.add_column(heading, justify="right", no_wrap=True)
    for row in range(min(MAX_ROWS, found.size)):
        table.add_row(str(row + 1), label_name(Label(int(found.label[row]))), *_cells(found, row))
    return table


def _cells(found: EvaluatedPoses, row: int) -> list[str]:
    """Return the numbers of a pose, and what the jaws do."""
    state = Closing(int(found.state[row]))
    jaws = state.name.lower().replace("_", " ")
    if state != Closing.CLOSED:
        numbers = 4 + is_uncertain(found.model)
        return ["none"] * numbers + [""] * (2 + len(holding_headings(found.holding))) + [jaws]
    resolution = found.max_resolution[row]
    return [
        angle_text(found.critical_angle[row]),
        angle_text(resolution) if resolution > 0.0 else "none",
        *([margin_text(found.margin[row])] if is_uncertain(found.model) else []),
        f"{found.epsilon[row]:.3f}",
        f"{found.epsilon_min[row]:.3f}",
        f"{found.opening[row]:.4g}",
        f"{found.jaws.area[row].min():.3g}",
        *holding_cells(found.holding, row),
        f"{jaws}, collides" if found.collides[row] else jaws,
    ]
