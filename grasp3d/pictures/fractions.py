"""Figures of fractions S, M and U over the resolution, and of accuracy ceilings.

They are of sweeps, of outlines, of surfaces beside their pictures, and beside sampled fractions.
"""

import math
from collections.abc import Sequence
from textwrap import wrap
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from grasp3d.arrays import Bytes, Floats
from grasp3d.pictures.figures import (
    COLUMN,
    LABEL_COLORS,
    LINES,
    PAGE,
    as_text,
    fractions_text,
    label_patches,
    new_figure,
    show_picture,
    styled,
)
from grasp3d.stability.label import MEANING, Label
from grasp3d.surface.labels import SurfaceLabels
from grasp3d.surface.sweeps import Sweep

PANEL = 1.7
"""Least width of a panel [inch]."""
ROW = 1.35
"""Height of a row of panels [inch]."""
MARGINS = 1.25
"""Height of titles and legend above and below the rows [inch]."""
NAME = 20
"""Characters of a name in one line."""
LEAST, ENOUGH = 13.0, 30.0
"""Thickness of an area that is needed for its letter, and that is ample [%]."""


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
    degrees, stable, certain = _widened(
        sweep, 100.0 * sweep.stable[row], 100.0 * (1.0 - sweep.unstable[row])
    )
    edges = {
        Label.S: (np.zeros_like(stable), stable),
        Label.M: (stable, certain),
        Label.U: (certain, np.full_like(stable, 100.0)),
    }
    marks = {}
    for fraction in fractions:
        resolution = math.degrees(sweep.required_resolution(fraction)[row])
        if max(degrees[0], 0.05) < resolution <= degrees[-1]:
            marks[fraction] = resolution
    for label, (low, high) in edges.items():
        axes.fill_between(degrees, low, high, color=LABEL_COLORS[label], linewidth=0.0)
        _write_letter(axes, label, degrees, low, high, list(marks.values()))
    for fraction, resolution in marks.items():
        to_left = resolution > 0.2 * degrees[0] + 0.8 * degrees[-1]
        _mark(axes, resolution, 100.0 * fraction, to_left=to_left)
    axes.set(xlim=(degrees[0], degrees[-1]), ylim=(0.0, 100.0), yticks=[0, 25, 50, 75, 100])
    _ticks(axes, sweep)


def draw_ceiling(axes: Axes, sweeps: Sequence[Sweep]) -> None:
    """Draw the best accuracy of any predictor over the resolution (Wan & Howe 2018, Fig. 11).

    One line for each sweep and friction, labelled with what differs among them.

    Args:
        axes: Axes to draw on, in degrees and percent.
        sweeps: The sweeps.
    """
    lines = [(sweep, row) for sweep in sweeps for row in range(len(sweep.stable))]
    one_row = len({row_text(sweep, row) for sweep, row in lines}) == 1
    for number, (sweep, row) in enumerate(lines):
        value = row_text(sweep, row)
        name = value if len(sweeps) == 1 else sweep.name
        label = name if one_row or len(sweeps) == 1 else f"{name}, {value}"
        degrees, height = _widened(sweep, 100.0 * sweep.accuracy_ceiling[row])
        axes.plot(degrees, height, label=label, **_line(number))
    axes.set(ylim=(50.0, 100.0), yticks=[50, 60, 70, 80, 90, 100])
    axes.margins(x=0.0)
    _ticks(axes, sweeps[0])


def row_text(sweep: Sweep, row: int) -> str:
    """The friction of a row of a sweep, as text: 'μ = 0.5'.

    Args:
        sweep: The sweep.
        row: The row.
    """
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
                degrees, height = _widened(member, 100.0 * member.stable[row])
                axes.plot(degrees, height, **_MEMBER)
            axes.tick_params(labelleft=row == 0)
        draw_ceiling(panels[-1], [sweep])
        lines = wrap(as_text(sweep.name), NAME)
        panels[0].set_ylabel("\n".join(lines), fontweight="bold", parse_math=False)
    for row, axes in enumerate(grid[0, :-1]):
        axes.set_title(f"friction {row_text(sweeps[0], row)}")
    grid[0, -1].set_title("accuracy ceiling [%]")
    figure.supylabel("area fraction [%]", fontsize="medium")
    for axes in grid[-1]:
        axes.set_xlabel(r"sensor resolution $\alpha$ [°]")
    further = _legend_lines(fractions, means=bool(members))
    _add_legend(figure, [*grid[0, -1].get_lines(), *further], sweeps)
    return figure


_MEMBER: dict[str, Any] = {"color": "black", "alpha": 0.45, "linewidth": 0.4}
_DOT: dict[str, Any] = {
    "color": "black", "marker": "o", "markersize": 2.5, "linestyle": "none", "clip_on": False,
}  # fmt: skip


def _legend_lines(fractions: Sequence[float], *, means: bool) -> list[Line2D]:
    """Legend entries of the marks and of the thin lines."""
    lines = []
    if fractions:
        percents = ", ".join(f"{100.0 * fraction:g}" for fraction in fractions)
        lines.append(Line2D([], [], label=f"coarsest sensor for S on {percents} %", **_DOT))
    if means:
        lines.append(Line2D([], [], label="S of each mesh", **_MEMBER))
    return lines


def meaning_in(sweeps: Sequence[Sweep]) -> dict[Label, str]:
    """Meaning of each label in sweeps, of which some may be of given grasps.

    Args:
        sweeps: At least one.
    """
    meaning = MEANING[sweeps[0].mode]
    if len({sweep.mode for sweep in sweeps}) > 1:
        names = ", ".join(as_text(sweep.name) for sweep in sweeps if sweep.mode == "scan")
        searched, scanned = (MEANING[mode][Label.U] for mode in ("label", "scan"))
        meaning = {**meaning, Label.U: f"{searched} (on {names}: {scanned})"}
    return meaning


def _add_legend(figure: Figure, lines: Sequence[Line2D], sweeps: Sequence[Sweep]) -> None:
    handles = [*label_patches(meaning_in(sweeps)), *lines]
    figure.legend(handles=handles, loc="outside lower center", ncols=math.ceil(len(handles) / 3))


def _widened(sweep: Sweep, *heights: Floats) -> tuple[Floats, ...]:
    """Resolutions [degrees] and heights over them; a single resolution becomes a bar."""
    degrees = np.degrees(sweep.sensor_resolution)
    if len(degrees) > 1:
        return (degrees, *heights)
    return (degrees + np.array([-0.5, 0.5]), *(np.repeat(height, 2) for height in heights))


def _write_letter(
    axes: Axes, label: Label, degrees: Floats, low: Floats, high: Floats, marks: Sequence[float]
) -> None:
    """Write the label's letter into its area, if it fits, off the marks and near the middle."""
    span = degrees[-1] - degrees[0]
    x = degrees[0] + span * np.linspace(0.08, 0.92, 43)
    nearby = x[:, None] + span * np.linspace(-0.05, 0.05, 5)
    bottom = np.interp(nearby, degrees, low).max(axis=1)
    top = np.interp(nearby, degrees, high).min(axis=1)
    height = np.minimum(top - bottom, ENOUGH)
    beside = 0.06 if label == Label.S else 0.28  # the number of a mark is above S
    for mark in marks:
        height = np.where(np.abs(x - mark) < beside * span, 0.0, height)
    off_middle = np.abs(x - x.mean()) / span
    best = int(np.argmax(height - off_middle))
    if height[best] >= LEAST:
        middle = 0.5 * (top[best] + bottom[best])
        axes.text(x[best], middle, label.name, ha="center", va="center", weight="bold")


def _mark(axes: Axes, resolution: float, percent: float, *, to_left: bool) -> None:
    """Mark the resolution at which S falls to a fraction, with its number above, to one side."""
    axes.plot([resolution] * 2, [0.0, percent], color="black", linestyle=":", linewidth=0.7)
    axes.plot([resolution], [percent], **_DOT)
    axes.annotate(
        f"{resolution:.0f}°",
        (resolution, percent),
        xytext=(-3.0 if to_left else 3.0, 1.5),
        textcoords="offset points",
        ha="right" if to_left else "left",
        fontsize="small",
    )


def _line(number: int) -> dict[str, Any]:
    """Colour and dashes of a line; a repeated colour has other dashes."""
    count = len(LINES)
    return {
        **LINES[number % count],
        "linestyle": LINES[(number + number // count) % count]["linestyle"],
    }


def _ticks(axes: Axes, sweep: Sweep) -> None:
    degrees = np.degrees(sweep.sensor_resolution)
    if len(degrees) == 1:
        axes.set_xticks([round(float(degrees[0]), 3)])
    else:
        axes.xaxis.set_major_locator(MaxNLocator(4, steps=[1, 1.5, 2, 3, 5, 10]))


HEIGHT = 2.6
"""Height of the figures [inch]."""

CLOSED_FORM: dict[str, Any] = {"color": "black", "linestyle": (0, (3, 2)), "linewidth": 1.0}


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
