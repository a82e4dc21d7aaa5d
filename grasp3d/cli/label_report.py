"""Printed report of a labelled surface."""

import math
from pathlib import Path

import numpy as np

from grasp3d.cli.load_report import print_load
from grasp3d.cli.report import (
    CHECK_HINT,
    LEVELS,
    PERCENTS,
    WARNING,
    Report,
    angle_text,
    escaped,
    label_name,
    length_with_unit,
    model_words,
    percent_text,
    table_of,
)
from grasp3d.cli.uncertainty_report import uncertainty_lines
from grasp3d.grasps.verdict import verdict_of
from grasp3d.hand.scene import Scene
from grasp3d.settings import AnySampling
from grasp3d.settings.lengths import Unit
from grasp3d.settings.model_text import MINIMUM
from grasp3d.settings.parsing import plain_values
from grasp3d.stability.label import MEANING
from grasp3d.stability.label import Label as Code
from grasp3d.surface.area_statistics import vertex_weights
from grasp3d.surface.labels import SurfaceLabels
from grasp3d.surface.vertex_grasps import Reason
from grasp3d.system.counts import counted

_REASONS = {
    Reason.NO_PARTNER: "no opposing contacts within the search cone give force closure",
    Reason.OPENING: "all opposing contacts are closer or farther than the limits allow",
    Reason.NOT_REACHED: "the gripper reaches none of their grasps",
    Reason.OFF_SURFACE: "in no face, so their label is U and their area 0",
}
"""Explanations of vertices without a grasp."""


def print_labels(labels: SurfaceLabels, output: Path) -> None:
    """Print the settings, area fractions, quantiles, repairs and warnings of a labelled surface.

    Args:
        labels: Labels of the surface.
        output: The file that they were written to.
    """
    report, mesh = Report(), labels.mesh
    _print_settings(report, labels)
    rows = (
        (label_name(Code[name]), MEANING["label"][Code[name]], percent_text(fraction))
        for name, fraction in labels.fractions().items()
    )
    report.table(table_of(("label", "", "area fraction"), rows, texts=3))
    if labels.sampling is not None:
        report.line(f"[bold]{escaped(str(verdict_of(labels).text))}[/]")
    angles = ", ".join(map(angle_text, labels.angle_quantiles(LEVELS)))
    report.paragraph(f"critical friction angle, {PERCENTS} of the area: {angles}")
    weights = vertex_weights(mesh, "area")
    report.lines(uncertainty_lines(labels, weights, of="area", unit=mesh.unit))
    report.line(_epsilon_text(labels))
    print_load(report, labels)
    counts = np.bincount(labels.reason, minlength=len(Reason))
    for reason, explanation in _REASONS.items():
        if counts[reason]:
            report.paragraph(f"{counted(int(counts[reason]), 'vertices')}: {explanation}")
    for step in mesh.report.repairs:
        report.paragraph(f"repaired: {escaped(str(step))}")
    report.lines(labels.warnings, WARNING)
    if mesh.report.warnings:
        report.paragraph(CHECK_HINT)
    report.written(output)


def _print_settings(report: Report, labels: SurfaceLabels) -> None:
    """Print the mesh, the model, the gripper, and settings of the search that are not default."""
    mesh, model = labels.mesh, labels.model
    report.line(
        f"[bold]{escaped(mesh.report.source)}[/]: {counted(len(mesh.vertices), 'vertices')}, "
        f"size {length_with_unit(mesh.size, mesh.unit)}; {model_words(model)}"
        + ("" if model.fingers == 2 else f", {model.fingers} fingers")
    )
    if model.method == "extremes":
        report.paragraph(
            f"labels from wrench hulls at {model.extreme_normals} extreme normals per contact, "
            f"{'circular cones' if model.edges is None else f'cones of {model.edges} edges'}"
        )
    if labels.sampling is not None and (differences := _differences(labels.sampling, mesh.unit)):
        report.paragraph(f"search settings: {differences}")
    if labels.scene is not None:
        report.line(_scene_text(labels.scene, mesh.size, mesh.unit))
    if labels.search.evaluated and model.fingers > 2:
        report.paragraph(f"{counted(labels.search.evaluated, 'candidate grasps')} evaluated")


def _epsilon_text(labels: SurfaceLabels) -> str:
    """Return the quantiles of epsilon and of its minimum over the tilts."""
    nominal, minimum = (
        ", ".join(f"{value:.3f}" for value in labels.epsilon_quantiles(LEVELS, of=of))
        for of in ("nominal", "minimum")
    )
    least = MINIMUM[labels.model.tilts]
    return f"epsilon, {PERCENTS} of the area: {nominal}; {least}: {minimum}"


def _scene_text(scene: Scene, size: float, unit: Unit | None) -> str:
    """Return the gripper, the table, and the limit of approach directions."""
    hand, table, approach = scene.hand, scene.table, scene.approach
    text = f"gripper {escaped(hand.name)}, stroke {1000.0 * hand.max_opening:.4g} mm"
    if table is not None:
        up = ", ".join(f"{number + 0.0:.3g}" for number in table.normal)
        height = round(table.offset / size, 9) * size + 0.0  # without rounding errors
        text += f"; table at {length_with_unit(height, unit)}, up ({up})"
        if table.probability is not None:
            text += f", resting pose of probability {100.0 * table.probability:.0f} %"
    if approach.within < math.pi:
        text += f"; approach within {math.degrees(approach.within):.4g}°"
    return text


def _differences(sampling: AnySampling, unit: Unit | None) -> str:
    """Return the settings of the search that differ from their defaults."""
    defaults = plain_values(type(sampling)())
    angles, lengths = ("search_angle", "tolerance"), sampling.length_names()

    def text(name: str, value: float) -> str:
        if name in angles:
            return f"{math.degrees(value):.4g}°"
        return length_with_unit(value, unit) if name in lengths else f"{value}"

    return ", ".join(
        f"{name} {text(name, value)}"
        for name, value in plain_values(sampling).items()
        if value != defaults[name]
    )
