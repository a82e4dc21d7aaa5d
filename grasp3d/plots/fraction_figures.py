"""Figures of fractions of S, M and U of one outline or surface, and of accuracy ceilings.

Fractions are over the resolution, also beside pictures of the labelled surface, or over each of
several uncertainties, beside sampled ones.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from grasp3d.arrays import Bytes
from grasp3d.plots.figures import (
    COLUMN,
    PAGE,
    fractions_text,
    label_patches,
    new_figure,
    show_picture,
    styled,
)
from grasp3d.plots.fractions import axis_numbers, draw_ceiling, stack_fractions
from grasp3d.plots.rendering import Finger
from grasp3d.surface.labels import SurfaceLabels
from grasp3d.surface.sweeps import Sweep

HEIGHT = 2.6
"""Height of the figures [inch]."""

CLOSED_FORM: dict[str, Any] = {"color": "black", "linestyle": (0, (3, 2)), "linewidth": 1.0}

PANEL_HEIGHT = 2.5
"""Height of the figure of panels [inch]."""

_SAMPLED: dict[str, Any] = {
    "color": "black", "marker": "o", "markersize": 3.0, "linestyle": "none", "clip_on": False,
    "markerfacecolor": "none", "markeredgewidth": 0.8,
}  # fmt: skip

SURFACE_HEIGHT = 2.75
"""Height of the figure with pictures of a surface [inch]."""
PICTURE, CURVES = 1.0, 1.12
"""Width ratio of a picture and the curves."""

_SHOWN: dict[str, Any] = {
    "color": "black", "linestyle": "none", "marker": "v", "markersize": 4.0, "clip_on": False,
}  # fmt: skip


@styled
def fractions_figure(sweep: Sweep) -> Figure:
    """Draw fractions of a perimeter over the resolution (Wan & Howe 2018, Fig. 8 and 10).

    Args:
        sweep: Fractions at one friction.
    """
    figure = new_figure(COLUMN, HEIGHT)
    draw_fractions(figure.add_subplot(), sweep, label="fraction of the perimeter")
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
    figure = new_figure(PAGE, PANEL_HEIGHT)
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


@styled
def surface_figure(
    scans: Sequence[SurfaceLabels],
    pictures: Sequence[Bytes],
    sweep: Sweep,
    *,
    closed_form: Sweep | None = None,
) -> Figure:
    """Draw the surface at some resolutions, and beside it the area fractions over all.

    The counterpart in space of Wan & Howe 2018, Fig. 7 to 10.

    Args:
        scans: The surface's labels at each resolution.
        pictures: Pictures of the same surfaces, shape (h, w, 3) each; none: only the fractions.
        sweep: Area fractions at one friction.
        closed_form: The same fractions in closed form, drawn over them.
    """
    count = len(pictures)
    figure = new_figure(PAGE if count else PAGE / 2.0, SURFACE_HEIGHT)
    grid = figure.subplots(1, count + 1, width_ratios=[PICTURE] * count + [CURVES], squeeze=False)
    for axes, scan, picture in zip(grid[0, :count], scans, pictures, strict=bool(count)):
        title = rf"$\alpha$ = {math.degrees(scan.model.sensor_resolution):.4g}°"
        show_picture(axes, picture, title, fractions_text(scan.fractions()))
    curves = grid[0, -1]
    draw_fractions(curves, sweep, label="area fraction", closed_form=closed_form)
    if count:
        angles = [math.degrees(scan.model.sensor_resolution) for scan in scans]
        curves.plot(angles, np.ones(count), transform=curves.get_xaxis_transform(), **_SHOWN)
    handles: list[Any] = [*label_patches()]
    if closed_form is not None:
        handles.append(Line2D([], [], label="closed form", **CLOSED_FORM))
    if count:
        handles.append(Line2D([], [], label="shown", **_SHOWN))
    figure.legend(
        handles=handles,
        loc="outside lower center",
        ncols=len(handles) if count else 2,
        handlelength=1.8,
        columnspacing=1.4,
    )
    return figure


def fixed_fingers(scan: SurfaceLabels) -> list[Finger]:
    """The fixed fingers of a scan, for pictures."""
    points, normals = scan.grasps.positions[0, 1:], scan.grasps.contacts.normals[0, 1:]
    return [Finger(point, normal) for point, normal in zip(points, normals, strict=True)]
