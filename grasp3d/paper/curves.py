"""Fig. 7 to 11 of Wan & Howe 2018: epsilon along outlines, fractions S, M and U, and ceilings."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from grasp3d.arrays import Bytes, Floats
from grasp3d.pictures.figures import (
    COLUMN,
    LABEL_COLORS,
    LINES,
    PAGE,
    label_patches,
    new_figure,
    show_picture,
    styled,
)
from grasp3d.pictures.fractions import RESOLUTION, draw_ceiling, stack_fractions
from grasp3d.planar import PlanarScan
from grasp3d.stability.label import Label
from grasp3d.surface.labels import SurfaceLabels
from grasp3d.surface.sweeps import Sweep

_NOMINAL: dict[str, Any] = {"color": "black", "linewidth": 1.6}
_EFFECTIVE: dict[str, Any] = {"color": "#B0B0B0", "linewidth": 4.0}
_CLOSED_FORM: dict[str, Any] = {"color": "black", "linestyle": (0, (3, 2)), "linewidth": 1.0}


@styled
def curves_figure(scans: Sequence[PlanarScan]) -> Figure:
    """Draw a column for each scan: curves of epsilon, and bars of S, M and U under them.

    Args:
        scans: Scans of one outline at several resolutions; at least one.
    """
    figure = new_figure(PAGE, 3.5)
    grid = figure.subplots(
        2, len(scans), squeeze=False, sharex=True, sharey="row", height_ratios=(9.0, 1.0)
    )
    for (curves, bars), scan in zip(grid.T, scans, strict=True):
        _draw_epsilon(curves, scan)
        _draw_labels(bars, scan)
        model, cornered = scan.model, scan.at_corner.any()
        bars.set_xlabel(
            "perimeter from finger 1 to finger 2 [half sides]"
            if cornered
            else r"angle $\theta$ from finger 1 to finger 2 [°]"
        )
        title = (
            rf"{scan.outline.name}, $\mu$ = {model.nominal_friction:g}, "
            rf"$\alpha$ = {math.degrees(model.sensor_resolution):.4g}°"
        )
        if cornered:  # Sec. III-B: exterior angle + alpha
            span = 2.0 * scan.contacts.half_range.max() + model.sensor_resolution
            title += f"\nnormals at corners span {math.degrees(span):.4g}°"
        curves.set_title(title)
    grid[0, 0].set_ylabel(r"grasp quality $\epsilon$")
    handles = [one for axes in grid[:, 0] for one in axes.get_legend_handles_labels()[0]]
    figure.legend(handles=[*handles, *label_patches()], loc="outside lower center", ncols=3)
    return figure


def _draw_epsilon(axes: Axes, scan: PlanarScan) -> None:
    """Draw epsilon at the perceived normals, at the extreme ones, and at the effective friction.

    Curves are broken at corners; there the values are dots.
    """
    x, end = abscissas(scan)
    corners = scan.at_corner
    extremes = (
        (values, {**line, "label": f"extreme normals, tilts {signs}"})
        for values, line, signs in zip(
            scan.epsilon_extremes, LINES, ("+ +", "+ −", "− +", "− −"), strict=False
        )
    )
    for values, line in (
        (
            scan.epsilon_effective,
            {**_EFFECTIVE, "label": r"perceived normals, friction $\mu_\mathrm{eff}$"},
        ),
        *extremes,
        (scan.epsilon, {**_NOMINAL, "label": "perceived normals"}),
    ):
        axes.plot([*x, end], [*np.where(corners, math.nan, values), values[0]], **line)
        axes.plot(x[corners], values[corners], "o", color=line["color"], markersize=3.0)
    for corner in x[corners]:
        axes.axvline(corner, color="#555555", linewidth=0.9, linestyle=":", zorder=1)
    axes.set(xlim=(0.0, end), ylim=(0.0, None), xticks=np.linspace(0.0, end, 9))


def _draw_labels(axes: Axes, scan: PlanarScan) -> None:
    """Draw the labels along the perimeter as bars, those of corners as squares."""
    (x, end), corners = abscissas(scan), scan.at_corner
    place, label = x[~corners], scan.label[~corners]
    first = np.flatnonzero(np.diff(label)) + 1
    bounds = np.concatenate([[0.0], 0.5 * (place[first - 1] + place[first]), [end]])
    bars = np.stack([bounds[:-1], np.diff(bounds)], axis=1).tolist()
    axes.broken_barh(bars, (0.0, 1.0), facecolors=_colors(label[np.append(0, first)]))
    if corners.any():
        axes.scatter(
            x[corners], np.full(corners.sum(), 0.5), 25.0, _colors(scan.label[corners]), marker="s",
            edgecolors="black", linewidths=0.7, clip_on=False, label="label of a corner",
        )  # fmt: skip
    axes.set(ylim=(0.0, 1.0), yticks=[])
    axes.grid(visible=False)
    axes.spines[:].set_visible(False)


def _colors(labels: Bytes) -> list[str]:
    return [LABEL_COLORS[Label(label)] for label in labels]


def abscissas(scan: PlanarScan) -> tuple[Floats, float]:
    """Angles [degrees] of the points of a circle, positions along a square, (k,); and their end."""
    if scan.at_corner.any():
        return scan.position, scan.outline.perimeter
    return np.degrees(scan.angle), 360.0


@styled
def fractions_figure(
    sweep: Sweep,
    label: str = "fraction of the perimeter",
    *,
    scans: Sequence[SurfaceLabels] = (),
    pictures: Sequence[Bytes] = (),
    closed_form: Sweep | None = None,
) -> Figure:
    """Draw fractions over the resolution (Wan & Howe 2018, Fig. 8 and 10), beside surfaces.

    Args:
        sweep: Fractions at one friction.
        label: Name of the fractions.
        scans: A surface's labels at each resolution of the pictures.
        pictures: Pictures of these surfaces, shape (h, w, 3) each; none: only the fractions.
        closed_form: The same fractions in closed form, drawn over them as lines.
    """
    count = len(pictures)
    figure = new_figure(PAGE if count else COLUMN, 2.75)
    grid = figure.subplots(1, count + 1, width_ratios=[1.0] * count + [1.12], squeeze=False)[0]
    axes, handles = grid[-1], list[Any](label_patches())
    stack_fractions(axes, sweep)
    axes.set(xlabel=RESOLUTION, ylabel=f"{label} [%]")
    axes.set_title(rf"{sweep.name}, $\mu$ = {sweep.friction[0]:g}")
    if closed_form is not None:
        bounds = np.stack([closed_form.stable[0], 1.0 - closed_form.unstable[0]], axis=1)
        degrees = np.degrees(closed_form.sensor_resolution)
        handles += axes.plot(degrees, 100.0 * bounds, label="closed form", **_CLOSED_FORM)[:1]
    for place, scan, picture in zip(grid, scans, pictures, strict=False):
        angle = math.degrees(scan.model.sensor_resolution)
        below = "   ".join(
            f"{name} {100.0 * part:.1f} %" for name, part in scan.fractions().items()
        )
        show_picture(place, picture, rf"$\alpha$ = {angle:.4g}°", below)
    if count:
        angles = [math.degrees(scan.model.sensor_resolution) for scan in scans]
        shown: dict[str, Any] = {"markersize": 4.0, "clip_on": False, "label": "shown"}
        handles += axes.plot(angles, [100.0] * count, "vk", **shown)
    columns = len(handles) if count else 2
    figure.legend(handles=handles, loc="outside lower center", ncols=columns)
    return figure


@styled
def ceiling_figure(sweeps: Sequence[Sweep]) -> Figure:
    """Draw the best accuracy of a learned predictor (Wan & Howe 2018, Fig. 11): S + U + M / 2.

    Args:
        sweeps: Fractions of each object at one friction, the same for all.
    """
    figure = new_figure(COLUMN, 2.6)
    axes = figure.add_subplot()
    draw_ceiling(axes, sweeps)
    axes.set(xlabel=RESOLUTION, ylabel="best possible accuracy [%]")
    axes.set_title(rf"$\mu$ = {sweeps[0].friction[0]:g}")
    figure.legend(loc="outside lower center", ncols=len(sweeps))
    return figure
