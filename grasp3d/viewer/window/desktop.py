"""The desktop window: scene, panel, keys and mouse."""

import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

from vtkmodules.vtkInteractionStyle import vtkInteractorStyleTrackballCamera

from grasp3d.errors import GraspError
from grasp3d.system.isolation import describe_unexpected
from grasp3d.viewer.scene.picking import ClickDetector
from grasp3d.viewer.scene.scene import Scene, new_plotter
from grasp3d.viewer.session.history import History
from grasp3d.viewer.session.keys import handle_key
from grasp3d.viewer.session.panel_text import PanelText, panel_text
from grasp3d.viewer.session.session import Session
from grasp3d.viewer.window.display import check_display
from grasp3d.viewer.window.events import Events
from grasp3d.viewer.window.file_saving import save_labels, save_view
from grasp3d.viewer.window.help_overlay import HelpOverlay
from grasp3d.viewer.window.panel import panel_content
from grasp3d.viewer.window.panel_widget import PanelWidget, row_width
from grasp3d.viewer.window.rows import HitArea
from grasp3d.viewer.window.sliders import Ranges

LOOP_PAUSE = 0.01
"""Pause between two rounds of the event loop [s]."""
PANEL, NARROWEST, WIDEST = 0.297, 300.0, 420.0
"""Width of the panel relative to the window, and its limits [pixels]."""
MAX_PANEL = 0.45
"""Largest width of the panel relative to the window."""
HIGH_DPI = 144.0
"""Screens with more dots per inch use double pixels, if the window is large enough."""
MIN_SIZE = (1100, 700)
"""Smallest window for double pixels [double pixels]."""
ZOOM = 1.15
HAND, ARROW = 9, 1
"""Numbers of VTK's cursors."""

KEYSYMS = {
    "bracketleft": "[", "bracketright": "]", "comma": ",", "period": ".",
    "plus": "+", "equal": "+", "minus": "-",
    "KP_Add": "+", "KP_Subtract": "-", "KP_Left": "Left", "KP_Right": "Right", "KP_Up": "Up",
    "KP_Down": "Down", "Escape": "Escape",
}  # fmt: skip
"""VTK's names of keys, where they differ from those in `KEYS`."""

Watch = Callable[[PanelText, tuple[HitArea, ...]], None]
"""Takes the panel's text and the hit areas [pixels from the window's upper left corner]."""


def show_window(session: Session, *, title: str = "grasp3d", watch: Watch | None = None) -> None:
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
    """Connects a session, a scene and a panel with a plotter's window."""

    def __init__(self, session: Session, plotter: Any, watch: Watch | None = None) -> None:
        """Prepare a window without opening it.

        Args:
            session: The session.
            plotter: Made by `new_plotter`, with a panel.
            watch: Called after each rendering.
        """
        self._session, self._plotter, self._watch = session, plotter, watch
        self._interactor: Any = plotter.iren.interactor
        self._scene = Scene(plotter, legend=False)
        self._panel = PanelWidget(plotter.renderers[2])
        self._help = HelpOverlay(plotter.render_window)
        self._history, self._ranges = History(session), Ranges()
        self._text = panel_text(session)
        self._revision = -1
        self._drawn: tuple[object, ...] = ()
        self._size = (0, 0)
        self._scale, self._panel_width = 1.0, 0
        self._interrupted = False
        self._needs_render = True

    def run(self, title: str) -> None:
        """Open the window and wait until it is closed."""
        plotter = self._plotter
        plotter.iren.style = vtkInteractorStyleTrackballCamera()
        plotter.iren.clear_key_event_callbacks()
        self._observe()
        self._draw()
        plotter.show(title=title, interactive_update=True, auto_close=False)
        # VTK's own event loop would block Python's threads. Rendering is disabled while events are
        # processed and done once after all of them, so that slow machines keep up with the mouse.
        self._interactor.EnableRenderOff()
        while not self._interactor.GetDone():
            self._interactor.ProcessEvents()
            if not self._interactor.GetDone():
                self._update()
            time.sleep(LOOP_PAUSE)
        if self._interrupted:
            raise KeyboardInterrupt

    def _observe(self) -> None:
        events = Events(self._interactor, self._report)
        events.on("RenderEvent", self._on_render)
        events.on("KeyPressEvent", self._on_key)
        events.on("CharEvent", lambda: True)  # disables VTK's own keys
        for name in ("LeftButtonPressEvent", "LeftButtonDoubleClickEvent"):
            events.on(name, self._on_press)
        events.on("LeftButtonReleaseEvent", self._on_release)
        events.on("MouseMoveEvent", self._on_move)
        events.on("MouseWheelForwardEvent", lambda: self._on_wheel(1))
        events.on("MouseWheelBackwardEvent", lambda: self._on_wheel(-1))
        for name in ("RightButtonPressEvent", "MiddleButtonPressEvent"):
            events.on(name, lambda: self._panel_position() is not None)
        ClickDetector(self._plotter, self._on_click)

    def _on_render(self) -> bool:
        self._needs_render = True
        return False

    def _update(self) -> None:
        try:
            self._session.poll()
            if not self._panel.pressed:
                self._history.record()
            self._draw()
        except Exception as error:  # noqa: BLE001
            self._report(error)

    def _draw(self) -> None:
        """Draw what has changed."""
        session = self._session
        resized = self._lay_out()
        state = (session.revision, session.working, *self._panel.mouse_state)
        if state == self._drawn and not (resized or self._needs_render):
            return
        self._drawn = state
        changed = session.revision != self._revision
        if changed:
            self._revision = session.revision
            self._scene.update(session)
            self._text = panel_text(session)
        text = replace(self._text, working=session.working)
        width, height = self._panel_width / self._scale, self._size[1] / self._scale
        content = panel_content(
            session, text, self._ranges, row_width(width), press=self._handle_key,
            dragged=self._panel.dragged,
        )  # fmt: skip
        redrawn = self._panel.show(content, width, height, self._scale)
        if changed or resized or redrawn or self._needs_render:
            self._needs_render = False
            self._plotter.render()
            if self._watch is not None:
                self._watch(text, self._hit_areas())

    def _lay_out(self) -> bool:
        """Divide the window between scene and panel; returns whether its size has changed."""
        width, height = self._plotter.window_size
        if (width, height) == self._size:
            return False
        self._size = (width, height)
        high_dpi = self._plotter.render_window.DetectDPI() >= HIGH_DPI
        ratio = min(width / MIN_SIZE[0], height / MIN_SIZE[1])
        self._scale = 2.0 if high_dpi and ratio >= 2.0 else 1.0
        preferred = min(WIDEST, max(NARROWEST, PANEL * width / self._scale)) * self._scale
        self._panel_width = round(min(preferred, MAX_PANEL * width))
        border = 1.0 - self._panel_width / width
        self._scene.area = (0.0, 0.0, border, 1.0)
        self._plotter.renderers[2].viewport = (border, 0.0, 1.0, 1.0)
        self._revision = -1
        self._help.fit(width, height, self._scale)
        return True

    def _reset_view(self) -> None:
        self._scene.look(self._session)
        self._needs_render = True

    def _on_key(self) -> bool:
        interactor = self._interactor
        if not interactor.GetControlKey() and not interactor.GetAltKey():
            name = str(interactor.GetKeySym())
            self._handle_key(KEYSYMS.get(name, name.removeprefix("KP_")))
        return True

    def _handle_key(self, key: str) -> None:
        """Run the action of a key, or of a button for it."""
        if len(key) == 1:
            key = key.lower()
        session = self._session
        actions: dict[str, Callable[[], None]] = {
            "h": self._toggle_help, "Escape": self._close_help, "r": self._reset_view,
            "q": self._plotter.iren.terminate_app, "z": self._history.undo,
            "+": lambda: self._zoom(ZOOM), "-": lambda: self._zoom(1.0 / ZOOM),
            "s": lambda: save_labels(session), "g": self._save_view,
        }  # fmt: skip
        if key in actions:
            actions[key]()
        else:
            handle_key(session, key)

    def _zoom(self, factor: float) -> None:
        self._scene.camera.zoom(factor)
        self._needs_render = True

    def _save_view(self) -> None:
        self._session.check_current()
        width, height = self._size
        save_view(self._session, self._scene.camera, width - self._panel_width, height)

    def _toggle_help(self) -> None:
        self._help.show(not self._help.visible)
        self._needs_render = True

    def _close_help(self) -> None:
        if self._help.visible:
            self._toggle_help()

    def _on_press(self) -> bool:
        if self._help.visible:
            self._toggle_help()
            return True
        position = self._panel_position()
        if position is not None:
            self._panel.press(*position)
        return position is not None

    def _on_move(self) -> bool:
        position = self._panel_position()
        moved = self._panel.leave() if position is None else self._panel.move(*position)
        if moved:
            self._needs_render = True
            self._plotter.render_window.SetCurrentCursor(HAND if self._panel.hovering else ARROW)
        return position is not None

    def _on_release(self) -> bool:
        position = self._panel_position()
        if not self._panel.pressed or position is None:
            return False
        self._panel.release(*position)
        return True

    def _on_wheel(self, steps: int) -> bool:
        position = self._panel_position()
        if position is not None and self._panel.turn_wheel(*position, steps):
            self._needs_render = True
        return position is not None

    def _on_click(self, x: float, y: float, shift: bool) -> None:
        try:
            vertex = self._scene.pick(self._session, x, y)
            self._session.click(vertex, inspect=shift)
        except BaseException as error:  # noqa: BLE001
            self._report(error)

    def _panel_position(self) -> tuple[float, float] | None:
        """Position of the mouse in the panel, also while dragging; None: on the scene."""
        x, y = self._interactor.GetEventPosition()
        left = self._size[0] - self._panel_width
        if x < left and not self._panel.pressed:
            return None
        return (x - left) / self._scale, (self._size[1] - 1 - y) / self._scale

    def _hit_areas(self) -> tuple[HitArea, ...]:
        """Hit areas of the panel, in pixels of the window."""
        left, scale = self._size[0] - self._panel_width, self._scale

        def moved(area: HitArea) -> HitArea:
            x0, y0, x1, y1 = (scale * side for side in area.box)
            track = area.track and (left + scale * area.track[0], left + scale * area.track[1])
            return HitArea(area.name, (left + x0, y0, left + x1, y1), track)

        return tuple(moved(area) for area in self._panel.hit_areas)

    def _report(self, error: BaseException) -> None:
        """Show an error as a message; only an interruption closes the window."""
        if not isinstance(error, Exception):
            self._interrupted = True
            self._plotter.iren.terminate_app()
            return
        message = str(error) if isinstance(error, GraspError) else describe_unexpected(error)
        if message != self._session.message:
            self._session.show_message(message)
