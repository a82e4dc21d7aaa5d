"""Detection of clicks on the scene, as opposed to drags."""

import math
from collections.abc import Callable
from typing import Any

import pyvista

MAX_MOVE = 4.0
"""Largest movement of the mouse between press and release of a click [pixels]."""


class ClickDetector:
    """Calls a function for clicks with the left button, but not for drags.

    After a press, VTK's interactor style grabs the mouse and other observers do not receive the
    release; therefore the end of the style's interaction is observed. The style is looked up once:
    another style needs another detector.
    """

    def __init__(
        self, plotter: pyvista.Plotter, on_click: Callable[[float, float, bool], None]
    ) -> None:
        """Register the observers.

        Args:
            plotter: Plotter whose interactor receives the mouse events.
            on_click: Called with the position [pixels from the lower left], and whether shift was
                held.
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
        if self._pressed and math.dist(self._pressed, self._mouse.GetEventPosition()) > MAX_MOVE:
            self._pressed = None

    def _release(self, *_: object) -> None:
        self._move()
        pressed, self._pressed = self._pressed, None
        if pressed is not None:
            x, y = self._mouse.GetEventPosition()
            self._on_click(float(x), float(y), self._shift)
