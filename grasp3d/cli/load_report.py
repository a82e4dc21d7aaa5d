"""Printed reports of loads: what grasps must hold, with which force, and whether they do."""

import math

import numpy as np

from grasp3d.arrays import Floats
from grasp3d.cli.report import LEVELS, PERCENTS, Column, Report, escaped, percent_text
from grasp3d.grasps.verdict import HoldingVerdict
from grasp3d.quality.force_ranges import Certainty
from grasp3d.quality.task_texts import TaskText
from grasp3d.surface.area_statistics import quantiles
from grasp3d.surface.held_area import force_quantiles, held_fractions, payload_quantiles
from grasp3d.surface.holding import Holding
from grasp3d.surface.labels import SurfaceLabels

LEGEND = (
    "force: grip force that holds the load at the worst normals, in N; payload: mass that is held, "
    "in kg; "
)
"""Meaning of the columns of tables."""

_HOW: dict[Certainty, str] = {
    "exact": "at the worst normals",
    "bound": "at the worst normals, a safe bound",
    "sampled": "at the worst of sampled normals",
}


def print_load(report: Report, labels: SurfaceLabels) -> None:
    """Print the load of a surface, and which fraction of the surface holds it; nothing: no load.

    Args:
        report: Where to print.
        labels: The labelled surface.
    """
    holding = labels.holding
    if holding is None:
        return
    _print_heading(report, holding)
    fractions = held_fractions(labels)
    if fractions is not None:
        parts = ", ".join(f"{name} {percent_text(part)}" for name, part in fractions.items())
        report.paragraph(f"  held by {percent_text(fractions['S'])} of the surface ({parts})")
    forces, payloads = force_quantiles(labels, LEVELS), payload_quantiles(labels, LEVELS)
    _print_numbers(report, holding, "area", forces, payloads)


def print_load_of_grasps(report: Report, holding: Holding | None) -> None:
    """Print the load of given grasps, and how many hold it; nothing: no load."""
    if holding is None:
        return
    _print_heading(report, holding)
    count, label = len(holding.grip_force), holding.label
    if label is not None:
        counts = np.bincount(label, minlength=3)[::-1]
        parts = ", ".join(f"{name} {number}" for name, number in zip("SMU", counts, strict=True))
        report.paragraph(f"  held by {counts[0]} of {count} grasps ({parts})")
    each = np.ones(count)
    forces = np.nan_to_num(holding.grip_force_largest, nan=math.inf, posinf=math.inf)
    payloads = None
    if holding.has_payload:
        payloads = np.nan_to_num(holding.payload, nan=0.0, posinf=math.inf)
        payloads = quantiles(payloads, LEVELS, each)
    _print_numbers(report, holding, "grasps", quantiles(forces, LEVELS, each), payloads)


def force_text(force: float) -> str:
    """Format a force; inf: none suffices."""
    return "none" if not math.isfinite(force) else f"{force + 0.0:.3g}"  # 0, not -0


def holding_columns(holding: Holding | None) -> list[Column]:
    """The grip force at the worst normals and the payload of grasps, as far as known."""
    if holding is None:
        return []
    force: Column = ("force", lambda row: force_text(holding.grip_force_largest[row]))
    payload: Column = ("payload", lambda row: f"{holding.payload[row]:.3g}")
    return [force, *[payload] * holding.has_payload]


def _print_heading(report: Report, holding: Holding) -> None:
    """Print mass, task, force at hand and the verdict."""
    mass = "mass not given" if holding.mass is None else f"{holding.mass:.3g} kg"
    task = holding.load.task
    text = escaped(str(task)) if isinstance(task, TaskText) else "a given task"
    force = "none given" if holding.available is None else f"{holding.available:.3g} N per finger"
    report.line(f"[bold]load[/]: {mass}, {text}; force at hand: {force}")
    verdict = HoldingVerdict.of(holding)
    report.line(f"  {escaped(str(verdict))}")
    if holding.remedy and holding.remedy != verdict.reason:
        report.line(f"  most grasps hold nothing: {escaped(holding.remedy)}")


def _print_numbers(
    report: Report, holding: Holding, of: str, forces: Floats, payloads: Floats | None
) -> None:
    """Print quantiles of grip forces and payloads."""
    per = " per kg" if not holding.case.decided else ""
    texts = ", ".join(map(force_text, forces.tolist()))
    report.line(f"  grip force{per}, {PERCENTS} of the {of}: {texts} N ({_HOW[holding.how]})")
    if payloads is not None:
        texts = ", ".join(f"{payload:.3g}" for payload in payloads.tolist())
        report.line(f"  payload, {PERCENTS} of the {of}: {texts} kg")
