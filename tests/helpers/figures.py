"""Checks for every figure: no text is cut off or overlaps another."""

from itertools import combinations
from typing import Any
from unittest.mock import patch

import numpy as np
from matplotlib import style
from matplotlib.figure import Figure
from matplotlib.text import Text
from matplotlib.transforms import Bbox

from grasp3d.pictures.figures import DPI, SAVING, STYLE

SLACK = 1.0
"""Overlap of texts in height, or beyond the figure's edge, that is accepted [pixels]."""
GAP = 8.0
"""Smallest distance between texts in one line [pixels]."""


def drawn_texts(figure: Figure) -> list[tuple[str, Bbox]]:
    """Every text that is drawn when the figure is saved, with its bounding box in pixels."""
    texts: list[tuple[str, Bbox]] = []
    draw = Text.draw

    def record(text: Text, renderer: Any) -> None:
        if text.get_visible() and text.get_text().strip():
            box = Text.get_window_extent(text, renderer)  # without the arrow of an annotation
            texts.append((text.get_text(), box))
        draw(text, renderer)

    with style.context(["default", STYLE, SAVING]):
        figure.set_dpi(DPI)
        figure.draw_without_rendering()
        with patch.object(Text, "draw", record):
            figure.canvas.draw()
    return texts


def check_texts(figure: Figure) -> None:
    """Check that no text is cut off at the edge of the figure, and that no two overlap."""
    texts = drawn_texts(figure)
    width, height = np.asarray(figure.get_size_inches()) * DPI
    assert texts
    for text, box in texts:
        assert min(box.x0, box.y0) > -SLACK, f"cut off: {text!r}"
        assert max(box.x1 - width, box.y1 - height) < SLACK, f"cut off: {text!r}"
    for (first, a), (second, b) in combinations(texts, 2):
        beside = a.x1 + GAP < b.x0 or b.x1 + GAP < a.x0
        above = a.y1 < b.y0 + SLACK or b.y1 < a.y0 + SLACK
        assert beside or above, f"{first!r} overlaps {second!r}"
