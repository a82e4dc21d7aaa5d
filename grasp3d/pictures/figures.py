"""Figures: their common style and parts, and output to files in formats chosen by suffix.

Sweeps are drawn as fractions S, M and U over friction and resolution, and as accuracy ceilings.
Neither pyplot nor matplotlib's global settings are changed.
"""

import math
import warnings
from collections.abc import Sequence
from importlib.resources import files
from itertools import cycle
from pathlib import Path
from textwrap import fill
from typing import Any

import numpy as np
from matplotlib import rc_params_from_file, style
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from grasp3d.arrays import ArrayLike, Bytes, Floats
from grasp3d.stability.label import COLORS, MEANING, Label
from grasp3d.surface.sweeps import Sweep
from grasp3d.system.files import atomic_write, check_suffix
from grasp3d.system.names import as_unicode

COLUMN = 3.5
"""Width of one column of the paper's journal [inch]."""
PAGE = 7.16
"""Width of both columns [inch]."""

_FILE = files(__package__) / "static" / "figures.mplstyle"
STYLE: dict[str, Any] = dict(rc_params_from_file(str(_FILE), use_default_template=False).items())
"""Settings of matplotlib for all figures."""

LABEL_COLORS: dict[Label, str] = {
    label: "#{:02X}{:02X}{:02X}".format(*color) for label, color in COLORS.items()
}

_COLORS = ("#0072B2", "#CC79A7", "#56B4E9", "#7F3C8D", "#8C6D1F")
_DASHES: tuple[Any, ...] = (
    "-", (0, (5, 1.5)), (0, (5, 1.5, 1, 1.5)), (0, (1, 1.2)), (0, (3, 1, 1, 1, 1, 1)),
)  # fmt: skip
LINES: tuple[dict[str, Any], ...] = tuple(
    {"color": _COLORS[number], "linestyle": _DASHES[(number + turn) % len(_DASHES)]}
    for turn in range(len(_DASHES))
    for number in range(len(_COLORS))
)
"""Styles of curves: the first five also differ in dashes, and all differ in colour from labels.
"""

DPI = 300

SAVING: dict[str, Any] = {
    # Text is saved as outlines, so that it has the same size with any fonts. A comment beside each
    # outline contains the text itself.
    "svg.fonttype": "path",
    "svg.hashsalt": "grasp3d",
}

METADATA: dict[str, dict[str, Any]] = {
    ".svg": {"Date": None, "Creator": "grasp3d"},
    ".png": {"Software": "grasp3d"},
    ".pdf": {"CreationDate": None, "Creator": "grasp3d"},
}
"""Metadata of each format, without the time, so that files are the same bytes each time."""


styled = style.context(["default", STYLE])
"""Decorator of functions that draw; the figures' style applies only while they run."""


@styled
def new_figure(width: float = PAGE, height: float = 2.6) -> Figure:
    """Make an empty figure with its own canvas, laid out when it is saved.

    Args:
        width: Width [inch].
        height: Height [inch].
    """
    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def label_patches(meaning: dict[Label, str] = MEANING["scan"]) -> list[Patch]:
    """Legend entries of the labels, S first.

    Args:
        meaning: Description of each label.
    """
    return [
        Patch(color=LABEL_COLORS[one], linewidth=0.0, label=f"{one.name}  {meaning[one]}")
        for one in sorted(Label, reverse=True)
    ]


def bare(axes: Axes) -> None:
    """Hide the axes' lines, ticks and labels, and scale both directions equally."""
    axes.set_axis_off()
    axes.set_aspect("equal")


def draw_arrow(
    axes: Axes, start: ArrayLike, end: ArrayLike, color: str, name: str = "", **options: Any
) -> None:
    """Draw an arrow from one point (2,) to another, with its name at the tip.

    Args:
        axes: Axes to draw on.
        start: Tail of the arrow.
        end: Tip of the arrow, or the middle of the name.
        color: Colour of arrow and name.
        name: Name of the arrow.
        options: Further options of the text.
    """
    tail, tip = np.asarray([start, end]).tolist()
    axes.update_datalim([tail, tip])
    arrow = {"arrowstyle": "<|-", "color": color, "linewidth": 1.2, "shrinkA": 0.0, "shrinkB": 0.0}
    axes.annotate(
        name, tail, tip, color=color, ha="center", va="center", zorder=9, fontsize=7.0,
        arrowprops={**arrow, "mutation_scale": 7.0}, **options,
    )  # fmt: skip


def show_picture(axes: Axes, picture: Bytes, title: str, below: str) -> None:
    """Show a picture (h, w, 3) without axes, with a title above and a line of text below."""
    axes.imshow(picture)
    axes.set(xticks=[], yticks=[])
    axes.grid(visible=False)
    axes.spines[:].set_visible(False)
    axes.set_title(title)
    axes.set_xlabel(below)


@styled
def save_as(figure: Figure, path: Path) -> None:
    """Write a figure atomically.

    Args:
        figure: The figure.
        path: File to create or replace; .svg, .png or .pdf.

    Raises:
        OutputError: No figure format has this suffix, or the file cannot be written.
    """
    check_suffix(path, METADATA, "figure")
    suffix = path.suffix.lower()
    with atomic_write(path) as part, style.context(SAVING), warnings.catch_warnings():
        # Letters that the font lacks are drawn as boxes, without a warning.
        warnings.filterwarnings("ignore", message="Glyph .* missing from font")
        figure.savefig(part, format=suffix[1:], dpi=DPI, metadata=METADATA[suffix])


PANEL = 1.7
"""Smallest width of a panel [inch]."""
ROW, MARGINS = 1.35, 1.25
"""Height of a row of panels, and total height of the titles and the legend [inch]."""
NAME = 20
"""Number of characters of a name in one line."""
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

    There is one line for each sweep and friction, labelled with what differs among them.

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
    sweeps: Sequence[Sweep], *, members: Sequence[Sweep] = (), fractions: Sequence[float] = ()
) -> Figure:
    """Draw one row for each sweep: its stacked fractions at each friction, and its ceiling.

    Args:
        sweeps: Sweeps of the same values; at least one.
        members: The sweeps whose mean is the last sweep; their S are drawn as thin lines.
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
    """Meaning of each label in sweeps, some of which may be of given grasps.

    Args:
        sweeps: The sweeps, at least one.
    """
    meaning = MEANING[sweeps[0].mode]
    if len({sweep.mode for sweep in sweeps}) > 1:
        names = ", ".join(as_unicode(sweep.name) for sweep in sweeps if sweep.mode == "scan")
        searched, scanned = (MEANING[mode][Label.U] for mode in ("label", "scan"))
        meaning = {**meaning, Label.U: f"{searched} (on {names}: {scanned})"}
    return meaning
