"""Fractions of S, M and U over each of several uncertainties, beside sampled ones."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from grasp3d.plots.fractions import axis_numbers, stack_fractions
from grasp3d.plots.style import PAGE, label_patches, new_figure, styled
from grasp3d.sweeps import Sweep

HEIGHT = 2.5
"""Of the figure [inch]."""

_SAMPLED: dict[str, Any] = {
    "color": "black", "marker": "o", "markersize": 3.0, "linestyle": "none", "clip_on": False,
    "markerfacecolor": "none", "markeredgewidth": 0.8,
}  # fmt: skip


@dataclass(frozen=True, eq=False)
class ErrorPanel:
    """Fractions over one uncertainty."""

    sweep: Sweep
    """One row; its columns are the uncertainty."""
    title: str
    """Of the horizontal axis, with a unit."""
    sampled: Sequence[tuple[float, float, float]] = ()
    """Sampled fractions: the uncertainty as it is drawn, S, and U."""


@styled
def error_fractions_figure(panels: Sequence[ErrorPanel], *, title: str, label: str) -> Figure:
    """Draw stacked fractions over each uncertainty, side by side.

    Args:
        panels: At least one.
        title: Title of the figure.
        label: Name of the fractions.
    """
    figure = new_figure(PAGE, HEIGHT)
    grid = figure.subplots(1, len(panels), sharey=True, squeeze=False)[0]
    for axes, panel in zip(grid, panels, strict=True):
        stack_fractions(axes, panel.sweep)
        numbers = axis_numbers(panel.sweep, panel.sweep.columns)
        axes.set(xlabel=panel.title, xlim=(0.0, numbers[-1]))
        axes.xaxis.set_major_locator(MaxNLocator(5, steps=[1, 2, 5, 10]))
        for at, stable, unstable in panel.sampled:
            axes.plot([at, at], [100.0 * stable, 100.0 * (1.0 - unstable)], **_SAMPLED)
    grid[0].set_ylabel(f"{label} [%]")
    figure.suptitle(title, fontsize="medium")
    handles: list[Any] = [*label_patches()]
    if any(panel.sampled for panel in panels):
        handles.append(Line2D([], [], label="bounds of S and U, sampled", **_SAMPLED))
    figure.legend(handles=handles, loc="outside lower center", ncols=4)
    return figure
