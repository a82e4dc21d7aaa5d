"""The desktop window: scene, side panel, keys and mouse."""

import math
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pyvista
from PIL import Image
from vtkmodules.vtkInteractionStyle import vtkInteractorStyleTrackballCamera
from vtkmodules.vtkInteractionWidgets import vtkSliderRepresentation2D, vtkSliderWidget

from grasp3d.describe.explanations import UNSEARCHED
from grasp3d.errors import GraspError
from grasp3d.pictures.camera import pixel_ratio
from grasp3d.pictures.captions import (
    INK,
    PARAGRAPH_LINE,
    QUIET,
    Overlay,
    OverlayItem,
    Rectangle,
    TextArea,
    TextLine,
    shortened,
    text_size,
    text_width,
    wrapped,
)
from grasp3d.pictures.colors import HEX_PALETTE
from grasp3d.pictures.opengl import new_plotter
from grasp3d.stability.label import Label
from grasp3d.system.files import atomic_write
from grasp3d.system.names import describe_unexpected
from grasp3d.viewer.scene import ClickDetector, Scene
from grasp3d.viewer.screenshots import file_name, render_copy
from grasp3d.viewer.session.background import Job, Worker
from grasp3d.viewer.session.controls import CONTROLS, KEYS, handle_key
from grasp3d.viewer.session.inspection import Inspection
from grasp3d.viewer.session.panel_text import HINTS
from grasp3d.viewer.session.session import Session
from grasp3d.viewer.web.page import open_page
from grasp3d.viewer.window.display import check_display

LOOP_PAUSE = 0.01
"""Pause between two rounds of the event loop [s]."""
PANEL_TEXT, SMALLEST_TEXT = 0.8, 10
"""Text size of the panel relative to that of the scene, and the smallest one [points]."""
PANEL_WIDTH, MAX_PANEL = 24.0, 0.45
"""Width of the panel in text sizes, and the largest one relative to the window."""
ZOOM = 1.15
BEFORE_WIDGETS, BEHIND_WIDGETS = 10.0, 0.25
"""Priorities of observers: VTK calls those of widgets with 0.5, and those that turn the scene with
0."""
BUTTONS = (
    "LeftButtonPressEvent", "LeftButtonDoubleClickEvent", "MiddleButtonPressEvent",
    "RightButtonPressEvent", "MouseWheelForwardEvent", "MouseWheelBackwardEvent",
)  # fmt: skip
KEYSYMS = {
    "bracketleft": "[", "bracketright": "]", "plus": "+", "equal": "+",
    "minus": "-", "KP_Add": "+", "KP_Subtract": "-",
}  # fmt: skip
"""VTK's names of keys, where they differ from those of `session.controls`."""


def show_window(
    session: Session, *, title: str = "grasp3d", watch: Callable[[], None] | None = None
) -> None:
    """Open a window, wait until it is closed, and close the session.

    Args:
        session: The session.
        title: Title of the window.
        watch: Called after each rendering.

    Raises:
        OutputError: No window can be opened here.
        KeyboardInterrupt: Ctrl+C was pressed in the terminal.
    """
    try:
        check_display()
        plotter = new_plotter(session.settings, off_screen=False, panel=True)
        try:
            Window(session, plotter, watch).run(title)
        finally:
            plotter.close()
    finally:
        session.close()


class Window:
    """Connects a session, a scene and a side panel with a plotter's window."""

    def __init__(
        self, session: Session, plotter: Any, watch: Callable[[], None] | None = None
    ) -> None:
        """Prepare a window without opening it.

        Args:
            session: The session.
            plotter: Made by `new_plotter`, with a panel.
            watch: Called after each rendering.
        """
        self._session, self._plotter, self._watch = session, plotter, watch
        self._interactor: Any = plotter.iren.interactor
        self._scene = Scene(plotter)
        self._panel = SidePanel(plotter.renderers[1], self._interactor, self._change)
        self._page = Worker[str]()
        self._help = False
        self._size, self._text_size = (0, 0), SMALLEST_TEXT
        self._drawn: tuple[object, ...] = ()
        self._needs_render = True
        self._interrupted = False

    def run(self, title: str) -> None:
        """Open the window and wait until it is closed."""
        plotter = self._plotter
        plotter.iren.style = vtkInteractorStyleTrackballCamera()
        plotter.iren.clear_key_event_callbacks()
        self._observe("RenderEvent", self._on_render)
        self._observe("KeyPressEvent", self._on_key)
        self._observe("CharEvent", lambda: True)  # disables VTK's own keys
        for name in BUTTONS:
            self._observe(name, self._is_on_panel, BEHIND_WIDGETS)
        ClickDetector(plotter, self._on_click)
        self._draw()
        plotter.show(title=title, interactive_update=True, auto_close=False)
        # VTK's own event loop would block Python's threads. Rendering is disabled while events are
        # processed and done once after all of them, so that slow machines keep up with the mouse.
        self._interactor.EnableRenderOff()
        while not self._interactor.GetDone():
            self._interactor.ProcessEvents()
            if not self._interactor.GetDone():
                self._run(self._update)
            time.sleep(LOOP_PAUSE)
        if self._interrupted:
            raise KeyboardInterrupt

    def _observe(
        self, name: str, handler: Callable[[], bool], priority: float = BEFORE_WIDGETS
    ) -> None:
        """Call a handler for an event; if it returns True, no observer behind it is called."""

        def called(*_: object) -> None:
            if self._run(handler):
                self._interactor.GetCommand(tag).SetAbortFlag(1)

        tag = self._interactor.AddObserver(name, called, priority)

    def _run(self, action: Callable[[], bool | None]) -> bool:
        """Run an action and show its error as a message; VTK would print it or abort.

        Only an interruption closes the window.
        """
        try:
            return bool(action())
        except Exception as error:  # noqa: BLE001
            message = str(error) if isinstance(error, GraspError) else describe_unexpected(error)
            if message != self._session.message:
                self._session.show_message(message)
        except BaseException:  # noqa: BLE001
            self._interrupted = True
            self._plotter.iren.terminate_app()
        return False

    def _update(self) -> None:
        self._session.poll()
        opened = self._page.take_finished()
        if opened is not None:
            self._session.show_message(opened.error or f"opened in a browser: {opened.result}")
        self._draw()

    def _draw(self) -> None:
        """Draw what has changed."""
        session = self._session
        resized = self._lay_out()
        working = session.working
        progress = working and (working[0], round(100.0 * working[1]))
        state = (session.revision, progress, self._help)
        if state == self._drawn and not (resized or self._needs_render):
            return
        if state != self._drawn or resized:
            self._scene.update(session)
            text = self._scene.captions.text
            self._panel.show(session, text.notes if text else (), self._text_size, keys=self._help)
        self._drawn, self._needs_render = state, False
        self._plotter.render()
        if self._watch is not None:
            self._watch()

    def _lay_out(self) -> bool:
        """Divide the window between scene and panel; returns whether its size has changed."""
        width, height = self._plotter.window_size
        if (width, height) == self._size:
            return False
        self._size = (width, height)
        self._plotter.render_window.DetectDPI()
        unit = pixel_ratio(self._plotter.renderers[1])
        largest = PANEL_TEXT * text_size(width, height, unit)
        self._text_size = round(max(SMALLEST_TEXT * unit, largest))
        border = 1.0 - min(PANEL_WIDTH * self._text_size / width, MAX_PANEL)
        self._scene.area = (0.0, 0.0, border, 1.0)
        self._plotter.renderers[1].viewport = (border, 0.0, 1.0, 1.0)
        return True

    def _on_render(self) -> bool:
        self._needs_render = True
        return False

    def _is_on_panel(self) -> bool:
        """Whether the mouse is on the panel, where it must not turn the scene."""
        return bool(self._interactor.GetEventPosition()[0] >= self._scene.area[2] * self._size[0])

    def _on_click(self, x: float, y: float, shift: bool) -> None:
        session = self._session
        self._run(lambda: session.click(self._scene.pick(session, x, y), inspect=shift))

    def _change(self, name: str, value: float) -> None:
        """Change a control that has a slider."""
        self._run(lambda: CONTROLS[name].change(self._session, value))

    def _on_key(self) -> bool:
        interactor = self._interactor
        if not interactor.GetControlKey() and not interactor.GetAltKey():
            name = str(interactor.GetKeySym())
            key = KEYSYMS.get(name, name.removeprefix("KP_"))
            self._handle_key(key.lower() if len(key) == 1 else key)
        return True

    def _handle_key(self, key: str) -> None:
        actions: dict[str, Callable[[], None]] = {
            "h": self._toggle_help, "q": self._plotter.iren.terminate_app, "w": self._open_page,
            "r": lambda: self._scene.look(self._session),
            "+": lambda: self._scene.camera.zoom(ZOOM),
            "-": lambda: self._scene.camera.zoom(1.0 / ZOOM),
            "s": lambda: self._session.save(self._unused_path("labeled", ".ply")),
            "g": self._save_picture,
        }  # fmt: skip
        if key in actions:
            actions[key]()
            self._needs_render = True
        else:
            handle_key(self._session, key)

    def _toggle_help(self) -> None:
        self._help = not self._help

    def _open_page(self) -> None:
        """Open the same object, with the current choices, as a page in a browser."""
        session = self._session
        session.show_message("opening the page …")
        self._page.request(Job(session.state, "opening the page", lambda: open_page(session)))

    def _save_picture(self) -> None:
        """Write a picture of the scene into the working folder."""
        session, width = self._session, round(self._scene.area[2] * self._size[0])
        session.check_current()
        path = self._unused_path("view", ".png")
        picture = render_copy(session, self._scene.camera, width, self._size[1])
        with atomic_write(path) as part:
            Image.fromarray(picture).save(part, format="PNG")
        session.show_message(f"saved: {path}")

    def _unused_path(self, kind: str, suffix: str) -> Path:
        """A path in the working folder at which there is no file."""
        name = Path(file_name(self._session, kind, suffix))
        path, number = Path.cwd() / name, 1
        while path.exists():
            number += 1
            path = path.with_name(f"{name.stem}_{number}{suffix}")
        return path


BACKGROUND, WARNING = "#F6F7F9", "#9A4A00"
TRACK, THUMB, PRESSED = "#C3C9CF", "#1F5FA8", "#123A68"
WIDENED = 1.03
"""Width of a text that VTK draws, relative to that of the font, at most."""
TRACK_HEIGHT, THUMB_HEIGHT, THUMB_WIDTH = 0.5, 1.4, 0.9
"""Sizes of a slider, relative to the text size."""

MOUSE = (
    ("drag", "rotate; with shift: pan"),
    ("wheel", "zoom"),
    ("click", "why the vertex is S, M or U"),
)
"""What the mouse does in a window."""

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
        widget.AddObserver("InteractionEvent", self._moved)
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
    of_keys = ((keys.names, keys.text) for keys in KEYS)
    for key, text in (*MOUSE, *of_keys, ("w", "open the page, with all settings, in a browser")):
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


def _heading(inspection: Inspection) -> str:
    letter = "not searched" if inspection.code == UNSEARCHED else Label(inspection.code).name
    where = "given grasp" if inspection.vertex is None else f"vertex {inspection.vertex}"
    if inspection.held is not None and inspection.held.has_joints:
        where = "pose of the hand"
    return f"{letter}: {where}"


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
