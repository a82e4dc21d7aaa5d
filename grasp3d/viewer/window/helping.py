"""The help that lies over a window: all keys, what the mouse does, and what is drawn."""

import math
from collections.abc import Sequence
from typing import Any

from vtkmodules.vtkRenderingCore import vtkRenderer

from grasp3d.arrays import Bytes
from grasp3d.viewer.session.keys import DRAWING, KEYS, MOUSE
from grasp3d.viewer.window.canvas import INK, LINE, QUIET, WHITE, Canvas, shortened, width_of
from grasp3d.viewer.window.sheet import Sheet

WIDTH = 720.0
MARGIN, STEP, HEAD, PART = 24.0, 24.0, 46.0, 34.0
LEAST_STEP = 18.5
"""Height of a row from which the drawing is explained as well [pixels]."""
ARROWS = {"Left": "←", "Right": "→", "Up": "↑", "Down": "↓"}


class Help:
    """Shows the help in the middle of a window, in a layer of its own."""

    def __init__(self, window: Any) -> None:  # noqa: ANN401
        """Add the layer to a window of VTK."""
        renderer = vtkRenderer()
        renderer.SetLayer(1)
        renderer.InteractiveOff()
        window.SetNumberOfLayers(2)
        window.AddRenderer(renderer)
        self.shown = False
        """Whether the help is to be seen."""
        self._sheet = Sheet(renderer)
        self._room = (1, 1, 1.0)

    def fit(self, width: int, height: int, scale: float) -> None:
        """Take in the size of the window [pixels], and the pixels for one of a letter's."""
        self._room = (width, height, scale)
        self.show(self.shown)

    def show(self, shown: bool) -> None:
        """Show it, or take it away."""
        self.shown = shown
        if not shown:
            self._sheet.hide()
            return
        width, height, scale = self._room
        card = help_card(width / scale, height / scale, scale)
        high, wide = card.shape[:2]
        self._sheet.show(card, left=(width - wide) // 2, bottom=(height - high) // 2)


def help_card(width: float, height: float, scale: float) -> Bytes:
    """Draw it, as large as it needs to be and not larger than the window.

    Args:
        width: Of the window [pixels].
        height: Of the window [pixels].
        scale: Pixels of the screen for one of its own.

    Returns:
        Red, green, blue, shape (h, w, 3).
    """
    rows = [*((ARROWS.get(key, key), known.words) for key, known in KEYS.items()), *MOUSE]
    half = math.ceil(len(rows) / 2)
    wide = min(WIDTH, width - 16.0)
    most = height - 16.0
    drawing = DRAWING if _step(most, half + len(DRAWING), PART) >= LEAST_STEP else ()
    below = len(drawing) * STEP + PART if drawing else 0.0
    high = min(HEAD + half * STEP + below + 2.0 * MARGIN, most)
    step = _step(high, half + len(drawing), PART if drawing else 0.0)
    canvas = Canvas(wide, high, scale=scale, paper=WHITE)
    canvas.box((0.0, 0.0, wide, high), WHITE, border=LINE)
    canvas.text(MARGIN, MARGIN + 8.0, "Keys and mouse", size=16, bold=True)
    if wide > 480.0:
        closing = "h, or a click, closes this"
        canvas.text(wide - MARGIN, MARGIN + 8.0, closing, color=QUIET, anchor="r")
    column = (wide - 2.0 * MARGIN) / 2.0
    for number, part in enumerate((rows[:half], rows[half:])):
        _column(canvas, part, MARGIN + number * column, column - 12.0, step)
    if drawing:
        _drawing(canvas, drawing, MARGIN + HEAD - 8.0 + half * step, wide - 2.0 * MARGIN, step)
    return canvas.pixels


def _step(high: float, rows: int, other: float) -> float:
    """Height of a row in a card [pixels]."""
    return min(STEP, (high - HEAD - 1.5 * MARGIN - other) / rows)


def _drawing(
    canvas: Canvas, rows: Sequence[tuple[str, str]], top: float, width: float, step: float
) -> None:
    """What is drawn on the scene, below the keys."""
    canvas.text(MARGIN, top + 0.5 * PART + 2.0, "The drawing", size=14, bold=True)
    start = max(width_of(what) for what, _ in rows) + 20.0
    for number, (what, words) in enumerate(rows):
        middle = top + PART + (number + 0.5) * step
        canvas.text(MARGIN, middle, what, color=INK)
        canvas.text(MARGIN + start, middle, shortened(words, width - start), color=QUIET)


def _column(
    canvas: Canvas, rows: Sequence[tuple[str, str]], left: float, width: float, step: float
) -> None:
    caps = max(width_of(name) for name, _ in rows) + 14.0
    for number, (name, words) in enumerate(rows):
        middle = MARGIN + HEAD - 8.0 + (number + 0.5) * step
        cap = max(24.0, width_of(name) + 12.0)
        box = (left, middle - 9.5, left + cap, middle + 9.5)
        canvas.box(box, "#EEF1F4", radius=4, border="#B9C2CC")
        canvas.text(left + 0.5 * cap, middle, name, color=INK, anchor="m")
        start = max(caps, 24.0) + 10.0
        canvas.text(left + start, middle, shortened(words, width - start))
