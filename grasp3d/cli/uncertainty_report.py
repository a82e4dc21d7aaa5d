"""Printed lines on what is uncertain beside the sensor's normals, and on the margin it leaves."""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, Protocol

import numpy as np

from grasp3d.arrays import Floats
from grasp3d.cli.report import LEVELS, PERCENTS, Column
from grasp3d.settings import GraspModel
from grasp3d.settings.lengths import Measure, Unit, small_length
from grasp3d.settings.model_text import SAFE_LABELS, error_texts, friction_text
from grasp3d.stability.thresholds import margin_budget
from grasp3d.surface.area_statistics import quantiles

MARGIN = "margin: friction angle to spare, S: above 0; "
"""Part of the legend of a table."""


class _Labelled(Protocol):
    """A surface or grasps with labels."""

    @property
    def model(self) -> Any: ...
    @property
    def critical_angle(self) -> Floats: ...
    @property
    def margin(self) -> Floats: ...


def is_uncertain(model: GraspModel) -> bool:
    """Whether anything but the sensor's normals is uncertain.

    Args:
        model: The model.
    """
    return bool(
        model.friction_error or model.normal_error or model.location_error or model.per_finger
    )


def uncertainty_lines(
    labelled: _Labelled, weights: Floats | None, *, of: str, unit: Unit | None
) -> list[str]:
    """What is uncertain, the margins, and the mean budget; nothing if only normals are.

    Args:
        labelled: Labels of a surface, or grasps.
        weights: Area of each vertex, shape (k,); None: all grasps equally.
        of: What the margins are of: 'area', 'grasps'.
        unit: Unit of the mesh.
    """
    model = labelled.model
    if not is_uncertain(model):
        return []
    lines = [f"uncertain: {'; '.join(_uncertainties(model, unit))}"]
    if model.certainty == "safe":
        lines.append(f"safe labels: {SAFE_LABELS}")
    critical = np.where(np.isfinite(labelled.critical_angle), labelled.critical_angle, np.inf)
    areas = np.ones(len(critical)) if weights is None else weights
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
    return [margin] * is_uncertain(grasps.model)


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
