"""Figure of a surface's best grasps: one small picture each, in the view that shows it best."""

import math
from collections.abc import Sequence
from textwrap import wrap

from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import ListedColormap, Normalize
from matplotlib.figure import Figure

from grasp3d.arrays import Bytes
from grasp3d.grasps.hand_grasps import EvaluatedHandGrasps
from grasp3d.grasps.ranking import stated_label
from grasp3d.plots.figures import PAGE, as_text, label_patches, new_figure, show_picture, styled
from grasp3d.rendering.margin_colors import BOTH_SIDES, most_margin
from grasp3d.settings.model_text import model_line
from grasp3d.stability.label import MEANING, Label
from grasp3d.surface.closed_grasps import UNKNOWN
from grasp3d.surface.grasp_table import GraspTable
from grasp3d.surface.labels import SurfaceLabels
from grasp3d.system.counts import short_number
from grasp3d.system.names import printable

COLUMNS = 4
HEIGHT, APPROACH = 1.9, 0.25
"""Height of a row of pictures with their titles, and of a line on the approach below [inch]."""
MARGINS = 0.9
"""Height of the headline and the legend [inch]."""
LEAST_WIDTH = 4.6
"""Least width of the figure, which the legend needs [inch]."""

REASON = 28
"""Characters in a line of a reason."""

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
    model, below = labels.model, 0 if grasps.reach is None else 1
    settings = f"{model.fingers} fingers, {model_line(model, labels.mesh.unit)}"
    figure, grid = _sheet(labels.mesh.report.source, settings, len(pictures), below)
    for number, (axes, picture) in enumerate(zip(grid, pictures, strict=True)):
        label = Label(int(stated_label(grasps, grasps.closed)[number]))
        title = _title(number + 1, label, grasps.critical_angle[number], grasps.epsilon[number])
        show_picture(axes, picture, title, _approach(grasps, number))
    figure.legend(
        handles=label_patches(MEANING[labels.mode]), loc="outside lower center", ncols=len(Label)
    )
    return figure


@styled
def hand_grasp_figure(
    grasps: EvaluatedHandGrasps, pictures: list[Bytes], numbers: Sequence[int] = ()
) -> Figure:
    """Lay out the pictures of poses of a hand with joints, with the legend of their colours.

    Args:
        grasps: The poses.
        pictures: Pictures of the first poses, at least one.
        numbers: What they are called; empty: 1, 2 and so on.
    """
    model, rule = grasps.model, grasps.contacts.rule
    settings = (
        f"{printable(grasps.hand.name)}, {model_line(model, grasps.mesh.unit)}, contacts {rule}"
    )
    held = grasps.motor_holding
    below = 2 if held is None else 3
    figure, grid = _sheet(grasps.mesh.report.source, settings, len(pictures), below)
    for number, (axes, picture) in enumerate(zip(grid, pictures, strict=True)):
        label, angle = Label(int(grasps.label[number])), grasps.critical_angle[number]
        name = numbers[number] if numbers else number + 1
        title = _title(name, label, angle, grasps.epsilon[number])
        margin = float(grasps.margin[number])
        felt = f"margin {_degrees(margin, '+')}" if math.isfinite(margin) else "no margin"
        lines = [felt, *wrap(str(grasps.reason[number]), REASON)[:2]]
        if held is not None and not math.isnan(held.payload[number]):
            sure = f"{short_number(held.payload_sure[number])} surely"
            lines.insert(1, f"holds {short_number(held.payload[number])}{held.unit}, {sure}")
        show_picture(axes, picture, title, "\n".join(lines))
    most = math.degrees(most_margin(model))
    colors = ListedColormap(BOTH_SIDES / 255.0)
    bar = figure.colorbar(
        ScalarMappable(Normalize(-most, most), colors), ax=list(grid), location="bottom",
        shrink=0.6, aspect=40, pad=0.02, extend="both",
    )  # fmt: skip
    bar.set_label("how much narrower the cone of a link may be for S [°]; grey: no touch")
    bar.ax.grid(visible=False)
    return figure


def _sheet(source: str, settings: str, count: int, below: int) -> tuple[Figure, list[Axes]]:
    """A figure for `count` pictures, with lines of text below each."""
    columns = min(count, COLUMNS)
    rows = math.ceil(count / columns)
    width = max(PAGE * columns / COLUMNS, LEAST_WIDTH)
    figure = new_figure(width, rows * (HEIGHT + below * APPROACH) + MARGINS)
    figure.suptitle(f"{_short(source)}\n{settings}", fontsize=8.5)
    grid = figure.subplots(rows, columns, squeeze=False).ravel()
    for axes in grid[count:]:
        axes.set_axis_off()
    return figure, list(grid[:count])


def _title(number: int, label: Label, angle: float, epsilon: float) -> str:
    title = rf"$\bf{{{number}}}$  {label.name}"
    if math.isnan(angle):
        return title
    return rf"{title}   $\beta^*$ {_degrees(angle)}   $\varepsilon$ {epsilon:.3f}"


def _degrees(angle: float, sign: str = "") -> str:
    """An angle with a typographic minus sign."""
    return f"{round(math.degrees(angle), 1) + 0.0:{sign}.1f}°".replace("-", "−")  # never -0


def _short(name: str) -> str:
    """A file's name as text; its end if it is too long for the headline."""
    text = as_text(name)
    short = text if len(text) <= LONGEST else f"…{text[1 - LONGEST :]}"
    return short.replace("$", r"\$")


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
