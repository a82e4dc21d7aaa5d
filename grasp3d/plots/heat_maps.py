"""Heat maps of area fractions S and M over two uncertainties, and of the required resolution."""

import math
from collections.abc import Iterable, Sequence
from textwrap import wrap
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import QuadMesh
from matplotlib.colors import Colormap, LinearSegmentedColormap, to_rgb
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator

from grasp3d.arrays import Floats
from grasp3d.plots.figures import LABEL_COLORS, LINES, PAGE, as_text, new_figure, styled
from grasp3d.plots.fractions import axis_numbers, axis_title
from grasp3d.stability.label import Label
from grasp3d.surface.sweeps import Sweep
from grasp3d.surface.sweeps.axes import RESOLUTION

HEIGHT, MARGINS = 2.1, 0.75
"""Height of a row of maps, and of what is above and below them [inch]."""
NAME = 20
"""Characters of a name in one line."""
TINT = 0.12
"""Of the smallest values, which differ from 0, where 0 is hatched."""
_HATCH: dict[str, Any] = {
    "facecolor": "#ECECEE", "edgecolor": "#9A9AA0", "hatch": "////", "linewidth": 0.0,
}  # fmt: skip
"""Of values of 0 that have a meaning of their own."""
_LINE: dict[str, Any] = {"colors": "black", "linewidths": 0.8}


@styled
def heat_map_figure(sweeps: Sequence[Sweep], *, fractions: Sequence[float] = ()) -> Figure:
    """Draw one row for each sweep: S and M over both axes, and the resolution that is required.

    The last map is the coarsest sensor resolution below which the first of `fractions` is S, given
    what the axes state; it is left out if one axis is the resolution. Maps are hatched where
    nothing is S, and where no resolution is fine enough.

    Args:
        sweeps: Sweeps of the same axes with several values each; at least one.
        fractions: Area fractions of S that are drawn as lines, each above 0 and at most 1.
    """
    needed = list(fractions[:1]) if sweeps[0].columns != RESOLUTION else []
    figure = new_figure(PAGE, HEIGHT * len(sweeps) + MARGINS)
    grid = figure.subplots(len(sweeps), 2 + len(needed), squeeze=False, sharex=True, sharey=True)
    tens = _tens(sweep.stable for sweep in sweeps), _tens(sweep.ambiguous for sweep in sweeps)
    hatched = []
    for panels, sweep in zip(grid, sweeps, strict=True):
        maps = [
            (100.0 * sweep.stable, color(Label.S, least=TINT), tens[0], "S: none"),
            (100.0 * sweep.ambiguous, color(Label.M), tens[1], ""),
        ]
        for fraction in needed:
            degrees = np.degrees(sweep.required_resolution(fraction))
            blue = _colors("resolution", LINES[0]["color"], TINT)
            maps.append((degrees, blue, degrees.max(), r"$\alpha$: no sensor is fine enough"))
        for panel, (heights, colors, largest, none) in zip(panels, maps, strict=True):
            quads = draw_heat_map(
                panel, sweep, heights, colors, largest=largest, hatched=bool(none)
            )
            bar = figure.colorbar(quads, ax=panel)
            bar.ax.set_visible(largest > 0.0)
            hatched += [none] if none and not heights.all() else []
        _draw_lines(panels[0], sweep, fractions)
        rows = axis_title(sweep.rows, sweeps)
        name = "\n".join(wrap(as_text(sweep.name), NAME))
        panels[0].set_ylabel(f"{name}\n{rows}" if name else rows, parse_math=False)
    titles = ["surely stable (S) [%]", "ambiguous (M) [%]"]
    titles += [rf"$\alpha$ below which {100.0 * one:g} % are S [°]" for one in needed]
    for panel, title in zip(grid[0], titles, strict=True):
        panel.set_title(title)
    for panel in grid[-1]:
        panel.set_xlabel(axis_title(sweeps[0].columns, sweeps))
    figure.suptitle(sweeps[0].axes.fixed_text, fontsize="medium")
    if hatched:
        patch = Patch(label="; ".join(dict.fromkeys(hatched)), **_HATCH)
        figure.legend(handles=[patch], loc="outside lower center")
    return figure


def draw_heat_map(
    axes: Axes,
    sweep: Sweep,
    heights: Floats,
    colors: Colormap,
    *,
    largest: float = 100.0,
    hatched: bool = False,
) -> QuadMesh:
    """Draw values over the rows and columns of a sweep.

    Args:
        axes: Axes to draw on; columns are along the horizontal axis.
        sweep: The sweep.
        heights: The values, shape (m, k).
        colors: Colours from 0 to the largest value.
        largest: The largest value.
        hatched: Whether values of 0 are hatched.
    """
    x, y = axis_numbers(sweep, sweep.columns), axis_numbers(sweep, sweep.rows)
    cells = np.ma.masked_where((heights == 0.0) & hatched, heights)
    quads = axes.pcolormesh(
        x, y, cells, shading="nearest", cmap=colors, vmin=0.0, vmax=largest or 1.0, rasterized=True
    )
    if cells.mask.any():
        axes.patch.set(**_HATCH)  # the background, seen where nothing is drawn
    axes.set(xlim=(x[0], x[-1]), ylim=(y[0], y[-1]))
    axes.grid(visible=False)
    for side in (axes.xaxis, axes.yaxis):
        side.set_major_locator(MaxNLocator(5, steps=[1, 1.5, 2, 3, 5, 10]))
    return quads


def color(label: Label, *, least: float = 0.0) -> Colormap:
    """Colours of a heat map of a label: nearly white at 0, the label's colour at the largest value.

    Args:
        label: The label.
        least: How much of the label's colour there is at 0; 0: white.
    """
    return _colors(label.name, LABEL_COLORS[label], least)


def _colors(name: str, most: str, least: float) -> Colormap:
    full = np.array(to_rgb(most))
    return LinearSegmentedColormap.from_list(name, np.stack([1.0 - least * (1.0 - full), full]))


def _tens(fractions: Iterable[Floats]) -> float:
    """The largest fraction, rounded up to tens of percents."""
    return max(10.0, 10.0 * math.ceil(max(10.0 * float(one.max()) for one in fractions)))


def _draw_lines(axes: Axes, sweep: Sweep, fractions: Sequence[float]) -> None:
    """Draw lines along which S is a given fraction, with the percents on them."""
    levels = sorted(100.0 * one for one in fractions)
    low, high = 100.0 * sweep.stable.min(), 100.0 * sweep.stable.max()
    inside = [level for level in levels if low < level < high]
    if inside:
        x, y = axis_numbers(sweep, sweep.columns), axis_numbers(sweep, sweep.rows)
        lines = axes.contour(x, y, 100.0 * sweep.stable, levels=inside, **_LINE)
        axes.clabel(lines, fmt="%g %%", fontsize="small")
