"""Printed reports of loads: what grasps must hold, with which force, and whether they do."""

import math

import numpy as np
from rich.console import Console
from rich.markup import escape

from grasp3d.arrays import Floats
from grasp3d.grasps.verdict import HoldingVerdict
from grasp3d.quality.force_ranges import Certainty
from grasp3d.quality.task_texts import TaskText
from grasp3d.surface.held_area import force_quantiles, held_fractions, payload_quantiles
from grasp3d.surface.holding import Holding
from grasp3d.surface.labels import SurfaceLabels
from grasp3d.system.names import printable

LEGEND = (
    "force: grip force that holds the load at the worst normals, in N; payload: mass that is held, "
    "in kg; "
)
"""Meaning of the cells of tables."""

LEVELS = (0.1, 0.5, 0.9)
"""Levels of the quantiles."""
_PERCENTS = "/".join(f"{100.0 * level:.0f}" for level in LEVELS)

_HOW: dict[Certainty, str] = {
    "exact": "at the worst normals",
    "bound": "at the worst normals, a safe bound",
    "sampled": "at the worst of sampled normals",
}


def print_load(console: Console, labels: SurfaceLabels) -> None:
    """Print the load of a surface, and which fraction of the surface holds it; nothing: no load.

    Args:
        console: Where to print.
        labels: The labelled surface.
    """
    holding = labels.holding
    if holding is None:
        return
    _print_heading(console, holding)
    fractions = held_fractions(labels)
    if fractions is not None:
        parts = ", ".join(f"{name} {100.0 * part:.1f} %" for name, part in fractions.items())
        console.print(f"  held by {100.0 * fractions['S']:.1f} % of the surface ({parts})")
    where = f"{_PERCENTS} % of the area"
    _print_numbers(
        console, holding, where, force_quantiles(labels, LEVELS), payload_quantiles(labels, LEVELS)
    )


def print_load_of_grasps(console: Console, holding: Holding | None) -> None:
    """Print the load of given grasps, and how many hold it; nothing: no load."""
    if holding is None:
        return
    _print_heading(console, holding)
    count, label = len(holding.grip_force), holding.label
    if label is not None:
        counts = np.bincount(label, minlength=3)[::-1]
        parts = ", ".join(f"{name} {number}" for name, number in zip("SMU", counts, strict=True))
        console.print(f"  held by {counts[0]} of {count} grasps ({parts})")
    forces = np.nan_to_num(holding.grip_force_largest, nan=math.inf, posinf=math.inf)
    payloads = None
    if holding.has_payload:
        payloads = _quantiles(np.nan_to_num(holding.payload, nan=0.0, posinf=math.inf))
    _print_numbers(console, holding, f"{_PERCENTS} % of the grasps", _quantiles(forces), payloads)


def force_text(force: float) -> str:
    """Format a force; inf: none suffices."""
    return "none" if not math.isfinite(force) else f"{force + 0.0:.3g}"  # 0, not -0


def holding_cells(holding: Holding | None, row: int) -> list[str]:
    """Return the grip force at the worst normals and the payload, as far as known."""
    if holding is None:
        return []
    cells = [force_text(holding.grip_force_largest[row])]
    return [*cells, f"{holding.payload[row]:.3g}"] if holding.has_payload else cells


def holding_headings(holding: Holding | None) -> list[str]:
    """Return the headings of `holding_cells`."""
    return [] if holding is None else ["force", *["payload"] * holding.has_payload]


def _print_heading(console: Console, holding: Holding) -> None:
    """Print mass, task, force at hand and the verdict."""
    mass = "mass not given" if holding.mass is None else f"{holding.mass:.3g} kg"
    given = holding.load.task
    task = escape(printable(str(given))) if isinstance(given, TaskText) else "a given task"
    force = "none given" if holding.available is None else f"{holding.available:.3g} N per finger"
    console.print(f"[bold]load[/]: {mass}, {task}; force at hand: {force}", soft_wrap=True)
    verdict = HoldingVerdict.of(holding)
    console.print(f"  {escape(str(verdict))}", soft_wrap=True)
    if holding.remedy and holding.remedy != verdict.reason:
        console.print(f"  most grasps hold nothing: {escape(holding.remedy)}", soft_wrap=True)


def _print_numbers(
    console: Console, holding: Holding, where: str, forces: Floats, payloads: Floats | None
) -> None:
    """Print quantiles of grip forces and payloads."""
    per = " per kg" if not holding.case.decided else ""
    console.print(
        f"  grip force{per}, {where}: {', '.join(map(force_text, forces.tolist()))} N "
        f"({_HOW[holding.how]})",
        soft_wrap=True,
    )
    if payloads is not None:
        texts = ", ".join(f"{payload:.3g}" for payload in payloads.tolist())
        console.print(f"  payload, {where}: {texts} kg", soft_wrap=True)


def _quantiles(values: Floats) -> Floats:
    """Quantiles of values that may be infinite."""
    rows = np.ceil(np.array(LEVELS) * len(values)).astype(np.int64) - 1
    return np.asarray(np.sort(values)[np.maximum(rows, 0)])
