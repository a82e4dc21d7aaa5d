"""The panel beside a window's scene: two sliders, and texts about the vertex that was clicked."""

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pyvista
from vtkmodules.vtkInteractionWidgets import vtkSliderRepresentation2D, vtkSliderWidget

from grasp3d.grasps.explanations import UNSEARCHED
from grasp3d.stability.label import Label
from grasp3d.viewer.scene.overlays import (
    INK,
    PARAGRAPH_LINE,
    QUIET,
    Overlay,
    OverlayItem,
    Rectangle,
    TextArea,
    TextLine,
    shortened,
    text_width,
    wrapped,
)
from grasp3d.viewer.session.controls import CONTROLS
from grasp3d.viewer.session.inspection import Inspection
from grasp3d.viewer.session.painting import HEX_PALETTE
from grasp3d.viewer.session.panel_text import HINTS, grasp_number
from grasp3d.viewer.session.session import Session

BACKGROUND, WARNING = "#F6F7F9", "#9A4A00"
TRACK, THUMB, PRESSED = "#C3C9CF", "#1F5FA8", "#123A68"
WIDENED = 1.03
"""Width of a text that VTK draws, relative to that of the font, at most."""
TRACK_HEIGHT, THUMB_HEIGHT, THUMB_WIDTH = 0.5, 1.4, 0.9
"""Sizes of a slider, relative to the text size."""

KEYS = (
    ("drag", "rotate; with shift: pan"),
    ("wheel", "zoom; also + and −"),
    ("r", "reset the view"),
    ("click", "why the vertex is S, M or U"),
    ("b v", "next, previous one of the best grasps"),
    (". ,", "next, previous grasp at the vertex, with a gripper"),
    ("← →", "friction μ"),
    ("↓ ↑", "sensor resolution α"),
    ("1 … 9", "colours: S M U, β*, α*, ε, ε_min, approach, grip force, payload, margin"),
    ("c", "compare with a second resolution"),
    ("x", "section across x, y, z, none; [ ] move it, i flips it"),
    ("f", "clicks fix fingers; u releases them"),
    ("j t", "show or hide gripper, table"),
    ("n p", "next, previous object"),
    ("z", "undo"),
    ("s g", "save the labelled PLY, a picture"),
    ("w", "open the page, with all settings, in a browser"),
    ("q", "quit"),
)
"""Keys and mouse of a window, and what they do."""

SLIDERS = ("friction", "resolution")
"""Names of the controls that have a slider."""


class ControlSlider:
    """A slider widget of VTK for one control, without texts."""

    def __init__(
        self, name: str, renderer: pyvista.Renderer, interactor: Any,
        change: Callable[[str, float], None],
    ) -> None:  # fmt: skip
        """Add the widget to a renderer.

        Args:
            name: Name of the control.
            renderer: Renderer that draws it.
            interactor: VTK's interactor of the window.
            change: Called with the control's name and its new value.
        """
        self._name, self._renderer, self._change = name, renderer, change
        field = CONTROLS[name].page
        assert field is not None
        self.field = field
        self._decimals = -round(math.log10(field.step))
        self.dragged = False
        """Whether the thumb is held with the mouse."""
        self._look = look = vtkSliderRepresentation2D()
        look.ShowSliderLabelOff()
        look.SetEndCapLength(0.0)
        for part, color in (
            (look.GetTubeProperty(), TRACK),
            (look.GetSliderProperty(), THUMB),
            (look.GetSelectedProperty(), PRESSED),
        ):
            part.SetColor(*pyvista.Color(color).float_rgb)
        widget: Any = vtkSliderWidget()
        self._widget = widget
        widget.SetInteractor(interactor)
        widget.SetRepresentation(look)
        widget.SetDefaultRenderer(renderer)
        widget.SetCurrentRenderer(renderer)
        widget.SetAnimationModeToJump()
        widget.AddObserver("StartInteractionEvent", lambda *_: self._hold(held=True))
        widget.AddObserver("InteractionEvent", self._moved)
        widget.AddObserver("EndInteractionEvent", lambda *_: self._hold(held=False))
        widget.EnabledOn()

    def value_text(self, session: Session) -> str:
        """Current value as text, with more digits than usual if it needs them."""
        value = CONTROLS[self._name].read(session)
        usual = f"{value:.{self._decimals}f}"
        exact = math.isclose(float(usual), value, abs_tol=1e-6)
        return f"{usual if exact else format(value, '.4g')}{self.field.unit}"

    def show(self, session: Session, ends: tuple[float, float], y: float, size: int) -> None:
        """Draw the slider.

        Args:
            session: The session with the current value.
            ends: Left and right end in the renderer [pixels].
            y: Middle of its height, from below [pixels].
            size: Text size, to which it is fitted [pixels].
        """
        look, value = self._look, CONTROLS[self._name].read(session)
        width, height = self._renderer.GetSize()
        points = (look.GetPoint1Coordinate(), look.GetPoint2Coordinate())
        for point, x in zip(points, ends, strict=True):
            point.SetCoordinateSystemToDisplay()
            point.SetValue(x, y)
        look.SetTubeWidth(TRACK_HEIGHT * size / height)
        look.SetEndCapWidth(TRACK_HEIGHT * size / height)
        look.SetSliderWidth(THUMB_HEIGHT * size / height)
        look.SetSliderLength(THUMB_WIDTH * size / width)
        look.SetMinimumValue(self.field.limits(session)[0])
        look.SetMaximumValue(max(self.field.most or 0.0, value))
        look.SetValue(value)

    def _hold(self, *, held: bool) -> None:
        self.dragged = held

    def _moved(self, *_: object) -> None:
        value = round(self._look.GetValue(), self._decimals)
        self._change(self._name, max(self._look.GetMinimumValue(), value))


class SidePanel:
    """Sliders and texts in a renderer of their own."""

    def __init__(
        self, renderer: pyvista.Renderer, interactor: Any, change: Callable[[str, float], None]
    ) -> None:
        """Take a renderer.

        Args:
            renderer: Renderer for the panel alone.
            interactor: VTK's interactor of the window.
            change: Called with the name of a control and its new value.
        """
        renderer.background_color = pyvista.Color(BACKGROUND)
        renderer.InteractiveOff()
        self._renderer, self._overlay = renderer, Overlay(renderer)
        self._sliders = [ControlSlider(one, renderer, interactor, change) for one in SLIDERS]

    @property
    def dragged(self) -> bool:
        """Whether a slider is held with the mouse."""
        return any(slider.dragged for slider in self._sliders)

    def show(self, session: Session, notes: tuple[str, ...], size: int, *, keys: bool) -> None:
        """Draw the panel.

        Args:
            session: What it is about.
            notes: Warnings, one sentence each.
            size: Text size [pixels].
            keys: Show the keys instead of the inspected vertex.
        """
        width, height = self._renderer.GetSize()
        lines = _Lines(TextArea(width, height, size))
        margin = lines.area.margin
        for slider in self._sliders:
            lines.pair(slider.field.text, slider.value_text(session), name_color=INK)
            lines.gap(THUMB_HEIGHT)
            middle = lines.y + 0.5 * THUMB_HEIGHT * size
            slider.show(session, (margin, width - margin), middle, size)
            lines.gap(0.4)
        lines.gap(0.6)
        if keys:
            _add_keys(lines)
        else:
            _add_vertex(lines, session)
            for note in notes:
                lines.gap(0.5)
                lines.paragraph(note, WARNING)
        status = _status(lines.area, session)
        self._overlay.show([*lines.above(status.height), *status.moved_down()])


class _Lines:
    """Texts one below the other, from the top of a panel."""

    def __init__(self, area: TextArea) -> None:
        self.area = area
        self.y = area.height - 0.5 * area.margin
        """Lower end of the last line [pixels]."""
        self._items: list[OverlayItem] = []

    @property
    def height(self) -> float:
        """Height of all lines [pixels]."""
        return self.area.height - self.y

    def gap(self, lines: float) -> None:
        """Leave a space, in text sizes."""
        self.y -= lines * self.area.size

    def paragraph(
        self, text: str, color: str = INK, *, bold: bool = False, indent: float = 0.0
    ) -> None:
        """Add a text, broken into lines; `indent` is in pixels."""
        width = self.area.width - 2.0 * self.area.margin - indent
        for line in wrapped(text, width / WIDENED, self.area.size):
            self.y -= PARAGRAPH_LINE * self.area.size
            x = self.area.margin + indent
            self._items.append(TextLine(line, x, self.y, self.area.size, color, bold=bold))

    def pair(self, name: str, value: str, *, name_color: str = QUIET) -> None:
        """Add a name at the left and its value at the right, below it if it is long."""
        area, space = self.area, self.area.width - 2.0 * self.area.margin
        self.paragraph(name, name_color)
        if WIDENED * text_width(f"{name} {value}", area.size) + area.size > space:
            self.y -= 1.42 * area.size
        value = shortened(value, space / WIDENED, area.size)
        x = area.width - area.margin - WIDENED * text_width(value, area.size)
        self._items.append(TextLine(value, x, self.y, area.size))

    def square(self, color: str) -> None:
        """Put a coloured square before the next line."""
        side = 0.9 * self.area.size
        self._items.append(
            Rectangle(self.area.margin, self.y - 1.3 * self.area.size, side, side, color)
        )

    def above(self, y: float) -> list[OverlayItem]:
        """The texts above a height."""
        return [item for item in self._items if item.y >= y]

    def moved_down(self) -> list[OverlayItem]:
        """The texts, moved to the lower end of the panel."""
        return [replace(one, y=one.y - self.y + 0.5 * self.area.margin) for one in self._items]


def _add_keys(lines: _Lines) -> None:
    indent = 4.6 * lines.area.size
    for key, text in KEYS:
        before = lines.y
        lines.paragraph(key)
        lines.y = before
        lines.paragraph(text, QUIET, indent=indent)


def _add_vertex(lines: _Lines, session: Session) -> None:
    """The inspected vertex, or what a click would do."""
    inspection = session.inspection
    if inspection is None:
        lines.paragraph(HINTS[session.state.click], QUIET)
        return
    lines.square(HEX_PALETTE[inspection.code])
    lines.paragraph(_heading(inspection), bold=True, indent=1.4 * lines.area.size)
    lines.gap(0.2)
    lines.paragraph(inspection.reason)
    lines.gap(0.5)
    for name, value in inspection.numbers:
        lines.pair(name, value)
    if inspection.budget:
        lines.gap(0.4)
        lines.paragraph(inspection.budget, QUIET)


def _heading(inspection: Inspection) -> str:
    letter = "not searched" if inspection.code == UNSEARCHED else Label(inspection.code).name
    where = "best contact found" if inspection.vertex is None else f"vertex {inspection.vertex}"
    number = grasp_number(inspection)
    return f"{letter}: {where}{f', grasp {number}' if number else ''}"


def _status(area: TextArea, session: Session) -> _Lines:
    """Message, progress, and the keys that lead to all others."""
    lines = _Lines(area)
    if session.message:
        lines.paragraph(session.message)
        lines.gap(0.4)
    if session.working is not None:
        text, fraction = session.working
        lines.paragraph(f"{text} … {100.0 * fraction:.0f} %", THUMB)
        lines.gap(0.4)
    lines.paragraph("h: keys · w: page with all settings", QUIET)
    return lines
