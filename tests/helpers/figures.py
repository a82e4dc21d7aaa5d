"""What every figure must satisfy, whatever it shows."""

from itertools import combinations
from typing import Any
from unittest.mock import patch

import numpy as np
from matplotlib import style
from matplotlib.figure import Figure
from matplotlib.text import Text
from matplotlib.transforms import Bbox

from grasp3d.plots.formats import DPI, SAVING
from grasp3d.plots.style import STYLE

SLACK = 1.0
"""Pixels by which boxes of words may touch from above or below, or leave the figure."""
GAP = 8.0
"""Pixels that part words in one line."""


def drawn_words(figure: Figure) -> list[tuple[str, Bbox]]:
    """Every text that is drawn when the figure is saved, and the pixels that it takes."""
    seen: list[tuple[str, Bbox]] = []
    draw = Text.draw

    def noted(text: Text, renderer: Any) -> None:
        if text.get_visible() and text.get_text().strip():
            seen.append((text.get_text(), text.get_window_extent(renderer)))
        draw(text, renderer)

    with style.context(["default", STYLE, SAVING]):
        figure.set_dpi(DPI)
        figure.draw_without_rendering()
        with patch.object(Text, "draw", noted):
            figure.canvas.draw()
    return seen


def check_words(figure: Figure) -> None:
    """No word is cut off at the edge of the figure, and no two lie upon each other."""
    words = drawn_words(figure)
    width, height = np.asarray(figure.get_size_inches()) * DPI
    assert words
    for said, box in words:
        assert min(box.x0, box.y0) > -SLACK, f"cut off: {said!r}"
        assert max(box.x1 - width, box.y1 - height) < SLACK, f"cut off: {said!r}"
    for (first, a), (second, b) in combinations(words, 2):
        beside = a.x1 + GAP < b.x0 or b.x1 + GAP < a.x0
        assert beside or a.y1 < b.y0 + SLACK or b.y1 < a.y0 + SLACK, f"{first!r} lies on {second!r}"
