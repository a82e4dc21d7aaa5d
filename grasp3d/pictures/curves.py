"""Epsilon along an outline, with the labels under it (Wan & Howe 2018, Fig. 7 and 9)."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from grasp3d.arrays import Bytes, Floats
from grasp3d.pictures.figures import LABEL_COLORS, LINES, PAGE, label_patches, new_figure, styled
from grasp3d.planar import PlanarScan
from grasp3d.stability.label import Label

Over = Literal["angle", "position"]

HEIGHT = 3.5
"""Of the figure [inch]."""
CURVES, BAR = 9.0, 1.0
"""Height ratio of the curves and the bars."""

LETTER = 0.05
"""Fraction of the axis from which a bar is labelled with its letter."""

_NOMINAL: dict[str, Any] = {"color": "black", "linewidth": 1.6}
_EFFECTIVE: dict[str, Any] = {"color": "#B0B0B0", "linewidth": 4.0, "solid_capstyle": "butt"}
_COMBINATIONS = ("+ +", "+ −", "− +", "− −")


@dataclass(frozen=True, eq=False)
class Run:
    """An interval of the axis with one label."""

    start: float
    end: float
    label: Label


@styled
def curves_figure(scans: Sequence[PlanarScan], *, over: Over, unit: str = "unit") -> Figure:
    """Draw a column for each scan: curves of epsilon, and bars of S, M and U under them.

    Args:
        scans: Scans of one outline at several resolutions; at least one.
        over: Abscissa: the second finger's 'angle' [degrees] or its 'position' along the perimeter,
            both from the fixed finger [unit].
        unit: Unit of the outline's lengths.
    """
    figure = new_figure(PAGE, HEIGHT)
    grid = figure.subplots(
        2, len(scans), squeeze=False, sharex=True, sharey="row", height_ratios=(CURVES, BAR)
    )
    for (curves, bars), scan in zip(grid.T, scans, strict=True):
        epsilon_curves(curves, scan, over=over)
        label_bars(bars, scan, over=over)
        bars.set_xlabel(
            r"angle $\theta$ from finger 1 to finger 2 [°]"
            if over == "angle"
            else f"perimeter from finger 1 to finger 2 [{unit}]"
        )
        model = scan.model
        curves.set_title(
            rf"{scan.outline.name}, $\mu$ = {model.nominal_friction:g}, "
            rf"$\alpha$ = {math.degrees(model.sensor_resolution):.4g}°"
        )
    grid[0, 0].set_ylabel(r"grasp quality $\epsilon$")
    cornered = any(scan.at_corner.any() for scan in scans)
    figure.legend(handles=_handles(cornered=cornered), loc="outside lower center", ncols=3)
    return figure


def epsilon_curves(axes: Axes, scan: PlanarScan, *, over: Over) -> None:
    """Draw epsilon at the perceived normals, at the extreme ones, and at the effective friction.

    Curves are broken at corners; there the values are dots.

    Args:
        axes: Axes to draw on.
        scan: The scan.
        over: As in `curves_figure`.
    """
    x, corners = axis_positions(scan, over), scan.at_corner
    values = [
        (scan.epsilon_effective, _EFFECTIVE),
        *zip(scan.epsilon_extremes, LINES, strict=False),
        (scan.epsilon, _NOMINAL),
    ]
    for epsilon, line in values:
        closed = np.append(epsilon, epsilon[0])
        axes.plot(x, np.where(np.append(corners, False), math.nan, closed), **line)
        if corners.any():
            size = 3.0 if line is not _EFFECTIVE else 5.5
            axes.plot(
                x[:-1][corners], epsilon[corners], "o", color=line["color"], markersize=size
            )  # fmt: skip
    for number, (corner, span) in enumerate(_corner_spans(scan, x)):
        axes.axvline(corner, color="#555555", linewidth=0.9, linestyle=":", zorder=1)
        if number == 0:
            axes.annotate(
                f"corner:\nnormals\nspan {span:.4g}°",
                (corner, 0.97), xycoords=axes.get_xaxis_transform(),
                xytext=(3.0, 0.0), textcoords="offset points", va="top", fontsize=7.0,
            )  # fmt: skip
    axes.set(xlim=(0.0, x[-1]), ylim=(0.0, None))
    axes.xaxis.set_ticks(np.linspace(0.0, x[-1], 9))
    axes.tick_params(labelbottom=False)


def label_bars(axes: Axes, scan: PlanarScan, *, over: Over) -> None:
    """Draw the labels along the perimeter as bars with letters, those of corners as squares.

    Args:
        axes: Axes to draw on.
        scan: The scan.
        over: As in `curves_figure`.
    """
    x, corners = axis_positions(scan, over), scan.at_corner
    smooth = ~corners
    for run in label_runs(x[:-1][smooth], scan.label[smooth], x[-1]):
        axes.axvspan(run.start, run.end, color=LABEL_COLORS[run.label], linewidth=0.0)
        start, end = _widest(run, x[:-1][corners])
        if end - start > LETTER * x[-1]:
            middle = 0.5 * (start + end)
            axes.text(middle, 0.5, run.label.name, ha="center", va="center_baseline")
    for corner, label in zip(x[:-1][corners], scan.label[corners], strict=True):
        axes.plot(
            [corner], [0.5], "s", color=LABEL_COLORS[Label(label)], markersize=5.0,
            markeredgecolor="black", markeredgewidth=0.7, clip_on=False,
        )  # fmt: skip
    axes.set(ylim=(0.0, 1.0), yticks=[])
    axes.grid(visible=False)
    axes.spines[:].set_visible(False)


def axis_positions(scan: PlanarScan, over: Over) -> Floats:
    """Abscissas of the scanned points, and the end of the axis, shape (k + 1,)."""
    if over == "angle":
        return np.append(np.degrees(scan.angle), 360.0)
    return np.append(scan.position - scan.position[0], scan.outline.perimeter)


def label_runs(x: Floats, labels: Bytes, end: float) -> list[Run]:
    """Intervals of one label, with bounds halfway between the points where the label changes.

    Args:
        x: Abscissas of the points in order, shape (k,).
        labels: Their `Label` codes, shape (k,).
        end: End of the last interval; the first starts at 0.
    """
    changes = np.flatnonzero(np.diff(labels)) + 1
    bounds = [0.0, *(0.5 * (x[changes - 1] + x[changes])).tolist(), end]
    codes = labels[np.append(0, changes)].tolist()
    return [
        Run(start, stop, Label(code))
        for start, stop, code in zip(bounds[:-1], bounds[1:], codes, strict=True)
    ]


def _widest(run: Run, corners: Floats) -> tuple[float, float]:
    """Widest part of a run between corners."""
    within = corners[(corners > run.start) & (corners < run.end)]
    bounds = [run.start, *within.tolist(), run.end]
    return max(pairwise(bounds), key=lambda part: part[1] - part[0])


def _corner_spans(scan: PlanarScan, x: Floats) -> list[tuple[float, float]]:
    """Abscissa of each corner, and its range of normals [degrees].

    Wan & Howe 2018, Sec. III-B: exterior angle + alpha.
    """
    corners = np.flatnonzero(scan.at_corner)
    spans = 2.0 * scan.contacts.half_range[corners] + scan.model.sensor_resolution
    return list(zip(x[corners].tolist(), np.degrees(spans).tolist(), strict=True))


def _handles(*, cornered: bool) -> list[Any]:
    """Legend entries, for three columns of four, four and three."""
    empty = Line2D([], [], linestyle="none", label=" ")
    corner = Line2D([], [], marker="s", color="white", markeredgecolor="black", linestyle="none",
                    markersize=5.0, label="label of the corner itself")  # fmt: skip
    return [
        Line2D([], [], label="perceived normals", **_NOMINAL),
        Line2D([], [], label=r"perceived normals, friction $\mu_\mathrm{eff}$", **_EFFECTIVE),
        corner if cornered else empty,
        empty,
        *(
            Line2D([], [], label=f"extreme normals, tilts {signs}", **line)
            for signs, line in zip(_COMBINATIONS, LINES, strict=False)
        ),
        *label_patches(),
    ]
