"""Printed report of `grasp3d simulate`."""

import math
from collections import Counter
from collections.abc import Iterable
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from grasp3d.cli.report import escaped, length_with_unit
from grasp3d.grasps.poses import GraspPoses
from grasp3d.physics.pulling import Fate
from grasp3d.physics.simulation import Simulation, SuccessRate, success_rate
from grasp3d.settings.lengths import small_length
from grasp3d.settings.model_text import model_line
from grasp3d.stability.label import COLORS, MEANING, Label
from grasp3d.system.counts import counted

EXPLANATIONS = {
    Fate.HELD: "held through all pulls, at the contacts that were labelled",
    Fate.REGRASPED: "object held, but the contacts slipped first: by another grasp",
    Fate.PULLED: "held while squeezed, lost to a pull",
    Fate.LOST: "slipped or turned away while squeezed",
    Fate.MISSED: "the two tips never touched it at once",
    Fate.BLOCKED: "the open tips touch the object before they close",
    Fate.BROKEN: "the simulation failed, and says nothing",
}
"""What the fates mean."""


def print_simulation(found: Simulation, output: Path) -> None:
    """Print what was simulated, success by label and by margin, and what became of the grasps.

    Args:
        found: The simulated grasps.
        output: The file that they were written to.
    """
    console = Console(emoji=False)
    for line in _head(found):
        console.print(line, soft_wrap=True)
    console.print(_labels(found))
    console.print(_margins(found))
    _print_fates(console, found.fates)
    for warning in found.warnings:
        console.print(f"[yellow]warning:[/] {escaped(warning)}", soft_wrap=True)
    console.print(f"written: {escaped(str(output))}", soft_wrap=True)


def print_poses(found: GraspPoses, output: Path) -> None:
    """Print what became of given poses, by label.

    Args:
        found: The simulated poses.
        output: The file that they were written to.
    """
    console = Console(emoji=False)
    tried = np.isfinite(found.outcome)
    table = Table("label", "", "poses", "object held", "95 %", box=None, pad_edge=False)
    for column in table.columns[2:]:
        column.justify = "right"
    for label in (Label.S, Label.M, Label.U):
        chosen = tried & (found.columns["label"] == label.name)
        rate = success_rate(label.name, found.outcome[chosen] == 1.0)
        cells = str(rate.count), _percent(rate), _interval(rate)
        table.add_row(_named(label), MEANING["scan"][label], *cells)
    console.print(table)
    _print_fates(console, found.columns["fate"].tolist())
    console.print(f"written: {escaped(str(output))}", soft_wrap=True)


def _print_fates(console: Console, fates: Iterable[str]) -> None:
    """Print how often each fate was met."""
    counts = Counter(map(str, fates))
    for fate, text in EXPLANATIONS.items():
        if counts[str(fate)]:
            console.print(f"{fate}: {counts[str(fate)]} ({text})", soft_wrap=True)


def _named(label: Label) -> str:
    """A label with its colour."""
    color = "#{:02X}{:02X}{:02X}".format(*COLORS[label])
    return f"[{color}]■[/] {label.name}"


def _head(found: Simulation) -> list[str]:
    mesh, settings = found.mesh, found.settings
    depth = small_length(float(found.part_depth.max(initial=0.0)), mesh.unit, digits=2)
    angle = math.degrees(float(found.part_angle.max(initial=0.0)))
    where = "line between the contacts" if settings.pulled == "line" else "centre of mass"
    size = length_with_unit(mesh.size, mesh.unit)
    model, parts = escaped(model_line(found.model, mesh.unit)), counted(found.parts, "convex parts")
    force, weight = f"{settings.force:.3g} N", f"{settings.weight:.3g} N"
    return [
        f"[bold]{escaped(mesh.report.source)}[/]: size {size}; {model}",
        f"{counted(found.size, 'grasps')}; grip force {force}; 6 pulls of {weight} at the {where}",
        f"simulated as {parts}, whose surface is off by at most {depth}, {angle:.1f}° at contacts",
    ]


def _labels(found: Simulation) -> Table:
    names = ("label", "", "grasps", "grasp held", "95 %", "object held")
    table = Table(*names, box=None, pad_edge=False)
    for column in table.columns[2:]:
        column.justify = "right"
    rates, held = found.rates(), found.rates(held=True)
    for name, rate in rates.items():
        table.add_row(
            _named(Label[name]),
            MEANING["scan"][Label[name]],
            str(rate.count),
            _percent(rate),
            _interval(rate),
            _percent(held[name]),
        )
    return table


def _margins(found: Simulation) -> Table:
    table = Table("margin", "grasps", "grasp held", "95 %", box=None, pad_edge=False)
    for column in table.columns[1:]:
        column.justify = "right"
    for rate in found.rates_by_margin():
        if rate.count:
            name = f"{rate.name}°"
            table.add_row(name, str(rate.count), _percent(rate), _interval(rate))
    return table


def _percent(rate: SuccessRate) -> str:
    return "–" if np.isnan(rate.rate) else f"{100.0 * rate.rate:.0f} %"


def _interval(rate: SuccessRate) -> str:
    return f"{100.0 * rate.low:.0f} to {100.0 * rate.high:.0f} %" if rate.count else "–"
