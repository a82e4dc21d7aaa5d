"""Figures of area fractions S, M and U over friction and resolution, and of accuracy ceilings."""

import math
from collections.abc import Sequence
from itertools import cycle
from textwrap import fill
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from grasp3d.arrays import Floats
from grasp3d.pictures.figures import LABEL_COLORS, LINES, PAGE, label_patches, new_figure, styled
from grasp3d.stability.label import MEANING, Label
from grasp3d.surface.sweeps import Sweep
from grasp3d.system.names import as_unicode

PANEL = 1.7
"""Least width of a panel [inch]."""
ROW, MARGINS = 1.35, 1.25
"""Height of a row of panels, and of titles and legend above and below the rows [inch]."""
NAME = 20
"""Characters of a name in one line."""
RESOLUTION = r"sensor resolution $\alpha$ [°]"

_MEMBER: dict[str, Any] = {"color": "black", "alpha": 0.45, "linewidth": 0.4}
_MARK: dict[str, Any] = {
    "color": "black", "linestyle": ":", "linewidth": 0.7, "marker": "o", "markersize": 2.5,
    "markevery": [0], "clip_on": False,
}  # fmt: skip


def stack_fractions(
    axes: Axes, sweep: Sweep, row: int = 0, *, fractions: Sequence[float] = ()
) -> None:
    """Stack the fractions S, M and U over the resolution (Wan & Howe 2018, Fig. 8 and 10).

    Args:
        axes: Axes to draw on, in degrees and percent.
        sweep: The sweep.
        row: Row of its friction.
        fractions: Area fractions whose required resolution is marked.
    """
    parts = np.stack([sweep.stable[row], sweep.ambiguous[row], sweep.unstable[row]])
    degrees, heights = _percent_over(sweep, parts)
    colors = [LABEL_COLORS[label] for label in sorted(Label, reverse=True)]
    axes.stackplot(degrees, heights, colors=colors, linewidth=0.0)
    for fraction in fractions:
        resolution = math.degrees(sweep.required_resolution(fraction)[row])
        if max(degrees[0], 0.05) < resolution <= degrees[-1]:
            axes.plot([resolution] * 2, [100.0 * fraction, 0.0], **_MARK)
            axes.annotate(
                f"{resolution:.0f}°", (resolution, 100.0 * fraction), xytext=(-2.0, -2.0),
                textcoords="offset points", ha="right", va="top", fontsize="small",
            )  # fmt: skip
    axes.set(xlim=(degrees[0], degrees[-1]), ylim=(0.0, 100.0), yticks=[0, 25, 50, 75, 100])
    _few_ticks(axes)


def draw_ceiling(axes: Axes, sweeps: Sequence[Sweep]) -> None:
    """Draw the best accuracy of any predictor over the resolution (Wan & Howe 2018, Fig. 11).

    One line for each sweep and friction, labelled with what differs among them.

    Args:
        axes: Axes to draw on, in degrees and percent.
        sweeps: The sweeps.
    """
    lines = [(sweep, row) for sweep in sweeps for row in range(len(sweep.stable))]
    named = len(sweeps) > 1
    valued = not named or len({_row_text(*line) for line in lines}) > 1
    for (sweep, row), line in zip(lines, cycle(LINES), strict=False):
        degrees, height = _percent_over(sweep, sweep.accuracy_ceiling[row])
        label = ", ".join([sweep.name] * named + [_row_text(sweep, row)] * valued)
        axes.plot(degrees, height, label=label, **line)
    axes.set(ylim=(50.0, 100.0), yticks=[50, 60, 70, 80, 90, 100])
    axes.margins(x=0.0)
    _few_ticks(axes)


def _percent_over(sweep: Sweep, values: Floats) -> tuple[Floats, Floats]:
    """Resolutions [degrees], and values (..., k) in percent; a single one is as wide as a bar."""
    degrees = np.degrees(sweep.sensor_resolution)
    if len(degrees) == 1:
        degrees = degrees + np.array([-0.5, 0.5])
    return degrees, 100.0 * np.broadcast_to(values, (*values.shape[:-1], len(degrees)))


def _few_ticks(axes: Axes) -> None:
    axes.locator_params(axis="x", nbins=4, steps=[1, 1.5, 2, 3, 5, 10])


def _row_text(sweep: Sweep, row: int) -> str:
    return f"μ = {sweep.friction[row]:.4g}"


@styled
def sweep_figure(
    sweeps: Sequence[Sweep],
    *,
    members: Sequence[Sweep] = (),
    fractions: Sequence[float] = (),
) -> Figure:
    """Draw one row for each sweep: its stacked fractions at each friction, and its ceiling.

    Args:
        sweeps: Sweeps of the same values; at least one.
        members: The sweeps that the last one is the mean of, whose S are drawn as thin lines.
        fractions: Area fractions whose required resolution is marked.
    """
    rows, columns = len(sweeps), len(sweeps[0].stable) + 1
    figure = new_figure(max(PAGE, PANEL * columns), ROW * rows + MARGINS)
    grid = figure.subplots(rows, columns, squeeze=False, sharex=True)
    for panels, sweep in zip(grid, sweeps, strict=True):
        for row, axes in enumerate(panels[:-1]):
            stack_fractions(axes, sweep, row, fractions=fractions)
            for member in members if sweep is sweeps[-1] else ():
                axes.plot(*_percent_over(member, member.stable[row]), **_MEMBER)
            axes.tick_params(labelleft=row == 0)
        draw_ceiling(panels[-1], [sweep])
        name = fill(as_unicode(sweep.name), NAME)
        panels[0].set_ylabel(name, fontweight="bold", parse_math=False)
    for row, axes in enumerate(grid[0, :-1]):
        axes.set_title(f"friction {_row_text(sweeps[0], row)}")
    grid[0, -1].set_title("accuracy ceiling [%]")
    figure.supylabel("area fraction [%]", fontsize="medium")
    for axes in grid[-1]:
        axes.set_xlabel(RESOLUTION)
    handles = [*label_patches(meaning_in(sweeps)), *grid[0, -1].get_lines()]
    if fractions:
        percents = ", ".join(f"{100.0 * fraction:g}" for fraction in fractions)
        handles.append(Line2D([], [], label=f"coarsest sensor for S on {percents} %", **_MARK))
    if members:
        handles.append(Line2D([], [], label="S of each mesh", **_MEMBER))
    figure.legend(handles=handles, loc="outside lower center", ncols=math.ceil(len(handles) / 3))
    return figure


def meaning_in(sweeps: Sequence[Sweep]) -> dict[Label, str]:
    """Meaning of each label in sweeps, of which some may be of given grasps.

    Args:
        sweeps: At least one.
    """
    meaning = MEANING[sweeps[0].mode]
    if len({sweep.mode for sweep in sweeps}) > 1:
        names = ", ".join(as_unicode(sweep.name) for sweep in sweeps if sweep.mode == "scan")
        searched, scanned = (MEANING[mode][Label.U] for mode in ("label", "scan"))
        meaning = {**meaning, Label.U: f"{searched} (on {names}: {scanned})"}
    return meaning
