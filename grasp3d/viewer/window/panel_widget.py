"""The panel of a window: draws its rows and handles the mouse."""

from dataclasses import replace
from typing import TYPE_CHECKING

import pyvista

from grasp3d.viewer.window.canvas import ACCENT, BACKGROUND, LINE, THUMB, Canvas, ImageActor
from grasp3d.viewer.window.panel import Content
from grasp3d.viewer.window.rows import HitArea, Row
from grasp3d.viewer.window.scrolling import Scroll
from grasp3d.viewer.window.sliders import Slider

if TYPE_CHECKING:
    from collections.abc import Callable

MARGIN = 18.0
"""Space beside the rows [pixels]."""
EDGE = 12.0
"""Space above and below the rows [pixels]."""
WHEEL_STEP = 0.01
"""Movement of a slider per step of the mouse wheel."""
SCROLL_STEP = 48.0
"""Movement of the rows per step of the mouse wheel, if they are scrolled [pixels]."""
SCROLL_BAR = "scroll"
"""Name of the scroll bar's hit area."""
BAR_WIDTH = 6.0
"""Width of the scroll bar [pixels]."""

Drawn = tuple[object, ...]


def row_width(width: float) -> float:
    """Width of the rows in a panel [pixels]."""
    return width - 2.0 * MARGIN


class PanelWidget:
    """Draws rows in a renderer, and runs their actions when they are clicked or dragged.

    Positions are in the panel's own pixels, downward from its upper left corner.
    """

    def __init__(self, renderer: pyvista.Renderer) -> None:
        """Take a renderer for the panel alone."""
        self._image = ImageActor(renderer)
        self._content = Content((), (), {}, {})
        self._hit_areas: tuple[HitArea, ...] = ()
        self._drawn: Drawn | None = None
        self._pressed: HitArea | None = None
        self._position = 0.0
        self._hovered: str | None = None
        self._scroll = Scroll()
        self._focused: int | None = None

    @property
    def dragged(self) -> tuple[str, float] | None:
        """Name and position of a dragged slider that acts only when it is released."""
        slider = self._slider
        return None if slider is None or slider.live else (slider.name, self._position)

    @property
    def pressed(self) -> bool:
        """Whether the mouse button was pressed on the panel and not released yet."""
        return self._pressed is not None

    @property
    def hovering(self) -> bool:
        """Whether the mouse is over a button or slider."""
        return self._hovered is not None

    @property
    def mouse_state(self) -> tuple[object, ...]:
        """What the mouse drags, what it is over, and how far the rows are scrolled."""
        return self.dragged, self._hovered, self._scroll.offset

    @property
    def hit_areas(self) -> tuple[HitArea, ...]:
        """The areas that react to the mouse."""
        return self._hit_areas

    def show(self, content: Content, width: float, height: float, scale: float) -> bool:
        """Lay out and draw the panel, if it has changed; returns whether it has.

        Args:
            content: Rows and actions.
            width: Width of the panel.
            height: Height of the panel.
            scale: Screen pixels per panel pixel.
        """
        self._content = content
        upper, lower = content.fitted(height)
        bottom = height - EDGE - sum(row.height for row in lower)
        self._scroll.fit(2.0 * EDGE + sum(row.height for row in upper), bottom, held=self.pressed)
        self._show_focus(content, upper)
        drawn = (width, height, scale, upper, lower, self._hovered, self._scroll.offset)
        if drawn == self._drawn:
            return False
        self._drawn = drawn
        canvas = Canvas(width, height, scale=scale)
        areas = [
            clipped
            for area in self._draw_rows(canvas, upper, EDGE - self._scroll.offset, width)
            if (clipped := _clipped(area, bottom)) is not None
        ]
        if self._scroll.needed:
            areas.append(self._draw_scroll_bar(canvas, width))
            canvas.box((0.0, bottom, width, height), BACKGROUND)
            canvas.box((0.0, bottom, width, bottom + 1.0), LINE)
        areas += self._draw_rows(canvas, lower, bottom, width)
        canvas.box((0.0, 0.0, 1.0, height), LINE)
        self._hit_areas = tuple(areas)
        self._image.show(canvas.pixels)
        return True

    def _draw_rows(
        self, canvas: Canvas, rows: tuple[Row, ...], top: float, width: float
    ) -> list[HitArea]:
        """Draw rows one below the other; returns their hit areas."""
        areas: list[HitArea] = []
        for row in rows:
            box = (MARGIN, top, width - MARGIN, top + row.height)
            row.draw(canvas, box, self._hovered)
            areas.extend(row.hit_areas(box))
            top += row.height
        return areas

    def _draw_scroll_bar(self, canvas: Canvas, width: float) -> HitArea:
        """Draw the scroll bar at the right edge; returns its hit area."""
        left, (start, end) = width - BAR_WIDTH - 3.0, self._scroll.thumb
        active = self._hovered == SCROLL_BAR
        color = ACCENT if active else THUMB
        canvas.box((left, start, left + BAR_WIDTH, end), color, radius=0.5 * BAR_WIDTH)
        return HitArea(SCROLL_BAR, (left - 1.0, 0.0, width, self._scroll.view))

    def _show_focus(self, content: Content, upper: tuple[Row, ...]) -> None:
        """Scroll to what a click has just shown."""
        focus = content.focus
        if focus is not None and focus.key != self._focused:
            tops = [EDGE + sum(row.height for row in upper[:at]) for at in (focus.start, focus.end)]
            self._scroll.reveal(tops[0], tops[1] + EDGE)
        self._focused = None if focus is None else focus.key

    def press(self, x: float, y: float) -> None:
        """Handle a press of the mouse button."""
        self._pressed = self._at(x, y)
        if self._scrolling:
            self._scroll.grab(y)
        self._drag(x)

    def move(self, x: float, y: float) -> bool:
        """Drag, or update what is hovered; returns whether to redraw."""
        if self._scrolling:
            return self._scroll.drag(y)
        if self._pressed is not None:
            self._drag(x)
            return self._pressed.track is not None
        return self._hover(self._at(x, y))

    def leave(self) -> bool:
        """Handle the mouse leaving the panel; returns whether to redraw."""
        return self._hover(None)

    def release(self, x: float, y: float) -> None:
        """Handle a release: a button acts if it was also pressed, a slider is set."""
        self._drag(x)  # the last movement may have had no event
        pressed, slider, position = self._pressed, self._slider, self._position
        self._pressed = None
        if pressed is None:
            return
        if slider is not None:
            if not slider.live:
                slider.set(position)
            return
        released = self._at(x, y)
        if released is not None and released.name == pressed.name:
            action: Callable[[], None] | None = self._content.actions.get(pressed.name)
            if action is not None:
                action()

    def turn_wheel(self, x: float, y: float, steps: int) -> bool:
        """Scroll the rows, or if all are visible move the slider under the mouse.

        Returns:
            Whether to redraw.
        """
        if self._scroll.needed:
            return self._scroll.move(-steps * SCROLL_STEP)
        area = self._at(x, y)
        slider = None if area is None else self._content.sliders.get(area.name)
        if slider is not None and slider.live:
            slider.set(min(1.0, max(0.0, slider.position + steps * WHEEL_STEP)))
        return False

    @property
    def _scrolling(self) -> bool:
        return self._pressed is not None and self._pressed.name == SCROLL_BAR

    @property
    def _slider(self) -> Slider | None:
        return None if self._pressed is None else self._content.sliders.get(self._pressed.name)

    def _drag(self, x: float) -> None:
        slider = self._slider
        if slider is None or self._pressed is None or self._pressed.track is None:
            return
        start, end = self._pressed.track
        self._position = min(1.0, max(0.0, (x - start) / (end - start)))
        if slider.live:
            slider.set(self._position)

    def _hover(self, area: HitArea | None) -> bool:
        before, self._hovered = self._hovered, None if area is None else area.name
        return before != self._hovered

    def _at(self, x: float, y: float) -> HitArea | None:
        for area in self._hit_areas:
            left, top, right, bottom = area.box
            if left <= x <= right and top <= y <= bottom:
                return area
        return None


def _clipped(area: HitArea, bottom: float) -> HitArea | None:
    """The part of a scrolled area that is visible above a height; None: there is none."""
    left, top, right, low = area.box
    box = (left, max(0.0, top), right, min(low, bottom))
    return replace(area, box=box) if box[1] < box[3] else None
