"""The panel as a part of a window: drawn there, and answering to the mouse."""

from typing import TYPE_CHECKING

import pyvista

from grasp3d.viewer.window.canvas import LINE, Canvas
from grasp3d.viewer.window.panel import Content
from grasp3d.viewer.window.rows import Row, Spot
from grasp3d.viewer.window.sheet import Sheet
from grasp3d.viewer.window.sliders import Slider

if TYPE_CHECKING:
    from collections.abc import Callable

MARGIN = 18.0
"""Beside the rows [pixels]."""
EDGE = 12.0
"""Above and below them."""
NOTCH = 0.01
"""How far a turn of the wheel moves a slider."""

Drawn = tuple[float, float, float, tuple[Row, ...], tuple[Row, ...], str | None]


def row_width(width: float) -> float:
    """Room of the rows in a panel [pixels]."""
    return width - 2.0 * MARGIN


class Board:
    """Draws rows in a renderer, and does what they are for when they are clicked or dragged.

    Places are in the panel's own pixels, downward from its upper left corner.
    """

    def __init__(self, renderer: pyvista.Renderer) -> None:
        """Take a renderer of its own."""
        self._sheet = Sheet(renderer)
        self._content = Content((), (), {}, {})
        self._spots: tuple[Spot, ...] = ()
        self._drawn: Drawn | None = None
        self._pressed: Spot | None = None
        self._share = 0.0
        self._over: str | None = None

    @property
    def dragged(self) -> tuple[str, float] | None:
        """A slider that acts only when it is released, and where its thumb is now."""
        slider = self._slider
        return None if slider is None or slider.live else (slider.name, self._share)

    @property
    def held(self) -> bool:
        """Whether the mouse holds something of it."""
        return self._pressed is not None

    @property
    def over(self) -> bool:
        """Whether the mouse is over something that answers."""
        return self._over is not None

    @property
    def touched(self) -> tuple[object, ...]:
        """What the mouse does with it: what it drags, and what it is over."""
        return self.dragged, self._over

    @property
    def spots(self) -> tuple[Spot, ...]:
        """What answers to the mouse now."""
        return self._spots

    def show(self, content: Content, width: float, height: float, scale: float) -> bool:
        """Lay out and draw; tells whether anything is another than before.

        Args:
            content: What is to be seen.
            width: Of the panel.
            height: Of the panel.
            scale: Pixels of the screen for one of its own.
        """
        self._content = content
        upper, lower = content.fitted(height - 2.0 * EDGE)
        drawn = (width, height, scale, upper, lower, self._over)
        if drawn == self._drawn:
            return False
        self._drawn = drawn
        canvas = Canvas(width, height, scale=scale)
        canvas.box((0.0, 0.0, 1.0, height), LINE)
        spots: list[Spot] = []
        bottom = height - EDGE - sum(row.height for row in lower)
        for rows, start in ((upper, EDGE), (lower, bottom)):
            top = start
            for row in rows:
                box = (MARGIN, top, width - MARGIN, top + row.height)
                row.draw(canvas, box, self._over)
                spots.extend(row.spots(box))
                top += row.height
        self._spots = tuple(spots)
        self._sheet.show(canvas.pixels)
        return True

    def press(self, x: float, y: float) -> None:
        """Take hold of what is there."""
        self._pressed = self._at(x, y)
        self._drag(x)

    def move(self, x: float, y: float) -> bool:
        """Drag what is held, or see what is under the mouse; tells whether to draw anew."""
        if self._pressed is not None:
            self._drag(x)
            return self._pressed.track is not None
        return self._see(self._at(x, y))

    def leave(self) -> bool:
        """The mouse is elsewhere; tells whether to draw anew."""
        return self._see(None)

    def release(self, x: float, y: float) -> None:
        """Let go: a button acts where it was pressed and released."""
        self._drag(x)  # the last moves may not have been told of
        pressed, slider, share = self._pressed, self._slider, self._share
        self._pressed = None
        if pressed is None:
            return
        if slider is not None:
            if not slider.live:
                slider.set(share)
            return
        at = self._at(x, y)
        if at is not None and at.name == pressed.name:
            action: Callable[[], None] | None = self._content.actions.get(pressed.name)
            if action is not None:
                action()

    def turn(self, x: float, y: float, notches: int) -> None:
        """Move the slider under the mouse by the wheel."""
        at = self._at(x, y)
        slider = None if at is None else self._content.sliders.get(at.name)
        if slider is not None and slider.live:
            slider.set(min(1.0, max(0.0, slider.share + notches * NOTCH)))

    @property
    def _slider(self) -> Slider | None:
        return None if self._pressed is None else self._content.sliders.get(self._pressed.name)

    def _drag(self, x: float) -> None:
        slider = self._slider
        if slider is None or self._pressed is None or self._pressed.track is None:
            return
        start, end = self._pressed.track
        self._share = min(1.0, max(0.0, (x - start) / (end - start)))
        if slider.live:
            slider.set(self._share)

    def _see(self, spot: Spot | None) -> bool:
        before, self._over = self._over, None if spot is None else spot.name
        return before != self._over

    def _at(self, x: float, y: float) -> Spot | None:
        for spot in self._spots:
            left, top, right, bottom = spot.box
            if left <= x <= right and top <= y <= bottom:
                return spot
        return None
