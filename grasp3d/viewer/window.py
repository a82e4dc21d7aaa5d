"""The desktop window: the scene, and a panel with two sliders and the reason; keys and mouse."""

import os
import sys
import textwrap
import time
from collections.abc import Callable, Iterable
from itertools import chain, count
from pathlib import Path
from typing import Any, cast

import pyvista
from PIL import Image
from vtkmodules.vtkInteractionStyle import vtkInteractorStyleTrackballCamera

from grasp3d.errors import GraspError, OutputError
from grasp3d.pictures.captions import PLAIN
from grasp3d.pictures.opengl import exits_cleanly, new_plotter
from grasp3d.system.files import atomic_write
from grasp3d.system.names import describe_unexpected
from grasp3d.viewer.controls import CONTROLS, KEYS, handle_key
from grasp3d.viewer.panel_text import panel_text
from grasp3d.viewer.scene import ClickDetector, Scene
from grasp3d.viewer.screenshots import file_name, render_copy
from grasp3d.viewer.session import Session

ALTERNATIVES = (
    "grasp3d view shows a page for a browser there, or writes a picture with --screenshot FILE"
)
ATTEMPTS = 2
"""Attempts to open a window, as an X server may refuse a connection while it restarts."""
HIDDEN_WINDOW = """
import vtkmodules.vtkRenderingOpenGL2
from vtkmodules.vtkRenderingCore import vtkRenderWindow
window = vtkRenderWindow()
window.ShowWindowOff()
window.SetSize(16, 16)
window.Render()
raise SystemExit(window.GetClassName() != "vtkXOpenGLRenderWindow")
"""
"""Program that opens a hidden window, and checks that VTK has chosen an X window for it."""

LOOP_PAUSE = 0.01
"""Pause between two rounds of the event loop [s]."""
ZOOM = 1.15
TEXT_SIZE, LETTER = 12, 0.56
"""Size of the panel's texts, and mean width of a letter relative to it."""
SCENE = 0.7
"""Width of the scene relative to the window; the rest is the panel."""
INK, TRACK, THUMB = "#20262D", "#C3C9CF", "#1F5FA8"
SLIDERS = {"friction": 0.98, "resolution": 0.9}
"""Controls that have a slider, and the heights of their names in the window."""
BELOW = 0.82
"""Height in the window of the text below the sliders."""
FIRST = 10.0
"""Priority of observers that are called before VTK's own."""
MOUSE = ("drag: rotate; with shift: pan", "wheel: zoom", "click: why the vertex is S, M or U")
"""Actions of the mouse in a window."""


def display_problem() -> str:
    """Return why no window can be opened, by opening one in a child process; empty if one can.

    On Linux VTK needs an X server, and may abort the process if the server does not respond.
    """
    if not sys.platform.startswith("linux"):
        return ""
    name = os.environ.get("DISPLAY")
    if not name:
        return "no display here: DISPLAY is not set"
    if not any(exits_cleanly(HIDDEN_WINDOW) for _ in range(ATTEMPTS)):
        return f"no window opens on display {name} (no answer, or no OpenGL)"
    return ""


def show_window(
    session: Session, *, title: str = "grasp3d", watch: Callable[[], None] = lambda: None
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
        if problem := display_problem():
            raise OutputError(f"{problem}; {ALTERNATIVES}")
        window = Window(session, watch)
        try:
            window.run(title)
        finally:
            window.plotter.close()
    finally:
        session.close()


class Window:
    """Connection of a session to a plotter's window: the scene, and a panel beside it."""

    def __init__(self, session: Session, watch: Callable[[], None]) -> None:
        """Prepare a window without opening it.

        Args:
            session: The session.
            watch: Called after each rendering.
        """
        self._session, self._watch = session, watch
        size = session.settings
        self.plotter = cast("Any", new_plotter(size.width, size.height, panel=True))
        self.plotter.renderers[1].viewport = (SCENE, 0.0, 1.0, 1.0)
        self.plotter.render_window.DetectDPI()
        self._scene = Scene(self.plotter, area=(0.0, 0.0, SCENE, 1.0))
        self._interactor = self.plotter.iren.interactor
        self._help, self._needs_render, self._interrupted = False, True, False
        self._drawn: tuple[object, ...] = ()
        self.plotter.subplot(0, 1)
        self._names = {name: self._text_at(height) for name, height in SLIDERS.items()}
        self._sliders = {name: self._slider(name, height) for name, height in SLIDERS.items()}
        self._text, self._status = self._text_at(BELOW), self._text_at(0.02, "bottom")
        self.plotter.subplot(0, 0)

    def _text_at(self, height: float, end: str = "top") -> Any:
        """Add a text to the panel, with its upper or lower end at a height."""
        text = self.plotter.add_text(
            " ", position=(0.05, height), font_size=TEXT_SIZE // 2, color=INK, viewport=True,
            font_file=PLAIN,
        )  # fmt: skip
        text.prop.justification_vertical = end
        text.prop.SetLineSpacing(1.2)
        return text

    def _slider(self, name: str, height: float) -> Any:
        """Add a slider to the panel, below its name."""
        control = CONTROLS[name]
        ends = {"pointa": (0.05, height - 0.04), "pointb": (0.95, height - 0.04)}
        look = self.plotter.add_slider_widget(
            lambda value: self._on_slide(name, value), (control.least, control.most or 1.0),
            value=control.read(self._session), interaction_event="always", color=TRACK,
            slider_width=0.022, tube_width=0.008, **ends,
        ).GetRepresentation()  # fmt: skip
        look.ShowSliderLabelOff()
        look.SetSliderLength(0.03)
        look.SetEndCapLength(0.0)
        for part in (look.GetSliderProperty(), look.GetSelectedProperty()):
            part.SetColor(pyvista.Color(THUMB).float_rgb)
        return look

    def run(self, title: str) -> None:
        """Open the window and wait until it is closed."""
        plotter = self.plotter
        plotter.iren.style = vtkInteractorStyleTrackballCamera()
        plotter.iren.clear_key_event_callbacks()
        self._observe("RenderEvent", self._on_render)
        self._observe("KeyPressEvent", self._on_key)
        self._observe("CharEvent", lambda: True)  # disables VTK's own keys
        ClickDetector(plotter, self._on_click)
        self._draw()
        plotter.show(title=title, interactive_update=True, auto_close=False)
        # VTK's own event loop would block Python's threads. Rendering is disabled while events are
        # processed, and done once after all of them, so that slow machines keep up with the mouse.
        self._interactor.EnableRenderOff()
        while not self._interactor.GetDone():
            self._interactor.ProcessEvents()
            if not self._interactor.GetDone():
                self._run(self._update)
            time.sleep(LOOP_PAUSE)
        if self._interrupted:
            raise KeyboardInterrupt

    def _observe(self, name: str, handler: Callable[[], bool]) -> None:
        """Call a handler for an event; if it returns True, later observers are not called."""

        def called(*_: object) -> None:
            if self._run(handler):
                self._interactor.GetCommand(tag).SetAbortFlag(1)

        tag = self._interactor.AddObserver(name, called, FIRST)

    def _run(self, action: Callable[[], object]) -> bool:
        """Run an action and show its error as a message, as VTK would print it or abort.

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
            self.plotter.iren.terminate_app()
        return False

    def _update(self) -> None:
        self._session.poll()
        self._draw()

    def _draw(self) -> None:
        """Draw what has changed."""
        session = self._session
        text, fraction = session.working or ("", 0.0)
        progress = f"{text} … {100.0 * fraction:.0f} %" if text else ""
        state = (session.revision, progress, self._help, *self.plotter.window_size)
        if state == self._drawn and not self._needs_render:
            return
        if state != self._drawn:
            self._scene.update(session)
            self._show_panel(progress)
        self._drawn, self._needs_render = state, False
        self.plotter.render()
        self._watch()

    def _show_panel(self, progress: str) -> None:
        """Show values, and the inspected vertex or the keys; message and progress below them."""
        session, text = self._session, panel_text(self._session)
        for name, look in self._sliders.items():
            control = CONTROLS[name]
            value = control.read(session)
            look.SetMaximumValue(max(control.most or 0.0, value))
            look.SetValue(value)
            self._names[name].input = f"{control.text}   {value:.4g}{control.unit}"
        seen = session.inspection
        reason, numbers = (seen.reason, seen.numbers) if seen else (text.hint, ())
        lines = [reason, " ", *map(": ".join, numbers), " ", *text.notes]
        if self._help:
            lines = [*MOUSE, *(f"{one.names}: {one.text}" for one in KEYS)]
        self._text.input = self._wrapped(lines)
        status = (session.message, progress, "h: keys")
        self._status.input = self._wrapped(filter(None, status))

    def _wrapped(self, lines: Iterable[str]) -> str:
        """Wrap lines to the width of the panel."""
        width = 0.9 * (1.0 - SCENE) * self.plotter.window_size[0]
        size = TEXT_SIZE * self.plotter.render_window.GetDPI() / 72.0
        return "\n".join(textwrap.fill(line, int(width / (LETTER * size))) for line in lines)

    def _on_slide(self, name: str, value: float) -> None:
        """Change a control; PyVista also calls this when the slider is created."""
        control = CONTROLS[name]
        chosen = max(control.least, round(round(value / control.step) * control.step, 10))
        if self._drawn:
            self._run(lambda: control.change(self._session, chosen))

    def _on_render(self) -> bool:
        self._needs_render = True
        return False

    def _on_click(self, x: float, y: float, shift: bool) -> None:
        session = self._session
        if x < SCENE * self.plotter.window_size[0]:
            self._run(lambda: session.click(self._scene.pick(x, y), inspect=shift))

    def _on_key(self) -> bool:
        code = self._interactor.GetKeyCode()
        if not (self._interactor.GetControlKey() or self._interactor.GetAltKey()):
            printed = code.isprintable() and code != " "
            name = code.lower().replace("=", "+") if printed else self._interactor.GetKeySym()
            self._handle_key(name)
        return True

    def _handle_key(self, key: str) -> None:
        camera = self._scene.camera
        actions: dict[str, Callable[[], object]] = {
            "h": self._toggle_help, "q": self.plotter.iren.terminate_app,
            "r": lambda: self._scene.look(self._session),
            "+": lambda: camera.zoom(ZOOM), "-": lambda: camera.zoom(1.0 / ZOOM),
            "s": lambda: self._session.save(self._unused_path("labeled", ".ply")),
            "g": self._save_picture,
        }  # fmt: skip
        actions.get(key, lambda: handle_key(self._session, key))()
        self._needs_render = True

    def _toggle_help(self) -> None:
        self._help = not self._help

    def _save_picture(self) -> None:
        """Write a picture of the scene into the working folder."""
        session, (width, height) = self._session, self.plotter.window_size
        session.check_current()
        path = self._unused_path("view", ".png")
        picture = render_copy(session, self._scene.camera, round(SCENE * width), height)
        with atomic_write(path) as part:
            Image.fromarray(picture).save(part, format="PNG")
        session.show_message(f"saved: {path}")

    def _unused_path(self, kind: str, suffix: str) -> Path:
        """Return a path in the working folder at which there is no file yet."""
        name = file_name(self._session, kind, suffix)
        others = (f"{Path(name).stem}_{number}{suffix}" for number in count(2))
        paths = (Path.cwd() / one for one in chain([name], others))
        return next(path for path in paths if not path.exists())
