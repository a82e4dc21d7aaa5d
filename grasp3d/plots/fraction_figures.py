"""Figures of one outline's or surface's fractions of S, M and U, and of accuracy ceilings."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from grasp3d.plots.fractions import draw_ceiling, stack_fractions
from grasp3d.plots.style import COLUMN, label_patches, new_figure, styled
from grasp3d.sweeps import Sweep

HEIGHT = 2.6
"""Height of the figures [inch]."""

CLOSED_FORM: dict[str, Any] = {"color": "black", "linestyle": (0, (3, 2)), "linewidth": 1.0}


@styled
def fractions_figure(sweep: Sweep, *, label: str = "fraction of the perimeter") -> Figure:
    """Draw fractions of S, M and U over the resolution (Wan & Howe 2018, Fig. 8 and 10).

    Args:
        sweep: Fractions at one friction.
        label: Name of the fractions.
    """
    figure = new_figure(COLUMN, HEIGHT)
    draw_fractions(figure.add_subplot(), sweep, label=label)
    figure.legend(
        handles=label_patches(), loc="outside lower center", ncols=2, handlelength=1.8
    )  # fmt: skip
    return figure


@styled
def ceiling_figure(sweeps: Sequence[Sweep]) -> Figure:
    """Draw the best accuracy of a learned predictor (Wan & Howe 2018, Fig. 11): S + U + M / 2.

    Args:
        sweeps: Fractions of each object at one friction, the same for all.
    """
    figure = new_figure(COLUMN, HEIGHT)
    axes = figure.add_subplot()
    draw_ceiling(axes, sweeps)
    axes.set(xlabel=r"sensor resolution $\alpha$ [°]", ylabel="best possible accuracy [%]")
    axes.set_title(rf"$\mu$ = {sweeps[0].friction[0]:g}")
    figure.legend(loc="outside lower center", ncols=len(sweeps))
    return figure


def draw_fractions(
    axes: Axes, sweep: Sweep, *, label: str, closed_form: Sweep | None = None
) -> None:  # fmt: skip
    """Draw stacked fractions with a title and axis labels.

    Args:
        axes: Axes to draw on.
        sweep: Fractions at one friction.
        label: Name of the fractions.
        closed_form: The same fractions in closed form, drawn over them as lines.
    """
    stack_fractions(axes, sweep)
    if closed_form is not None:
        degrees = np.degrees(closed_form.sensor_resolution)
        for fraction in (closed_form.stable[0], 1.0 - closed_form.unstable[0]):
            axes.plot(degrees, 100.0 * fraction, **CLOSED_FORM)
    axes.set(xlabel=r"sensor resolution $\alpha$ [°]", ylabel=f"{label} [%]")
    axes.set_title(rf"{sweep.name}, $\mu$ = {sweep.friction[0]:g}")
