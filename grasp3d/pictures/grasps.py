"""Figure of grasps: one small picture each, in the view that shows it best."""

import math
from textwrap import wrap

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from grasp3d.arrays import Bytes
from grasp3d.grasps.evaluated_poses import EvaluatedPoses
from grasp3d.pictures.figures import PAGE, label_patches, new_figure, show_picture, styled
from grasp3d.settings.model_text import model_line
from grasp3d.stability.label import MEANING, Label, Mode
from grasp3d.surface.grasp_table import GraspTable
from grasp3d.system.counts import short_number
from grasp3d.system.names import as_unicode, printable

COLUMNS = 4
HEIGHT, LINE = 1.9, 0.2
"""Height of a row of pictures with their titles, and of a line of text below [inch]."""
MARGINS = 0.9
"""Height of the headline and the legend [inch]."""
LEAST_WIDTH = 4.6
"""Least width of the figure, which the legend needs [inch]."""

REASON = 28
"""Characters in a line of a reason."""

LONGEST = 48
"""Characters of a name in the headline."""


@styled
def grasp_figure(
    grasps: GraspTable | EvaluatedPoses, pictures: list[Bytes], mode: Mode = "scan"
) -> Figure:
    """Lay out the pictures of grasps, with the legend of their colours.

    Args:
        grasps: The grasps.
        pictures: Pictures of the first grasps, at least one.
        mode: That of the labels of the surface; of grasps without such labels 'scan'.
    """
    model = grasps.model
    fingers = f"{model.fingers} fingers" if grasps.scene is None else grasps.scene.hand.name
    settings = f"{printable(fingers)}, {model_line(model, metres=grasps.mesh.unit is not None)}"
    texts = [_lines(grasps, row) for row in range(len(pictures))]
    below = max(map(len, texts))
    figure, grid = _sheet(grasps.mesh.report.source, settings, len(pictures), below)
    for row, (axes, picture) in enumerate(zip(grid, pictures, strict=True)):
        label = Label(int(grasps.letter[row]))
        title = rf"$\bf{{{row + 1}}}$  {label.name}   {grasps.score[row]:.3f}"
        show_picture(axes, picture, title, "\n".join(texts[row]))
    figure.legend(
        handles=label_patches(MEANING[mode]), loc="outside lower center", ncols=len(Label)
    )
    return figure


def _lines(grasps: GraspTable | EvaluatedPoses, row: int) -> list[str]:
    """What is written below the picture of a grasp."""
    angle, lines = float(grasps.critical_angle[row]), []
    if math.isfinite(angle):
        beta = rf"$\beta^*$ {math.degrees(angle):.1f}°"
        lines = [rf"{beta}   $\varepsilon$ {grasps.epsilon[row]:.3f}"]
    if isinstance(grasps, EvaluatedPoses):
        load = []
        if grasps.grip_force is not None and math.isfinite(grasps.grip_force[row]):
            load.append(f"needs {short_number(grasps.grip_force[row])} N")
        if grasps.payload is not None and math.isfinite(grasps.payload[row]):
            load.append(f"holds {short_number(grasps.payload[row])} kg")
        lines = [", ".join(load)] if load and grasps.load is not None else lines
        turn = grasps.held_at(row).approach_margin
        lines += [f"approach ±{math.degrees(turn):.0f}°"] if math.isfinite(turn) else []
        lines += wrap(str(grasps.reason[row]).replace("$", r"\$"), REASON)[:2]
    return lines


def _sheet(source: str, settings: str, count: int, below: int) -> tuple[Figure, list[Axes]]:
    """A figure for `count` pictures, with lines of text below each."""
    columns = min(count, COLUMNS)
    rows = math.ceil(count / columns)
    width = max(PAGE * columns / COLUMNS, LEAST_WIDTH)
    figure = new_figure(width, rows * (HEIGHT + below * LINE) + MARGINS)
    figure.suptitle(f"{_short(source)}\n{settings}", fontsize=8.5, parse_math=False)
    grid = figure.subplots(rows, columns, squeeze=False).ravel()
    for axes in grid[count:]:
        axes.set_axis_off()
    return figure, list(grid[:count])


def _short(name: str) -> str:
    """A file's name as text; its end if it is too long for the headline."""
    text = as_unicode(name)
    return text if len(text) <= LONGEST else f"…{text[1 - LONGEST :]}"
