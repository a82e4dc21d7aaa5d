"""The help in front of a window: keys, mouse, and symbols of the scene."""

import math
from collections.abc import Sequence
from typing import Any

from vtkmodules.vtkRenderingCore import vtkRenderer

from grasp3d.arrays import Bytes
from grasp3d.viewer.scene.text_layout import shortened, text_width
from grasp3d.viewer.session.keys import DRAWING, KEYS, MOUSE
from grasp3d.viewer.window.canvas import INK, LINE, QUIET, WHITE, Canvas, ImageActor

WIDTH = 720.0
MARGIN, ROW_HEIGHT, HEAD, HEADING = 24.0, 24.0, 46.0, 34.0
MIN_ROW_HEIGHT = 18.5
"""Smallest height of a row at which the symbols of the scene are explained as well [pixels]."""
ARROWS = {"Left": "←", "Right": "→", "Up": "↑", "Down": "↓"}


class HelpOverlay:
    """Shows the help in the middle of a window, in a separate layer."""

    def __init__(self, window: Any) -> None:
        """Add the layer to a render window of VTK."""
        renderer = vtkRenderer()
        renderer.SetLayer(1)
        renderer.InteractiveOff()
        window.SetNumberOfLayers(2)
        window.AddRenderer(renderer)
        self.visible = False
        """Whether the help is visible."""
        self._image = ImageActor(renderer)
        self._window = (1, 1, 1.0)

    def fit(self, width: int, height: int, scale: float) -> None:
        """Adapt to the size of the window [pixels], and to the screen pixels per panel pixel."""
        self._window = (width, height, scale)
        self.show(self.visible)

    def show(self, visible: bool) -> None:
        """Show or hide the help."""
        self.visible = visible
        if not visible:
            self._image.hide()
            return
        width, height, scale = self._window
        image = help_image(width / scale, height / scale, scale)
        image_height, image_width = image.shape[:2]
        self._image.show(
            image, left=(width - image_width) // 2, bottom=(height - image_height) // 2
        )


def help_image(window_width: float, window_height: float, scale: float) -> Bytes:
    """Draw the help, not larger than the window.

    Args:
        window_width: Width of the window [pixels].
        window_height: Height of the window [pixels].
        scale: Screen pixels per pixel.

    Returns:
        RGB colours, shape (h, w, 3).
    """
    rows = [*((ARROWS.get(key, key), known.text) for key, known in KEYS.items()), *MOUSE]
    half = math.ceil(len(rows) / 2)
    width = min(WIDTH, window_width - 16.0)
    limit = window_height - 16.0
    fits = _row_height(limit, half + len(DRAWING), HEADING) >= MIN_ROW_HEIGHT
    drawing = DRAWING if fits else ()
    below = len(drawing) * ROW_HEIGHT + HEADING if drawing else 0.0
    height = min(HEAD + half * ROW_HEIGHT + below + 2.0 * MARGIN, limit)
    step = _row_height(height, half + len(drawing), HEADING if drawing else 0.0)
    canvas = Canvas(width, height, scale=scale, color=WHITE)
    canvas.box((0.0, 0.0, width, height), WHITE, border=LINE)
    canvas.text(MARGIN, MARGIN + 8.0, "Keys and mouse", size=16, bold=True)
    if width > 480.0:
        closing = "h or a click closes this help"
        canvas.text(width - MARGIN, MARGIN + 8.0, closing, color=QUIET, anchor="r")
    column = (width - 2.0 * MARGIN) / 2.0
    for number, part in enumerate((rows[:half], rows[half:])):
        _draw_keys(canvas, part, MARGIN + number * column, column - 12.0, step)
    if drawing:
        top = MARGIN + HEAD - 8.0 + half * step
        _draw_symbols(canvas, drawing, top, width - 2.0 * MARGIN, step)
    return canvas.pixels


def _row_height(height: float, rows: int, heading: float) -> float:
    """Height of each of some rows in an image of some height [pixels]."""
    return min(ROW_HEIGHT, (height - HEAD - 1.5 * MARGIN - heading) / rows)


def _draw_symbols(
    canvas: Canvas, rows: Sequence[tuple[str, str]], top: float, width: float, step: float
) -> None:
    """Draw the meanings of the scene's symbols, below the keys."""
    canvas.text(MARGIN, top + 0.5 * HEADING + 2.0, "Symbols in the scene", size=14, bold=True)
    start = max(text_width(symbol) for symbol, _ in rows) + 20.0
    for number, (symbol, text) in enumerate(rows):
        middle = top + HEADING + (number + 0.5) * step
        canvas.text(MARGIN, middle, symbol, color=INK)
        canvas.text(MARGIN + start, middle, shortened(text, width - start), color=QUIET)


def _draw_keys(
    canvas: Canvas, rows: Sequence[tuple[str, str]], left: float, width: float, step: float
) -> None:
    """Draw one column of keys and their descriptions."""
    widest = max(text_width(name) for name, _ in rows) + 14.0
    for number, (name, text) in enumerate(rows):
        middle = MARGIN + HEAD - 8.0 + (number + 0.5) * step
        key_width = max(24.0, text_width(name) + 12.0)
        box = (left, middle - 9.5, left + key_width, middle + 9.5)
        canvas.box(box, "#EEF1F4", radius=4, border="#B9C2CC")
        canvas.text(left + 0.5 * key_width, middle, name, color=INK, anchor="m")
        start = max(widest, 24.0) + 10.0
        canvas.text(left + start, middle, shortened(text, width - start))
