"""Figure of a surface's best grasps: one small picture each, in the view that shows it best."""

import math

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from grasp3d.arrays import Bytes
from grasp3d.grasps.ranking import stated_label
from grasp3d.plots.figures import PAGE, as_text, label_patches, new_figure, show_picture, styled
from grasp3d.settings.model_text import model_line
from grasp3d.stability.label import MEANING, Label
from grasp3d.surface.closed_grasps import UNKNOWN
from grasp3d.surface.grasp_table import GraspTable
from grasp3d.surface.labels import SurfaceLabels
from grasp3d.system.counts import short_number

COLUMNS = 4
HEIGHT, APPROACH = 1.9, 0.25
"""Height of a row of pictures with their titles, and of a line on the approach below [inch]."""
MARGINS = 0.9
"""Height of the headline and the legend [inch]."""
LEAST_WIDTH = 4.6
"""Least width of the figure, which the legend needs [inch]."""

LONGEST = 48
"""Characters of a name in the headline."""


@styled
def grasp_figure(labels: SurfaceLabels, grasps: GraspTable, pictures: list[Bytes]) -> Figure:
    """Lay out the pictures of grasps, numbered from the best.

    Args:
        labels: The labelled surface.
        grasps: The grasps, best first.
        pictures: Pictures of the first grasps, at least one.
    """
    columns = min(len(pictures), COLUMNS)
    rows = math.ceil(len(pictures) / columns)
    width = max(PAGE * columns / COLUMNS, LEAST_WIDTH)
    height = HEIGHT if grasps.reach is None else HEIGHT + APPROACH
    figure = new_figure(width, rows * height + MARGINS)
    model = labels.model
    figure.suptitle(
        f"{_short(labels.mesh.report.source)}\n"
        f"{model.fingers} fingers, {model_line(model, labels.mesh.unit)}",
        fontsize=8.5,
    )
    grid = figure.subplots(rows, columns, squeeze=False).ravel()
    for axes in grid[len(pictures) :]:
        axes.set_axis_off()
    for number, (axes, picture) in enumerate(zip(grid, pictures, strict=False)):
        _show(axes, grasps, number, picture)
    figure.legend(
        handles=label_patches(MEANING[labels.mode]), loc="outside lower center", ncols=len(Label)
    )
    return figure


def _short(name: str) -> str:
    """A file's name as text; its end if it is too long for the headline."""
    text = as_text(name)
    short = text if len(text) <= LONGEST else f"…{text[1 - LONGEST :]}"
    return short.replace("$", r"\$")


def _show(axes: Axes, grasps: GraspTable, number: int, picture: Bytes) -> None:
    angle = math.degrees(grasps.critical_angle[number])
    label = Label(int(stated_label(grasps, grasps.closed)[number])).name
    title = (
        rf"$\bf{{{number + 1}}}$  {label}   $\beta^*$ {angle:.1f}°"
        rf"   $\varepsilon$ {grasps.epsilon[number]:.3f}"
    )
    show_picture(axes, picture, title, _approach(grasps, number))


def _approach(grasps: GraspTable, number: int) -> str:
    """How far the approach may turn, and the force, or else the label after closing."""
    margin = math.nan if grasps.reach is None else float(grasps.reach.approach_margin[number])
    if not math.isfinite(margin):
        return ""
    text = f"approach ±{math.degrees(margin):.0f}°"
    if (holding := grasps.holding) is not None:
        force = float(holding.grip_force_largest[number])
        return f"{text}, {short_number(force)} N" if math.isfinite(force) else f"{text}, no force"
    code = UNKNOWN if grasps.closed is None else int(grasps.closed.label[number])
    return text if code == UNKNOWN else f"{text}, closed {Label(code).name}"
