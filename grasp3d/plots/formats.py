"""Writing of figures to files, in formats chosen by suffix."""

import warnings
from io import BytesIO
from pathlib import Path
from typing import Any

from matplotlib import style
from matplotlib.figure import Figure

from grasp3d.plots.style import styled
from grasp3d.system.files import atomic_write, check_suffix

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
    with style.context(SAVING), atomic_write(path) as part, warnings.catch_warnings():
        # A name in letters that the font lacks is drawn as boxes, without a warning.
        warnings.filterwarnings("ignore", message="Glyph .* missing from font")
        figure.savefig(part, format=suffix[1:], dpi=DPI, metadata=METADATA[suffix])


@styled
def as_svg(figure: Figure) -> bytes:
    """A figure as an SVG document, as `save_as` writes it.

    Args:
        figure: The figure.
    """
    stream = BytesIO()
    with style.context(SAVING), warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="Glyph .* missing from font")
        figure.savefig(stream, format="svg", metadata=METADATA[".svg"])
    return stream.getvalue()


def save(figure: Figure, path: Path) -> tuple[Path, Path]:
    """Write a figure as vector graphics and as a picture, each atomically.

    Args:
        figure: The figure.
        path: Path without suffix, or with one that is replaced.

    Returns:
        The paths, .svg and .png.

    Raises:
        OutputError: The folder is missing or cannot be written to.
    """
    vector, picture = path.with_suffix(".svg"), path.with_suffix(".png")
    save_as(figure, vector)
    save_as(figure, picture)
    return vector, picture
