"""Figures: their common style, their parts, and files of them in formats chosen by suffix.

Neither pyplot nor matplotlib's global settings are changed.
"""

import warnings
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import rc_params_from_file, style
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from grasp3d.arrays import ArrayLike, Bytes
from grasp3d.stability.label import COLORS, MEANING, Label
from grasp3d.system.files import atomic_write, check_suffix

COLUMN = 3.5
"""Width of one column of the paper's journal [inch]."""
PAGE = 7.16
"""Width of its two columns [inch]."""

_FILE = files(__package__) / "static" / "figures.mplstyle"
STYLE: dict[str, Any] = dict(rc_params_from_file(str(_FILE), use_default_template=False).items())
"""Settings of matplotlib that all figures have."""

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
"""Styles of curves: the first five are distinct in dashes as well, and all in colour from labels.
"""

DPI = 300

SAVING: dict[str, Any] = {
    # Text as outlines, so that it has the same size with any fonts; the text itself is in a comment
    # beside each outline.
    "svg.fonttype": "path",
    "svg.hashsalt": "grasp3d",
}

METADATA: dict[str, dict[str, Any]] = {
    ".svg": {"Date": None, "Creator": "grasp3d"},
    ".png": {"Software": "grasp3d"},
    ".pdf": {"CreationDate": None, "Creator": "grasp3d"},
}
"""Metadata of each format: no time, so that files are the same bytes each time."""


styled = style.context(["default", STYLE])
"""Decorator of functions that draw: the figures' style applies while they run, and only then."""


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
    """Draw an arrow from one point (2,) to another, where its name is written.

    Args:
        axes: Axes to draw on.
        start: Its tail.
        end: Its tip, or the middle of the name.
        color: Of both.
        name: Its name.
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
        path: File to make or replace; .svg, .png or .pdf.

    Raises:
        OutputError: No figure has that suffix, or the file cannot be written.
    """
    check_suffix(path, METADATA, "figure")
    suffix = path.suffix.lower()
    with atomic_write(path) as part, style.context(SAVING), warnings.catch_warnings():
        # A name in letters that the font lacks is drawn as boxes, without a warning.
        warnings.filterwarnings("ignore", message="Glyph .* missing from font")
        figure.savefig(part, format=suffix[1:], dpi=DPI, metadata=METADATA[suffix])
