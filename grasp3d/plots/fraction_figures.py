"""Shares of one outline or surface as a figure of its own, and the ceiling of several."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from grasp3d.plots.fractions import ceiling, stacked
from grasp3d.plots.style import COLUMN, label_patches, new_figure, styled
from grasp3d.sweeps import Sweep

HEIGHT = 2.6
"""Of the figures [inch]."""

CLOSED_FORM: dict[str, Any] = {"color": "black", "linestyle": (0, (3, 2)), "linewidth": 1.0}


@styled
def shares_figure(sweep: Sweep, *, whole: str = "perimeter") -> Figure:
    """Draw shares of S, M and U over the resolution (Wan & Howe 2018, Fig. 8 and 10).

    Args:
        sweep: Shares at one friction.
        whole: What they are shares of.
    """
    figure = new_figure(COLUMN, HEIGHT)
    draw_shares(figure.add_subplot(), sweep, whole=whole)
    figure.legend(
        handles=label_patches(), loc="outside lower center", ncols=2, handlelength=1.8
    )  # fmt: skip
    return figure


@styled
def ceiling_figure(sweeps: Sequence[Sweep]) -> Figure:
    """Draw the best accuracy of a learned predictor (Wan & Howe 2018, Fig. 11): S + U + M / 2.

    Args:
        sweeps: Shares of each object at one friction, the same for all.
    """
    figure = new_figure(COLUMN, HEIGHT)
    axes = figure.add_subplot()
    ceiling(axes, sweeps)
    axes.set(xlabel=r"sensor resolution $\alpha$ [°]", ylabel="best possible accuracy [%]")
    axes.set_title(rf"$\mu$ = {sweeps[0].friction[0]:g}")
    figure.legend(loc="outside lower center", ncols=len(sweeps))
    return figure


def draw_shares(
    axes: Axes, sweep: Sweep, *, whole: str, closed_form: Sweep | None = None
) -> None:  # fmt: skip
    """Draw stacked shares with their title and labels.

    Args:
        axes: Where to draw.
        sweep: Shares at one friction.
        whole: What they are shares of.
        closed_form: The same shares in closed form, drawn over them as lines.
    """
    stacked(axes, sweep)
    if closed_form is not None:
        degrees = np.degrees(closed_form.sensor_resolution)
        for share in (closed_form.stable[0], 1.0 - closed_form.unstable[0]):
            axes.plot(degrees, 100.0 * share, **CLOSED_FORM)
    axes.set(xlabel=r"sensor resolution $\alpha$ [°]", ylabel=f"share of the {whole} [%]")
    axes.set_title(rf"{sweep.name}, $\mu$ = {sweep.friction[0]:g}")
