"""Shares of S, M and U over the sensor's resolution, and the ceiling that they set."""

import math
from collections.abc import Mapping, Sequence
from textwrap import wrap
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from grasp3d.arrays import Floats
from grasp3d.plots.style import (
    LABEL_COLORS,
    LINES,
    PAGE,
    as_text,
    label_patches,
    new_figure,
    styled,
)
from grasp3d.stability.label import MEANING, Label
from grasp3d.sweeps import Sweep

PANEL = 1.7
"""Least width of a panel [inch]."""
ROW = 1.35
"""Height of a row of panels [inch]."""
AROUND = 1.25
"""Height of what stands above and below the rows [inch]."""
NAME = 20
"""Letters of a name in one line."""
LEAST, ENOUGH = 13.0, 30.0
"""Thickness of an area that has room for its letter, and plenty of it [%]."""


def stacked(axes: Axes, sweep: Sweep, row: int = 0, *, shares: Sequence[float] = ()) -> None:
    """Stack the shares of S, M and U over the resolution (Wan & Howe 2018, Fig. 8 and 10).

    Args:
        axes: Where to draw; in degrees and percent.
        sweep: What to draw.
        row: Which of its frictions.
        shares: Shares of the surface whose required resolution is marked.
    """
    degrees, stable, certain = _widened(
        sweep, 100.0 * sweep.stable[row], 100.0 * (1.0 - sweep.unstable[row])
    )
    edges = {
        Label.S: (np.zeros_like(stable), stable),
        Label.M: (stable, certain),
        Label.U: (certain, np.full_like(stable, 100.0)),
    }
    places = {share: math.degrees(sweep.required_resolution(share)[row]) for share in shares}
    marks = {share: at for share, at in places.items() if max(degrees[0], 0.05) < at <= degrees[-1]}
    for label, (low, high) in edges.items():
        axes.fill_between(degrees, low, high, color=LABEL_COLORS[label], linewidth=0.0)
        _write_letter(axes, label, degrees, low, high, list(marks.values()))
    for share, place in marks.items():
        _mark(axes, place, 100.0 * share, left=place > 0.2 * degrees[0] + 0.8 * degrees[-1])
    axes.set(xlim=(degrees[0], degrees[-1]), ylim=(0.0, 100.0), yticks=[0, 25, 50, 75, 100])
    _degree_ticks(axes, sweep)


def ceiling(axes: Axes, sweeps: Sequence[Sweep]) -> None:
    """Draw the best accuracy of any predictor over the resolution (Wan & Howe 2018, Fig. 11).

    One line for each sweep and friction, labelled with what tells them apart.

    Args:
        axes: Where to draw; in degrees and percent.
        sweeps: What to draw.
    """
    lines = [(sweep, row) for sweep in sweeps for row in range(len(sweep.friction))]
    one_friction = len({float(sweep.friction[row]) for sweep, row in lines}) == 1
    for number, (sweep, row) in enumerate(lines):
        friction = f"μ = {sweep.friction[row]:g}"
        name = friction if len(sweeps) == 1 else sweep.name
        label = name if one_friction or len(sweeps) == 1 else f"{name}, {friction}"
        degrees, height = _widened(sweep, 100.0 * sweep.accuracy_ceiling[row])
        axes.plot(degrees, height, label=label, **_line(number))
    axes.set(ylim=(50.0, 100.0), yticks=[50, 60, 70, 80, 90, 100])
    axes.margins(x=0.0)
    _degree_ticks(axes, sweeps[0])


@styled
def sweep_figure(
    sweeps: Sequence[Sweep],
    *,
    members: Mapping[str, Sequence[Sweep]] | None = None,
    shares: Sequence[float] = (),
) -> Figure:
    """Draw one row for each sweep: its stacked shares at each friction, and its ceiling.

    Args:
        sweeps: Of the same frictions; at least one.
        members: By a sweep's name, those it is the mean of, whose S are drawn as thin lines.
        shares: Shares of the surface whose required resolution is marked.
    """
    members = members or {}
    rows, columns = len(sweeps), len(sweeps[0].friction) + 1
    figure = new_figure(max(PAGE, PANEL * columns), ROW * rows + AROUND)
    grid = figure.subplots(rows, columns, squeeze=False, sharex=True)
    for panels, sweep in zip(grid, sweeps, strict=True):
        for row, axes in enumerate(panels[:-1]):
            stacked(axes, sweep, row, shares=shares)
            for member in members.get(sweep.name, ()):
                degrees, height = _widened(member, 100.0 * member.stable[row])
                axes.plot(degrees, height, **_MEMBER)
            axes.tick_params(labelleft=row == 0)
        ceiling(panels[-1], [sweep])
        lines = wrap(as_text(sweep.name), NAME)
        panels[0].set_ylabel("\n".join(lines), fontweight="bold", parse_math=False)
    for axes, friction in zip(grid[0, :-1], sweeps[0].friction, strict=True):
        axes.set_title(f"friction μ = {friction:g}")
    grid[0, -1].set_title("accuracy ceiling [%]")
    figure.supylabel("share of the surface [%]", fontsize="medium")
    for axes in grid[-1]:
        axes.set_xlabel(r"sensor resolution $\alpha$ [°]")
    _add_legend(figure, [*grid[0, -1].get_lines(), *_keys(shares, bool(members))], sweeps)
    return figure


_MEMBER: dict[str, Any] = {"color": "black", "alpha": 0.45, "linewidth": 0.4}
_DOT: dict[str, Any] = {
    "color": "black", "marker": "o", "markersize": 2.5, "linestyle": "none", "clip_on": False,
}  # fmt: skip


def _keys(shares: Sequence[float], means: bool) -> list[Line2D]:
    """Legend entries of the marks and of the thin lines."""
    keys = []
    if shares:
        told = ", ".join(f"{100.0 * share:g}" for share in shares)
        keys.append(Line2D([], [], label=f"coarsest sensor for S on {told} %", **_DOT))
    if means:
        keys.append(Line2D([], [], label="S of each mesh", **_MEMBER))
    return keys


def _add_legend(figure: Figure, lines: Sequence[Line2D], sweeps: Sequence[Sweep]) -> None:
    meaning = MEANING[sweeps[0].mode]
    if len({sweep.mode for sweep in sweeps}) > 1:
        given = ", ".join(as_text(sweep.name) for sweep in sweeps if sweep.mode == "scan")
        searched, scanned = (MEANING[mode][Label.U] for mode in ("label", "scan"))
        meaning = {**meaning, Label.U: f"{searched} ({given}: {scanned})"}
    handles = [*label_patches(meaning), *lines]
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
    places = degrees[0] + span * np.linspace(0.08, 0.92, 43)
    around = places[:, None] + span * np.linspace(-0.05, 0.05, 5)
    bottom = np.interp(around, degrees, low).max(axis=1)
    top = np.interp(around, degrees, high).min(axis=1)
    room = np.minimum(top - bottom, ENOUGH)
    beside = 0.06 if label == Label.S else 0.28  # a mark's number stands above S
    for mark in marks:
        room = np.where(np.abs(places - mark) < beside * span, 0.0, room)
    off_middle = np.abs(places - places.mean()) / span
    best = int(np.argmax(room - off_middle))
    if room[best] >= LEAST:
        middle = 0.5 * (top[best] + bottom[best])
        axes.text(places[best], middle, label.name, ha="center", va="center", weight="bold")


def _mark(axes: Axes, place: float, share: float, *, left: bool) -> None:
    """Mark the resolution at which S falls to a share; its number stands above, to one side."""
    axes.plot([place, place], [0.0, share], color="black", linestyle=":", linewidth=0.7)
    axes.plot([place], [share], **_DOT)
    axes.annotate(
        f"{place:.0f}°",
        (place, share),
        xytext=(-3.0 if left else 3.0, 1.5),
        textcoords="offset points",
        ha="right" if left else "left",
        fontsize="small",
    )


def _line(number: int) -> dict[str, Any]:
    """Colour and dashes of a line; each colour meets other dashes when it comes again."""
    count = len(LINES)
    return {
        **LINES[number % count],
        "linestyle": LINES[(number + number // count) % count]["linestyle"],
    }


def _degree_ticks(axes: Axes, sweep: Sweep) -> None:
    if len(sweep.sensor_resolution) == 1:
        axes.set_xticks([round(math.degrees(sweep.sensor_resolution[0]), 3)])
    else:
        axes.xaxis.set_major_locator(MaxNLocator(4, steps=[1, 1.5, 2, 3, 5, 10]))
