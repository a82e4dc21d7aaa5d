"""The desktop window: scene, side panel, keys and mouse."""

import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pyvista
from PIL import Image
from vtkmodules.vtkInteractionStyle import vtkInteractorStyleTrackballCamera

from grasp3d.errors import GraspError
from grasp3d.system.files import atomic_write
from grasp3d.system.names import describe_unexpected
from grasp3d.viewer.scene.framing import pixel_ratio
from grasp3d.viewer.scene.overlays import (
    INK,
    PARAGRAPH_LINE,
    QUIET,
    Overlay,
    TextArea,
    TextLine,
    text_size,
    wrapped,
)
from grasp3d.viewer.scene.pictures import file_name, render_copy
from grasp3d.viewer.scene.scene import ClickDetector, Scene, new_plotter
from grasp3d.viewer.session.background import Job, Worker
from grasp3d.viewer.session.controls import KEYS, handle_key
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
FIRST = 10.0
"""Priority of observers: VTK calls those that turn the scene with 0."""
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
        self._panel = SidePanel(plotter.renderers[1])
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
            self._observe(name, self._is_on_panel)
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

    def _observe(self, name: str, handler: Callable[[], bool]) -> None:
        """Call a handler for an event; if it returns True, no observer behind it is called."""

        def called(*_: object) -> None:
            if self._run(handler):
                self._interactor.GetCommand(tag).SetAbortFlag(1)

        tag = self._interactor.AddObserver(name, called, FIRST)

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


BACKGROUND, WARNING, WORKING = "#F6F7F9", "#9A4A00", "#1F5FA8"
WIDENED = 1.03
"""Width of a text that VTK draws, relative to that of the font, at most."""
BETWEEN = 0.4
"""Space between paragraphs, in text sizes."""

MOUSE = (
    ("drag", "rotate; with shift: pan"),
    ("wheel", "zoom"),
    ("click", "why the vertex is S, M or U"),
)
"""What the mouse does in a window."""

Paragraph = tuple[str, str]
"""A text and its colour."""


class SidePanel:
    """Texts in a renderer of their own."""

    def __init__(self, renderer: pyvista.Renderer) -> None:
        """Take a renderer that draws nothing else."""
        renderer.background_color = pyvista.Color(BACKGROUND)
        renderer.InteractiveOff()
        self._renderer, self._overlay = renderer, Overlay(renderer)

    def show(self, session: Session, notes: tuple[str, ...], size: int, *, keys: bool) -> None:
        """Draw the panel.

        Args:
            session: What it is about.
            notes: Warnings, one sentence each.
            size: Text size [pixels].
            keys: Show the keys instead of the inspected vertex.
        """
        width, height = self._renderer.GetSize()
        area = TextArea(width, height, size)
        above = _keys() if keys else _vertex(session, notes)
        status = list(_lines(area, _status(session)))
        down = status[-1].y - 0.5 * area.margin
        top = area.height - down
        shown = [line for line in _lines(area, above) if line.y >= top]
        self._overlay.show([*shown, *(replace(line, y=line.y - down) for line in status)])


def _lines(area: TextArea, paragraphs: Iterable[Paragraph]) -> Iterator[TextLine]:
    """Paragraphs one below the other, from the top of the panel."""
    width, y = area.width - 2.0 * area.margin, area.height - 0.5 * area.margin
    for text, color in paragraphs:
        for line in wrapped(text, width / WIDENED, area.size):
            y -= PARAGRAPH_LINE * area.size
            yield TextLine(line, area.margin, y, area.size, color)
        y -= BETWEEN * area.size


def _keys() -> Iterator[Paragraph]:
    of_keys = ((keys.names, keys.text) for keys in KEYS)
    for key, text in (*MOUSE, *of_keys, ("w", "open the page, with all settings, in a browser")):
        yield f"{key}: {text}", INK


def _vertex(session: Session, notes: tuple[str, ...]) -> Iterator[Paragraph]:
    """The inspected vertex, or what a click would do; notes."""
    inspection = session.inspection
    if inspection is None:
        yield HINTS[session.state.click], QUIET
    else:
        yield inspection.reason, INK
        for name, value in inspection.numbers:
            yield f"{name}: {value}", INK
        if inspection.budget:
            yield inspection.budget, QUIET
    for note in notes:
        yield note, WARNING


def _status(session: Session) -> Iterator[Paragraph]:
    """Message, progress, and the keys that lead to all others."""
    if session.message:
        yield session.message, INK
    if session.working is not None:
        text, fraction = session.working
        yield f"{text} … {100.0 * fraction:.0f} %", WORKING
    yield "← → μ · ↑ ↓ α · h: all keys · w: page with all settings", QUIET
