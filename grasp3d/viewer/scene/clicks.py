"""Clicks on the scene: a button pressed and released in one place, and no drag."""

import math
from collections.abc import Callable
from typing import Any

import pyvista

STILL = 4.0
"""How far the mouse may move while its button is down [pixels]."""


class Clicks:
    """Tells of clicks with the left button; where the mouse was dragged nothing is told.

    The style of the interaction takes hold of the mouse at the press, so that no one else hears of
    the release; hence the end of its own interaction is what is waited for. It is looked up once:
    another style needs another one of these.
    """

    def __init__(
        self, plotter: pyvista.Plotter, on_click: Callable[[float, float, bool], None]
    ) -> None:
        """Begin to listen.

        Args:
            plotter: Its window's mouse, or that which a page sends on.
            on_click: Takes the place [pixels from the lower left], and whether shift was held.
        """
        window: Any = plotter.iren
        self._mouse = window.interactor
        self._on_click = on_click
        self._pressed: tuple[int, int] | None = None
        self._shift = False
        self._mouse.AddObserver("LeftButtonPressEvent", self._press, 1.0)
        style = window.style
        style.AddObserver("InteractionEvent", self._move)
        style.AddObserver("EndInteractionEvent", self._release)

    def _press(self, *_: object) -> None:
        self._pressed = self._mouse.GetEventPosition()
        self._shift = bool(self._mouse.GetShiftKey())

    def _move(self, *_: object) -> None:
        if self._pressed and math.dist(self._pressed, self._mouse.GetEventPosition()) > STILL:
            self._pressed = None

    def _release(self, *_: object) -> None:
        self._move()
        pressed, self._pressed = self._pressed, None
        if pressed is not None:
            x, y = self._mouse.GetEventPosition()
            self._on_click(float(x), float(y), self._shift)
