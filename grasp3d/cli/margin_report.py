"""Printed lines on what is uncertain, the margin that it leaves, and the load of grasps."""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, Protocol

import numpy as np

from grasp3d.arrays import Floats
from grasp3d.cli.report import LEVELS, PERCENTS, Column, Report, escaped, percent_text
from grasp3d.quality.force_ranges import Certainty
from grasp3d.quality.task_texts import TaskText
from grasp3d.settings import GraspModel
from grasp3d.settings.lengths import Measure, Unit, small_length
from grasp3d.settings.model_text import SAFE_LABELS, error_texts, friction_text
from grasp3d.stability.label import Label
from grasp3d.stability.thresholds import margin_budget
from grasp3d.surface.area_statistics import quantiles
from grasp3d.surface.holding import Holding
from grasp3d.system.counts import short_number

MARGIN = "margin: friction angle to spare, S: above 0; "
LOAD = (
    "force: grip force that holds the load at the worst normals, in N; payload: mass that is held, "
    "in kg; "
)
"""Parts of the legend of a table."""

_HOW: dict[Certainty, str] = {
    "exact": "at the worst normals",
    "bound": "at the worst normals, a safe bound",
}


ROUNDING = 1e-9
"""Rounding error of sums of area fractions."""


class _Labelled(Protocol):
    """A surface or grasps with labels."""

    @property
    def model(self) -> Any: ...
    @property
    def critical_angle(self) -> Floats: ...
    @property
    def margin(self) -> Floats: ...


def uncertainty_lines(
    labelled: _Labelled, areas: Floats | None, *, of: str, unit: Unit | None
) -> list[str]:
    """What is uncertain, the margins, and the mean budget; nothing if only normals are.

    Args:
        labelled: Labels of a surface, or grasps.
        areas: Area of each vertex, shape (k,); None: all grasps equally.
        of: What the margins are of: 'area', 'grasps'.
        unit: Unit of the mesh.
    """
    model = labelled.model
    if not model.is_uncertain:
        return []
    lines = [f"uncertain: {'; '.join(_uncertainties(model, unit))}"]
    if model.certainty == "safe":
        lines.append(f"safe labels: {SAFE_LABELS}")
    critical = np.where(np.isfinite(labelled.critical_angle), labelled.critical_angle, np.inf)
    areas = np.ones(len(critical)) if areas is None else areas
    of_grasps = np.where(np.isfinite(critical), areas, 0.0)
    if not of_grasps.sum() > 0.0:
        return lines
    margin = np.where(np.isfinite(critical), labelled.margin, -np.inf)
    texts = ", ".join(map(margin_text, quantiles(margin, LEVELS, areas)))
    budget = margin_budget(model, critical, model.effective_friction_angle - margin)
    return [
        *lines,
        f"margin, {PERCENTS} of the {of}: {texts} (S: above 0)",
        f"mean budget: {budget.mean(of_grasps).line}",
    ]


def margin_columns(grasps: _Labelled) -> list[Column]:
    """The margin of each grasp, if anything but the sensor's normals is uncertain."""
    margin: Column = ("margin", lambda row: margin_text(grasps.margin[row]))
    return [margin] * grasps.model.is_uncertain


def margin_text(margin: float) -> str:
    """Format a margin in degrees; -inf means that there is no grasp.

    Args:
        margin: The margin [rad].
    """
    return "none" if not math.isfinite(margin) else f"{math.degrees(margin) + 0.0:.1f}°"


def _uncertainties(model: GraspModel, unit: Unit | None) -> Sequence[str]:
    parts = [f"friction {friction_text(model)}"] if model.friction_error else []
    if model.normal_error:
        parts.append(f"normals by a further {math.degrees(model.normal_error):.4g}°")
    if model.location_error:
        stated = "" if unit or isinstance(model.location_error, Measure) else " (unit not stated)"
        parts.append(f"contact locations by {small_length(model.location_error, unit)}{stated}")
    return parts + error_texts(replace(model, normal_error=0.0, location_error=0.0), unit)


def print_load(report: Report, holding: Holding | None, areas: Floats | None = None) -> None:
    """Print a load, which part of the surface or which grasps hold it, and forces and payloads.

    Args:
        report: Where to print.
        holding: What is held; None: there is no load, and nothing is printed.
        areas: Area fraction of each vertex of a surface, shape (k,); None: grasps are given.
    """
    if holding is None:
        return
    mass = "mass not given" if holding.mass is None else f"{short_number(holding.mass)} kg"
    task = holding.load.task
    text = escaped(str(task)) if isinstance(task, TaskText) else "a given task"
    force = holding.case.at_hand
    per_finger = f"{force} per finger" if force else "none given"
    report.line(f"[bold]load[/]: {mass}, {text}; force at hand: {per_finger}")
    if holding.remedy and np.isfinite(holding.grip_force_largest).any():  # else the verdict says it
        report.line(f"  most grasps hold nothing: {escaped(holding.remedy)}")
    count = len(holding.grip_force)
    weights = np.ones(count) if areas is None else areas
    if holding.label is not None:
        sums = {label.name: weights[holding.label == label].sum() for label in sorted(Label)[::-1]}
        number = percent_text if areas is not None else "{:.0f}".format
        whole = "the surface" if areas is not None else f"{count} grasps"
        parts = ", ".join(f"{name} {number(part)}" for name, part in sums.items())
        report.paragraph(f"  held by {number(sums['S'])} of {whole} ({parts})")
    of, per = "grasps" if areas is None else "area", "" if holding.case.decided else " per kg"
    part = _part_text(holding.grip_force_largest, weights, f"of the {of}", "need at most", "N")
    report.line(f"  grip force{per} {_HOW[holding.how]}: some suffices on {part}")
    if holding.has_payload:
        payloads = np.where(holding.payload > 0.0, holding.payload, math.inf)
        part = _part_text(payloads, weights, f"of the {of}", "hold at most", "kg")
        report.line(f"  payload with {force}: above 0 on {part}")


def _part_text(values: Floats, weights: Floats, of: str, verb: str, unit: str) -> str:
    """Which part of the grasps has a finite value, and the quantiles over that part."""
    where = np.isfinite(values)
    part = weights[where].sum() / weights.sum()
    if not part > 0.0:
        return f"none {of}"
    numbers = quantiles(values[where], LEVELS, weights[where])
    texts = ", ".join(map(short_number, numbers))
    some = "all" if part > 1.0 - ROUNDING else percent_text(part)
    return f"{some} {of}, {PERCENTS} of which {verb} {texts} {unit}"


def force_text(force: float) -> str:
    """Format a force; inf: none suffices."""
    return "none" if not math.isfinite(force) else short_number(force)


def holding_columns(holding: Holding | None) -> list[Column]:
    """The grip force at the worst normals and the payload of grasps, as far as known."""
    if holding is None:
        return []
    force: Column = ("force", lambda row: force_text(holding.grip_force_largest[row]))
    payload: Column = ("payload", lambda row: short_number(holding.payload[row]))
    return [force, *[payload] * holding.has_payload]
