"""The window on the desktop: a scene, a panel beside it, keys and mouse."""

import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

from vtkmodules.vtkInteractionStyle import vtkInteractorStyleTrackballCamera

from grasp3d.errors import GraspError
from grasp3d.isolation import unexpected
from grasp3d.viewer.scene.clicks import Clicks
from grasp3d.viewer.scene.scene import Scene, new_plotter
from grasp3d.viewer.session.history import History
from grasp3d.viewer.session.keys import press
from grasp3d.viewer.session.session import Session
from grasp3d.viewer.session.telling import Told, tell
from grasp3d.viewer.window.board import Board, row_width
from grasp3d.viewer.window.display import check_display
from grasp3d.viewer.window.events import Events
from grasp3d.viewer.window.helping import Help
from grasp3d.viewer.window.keeping import save_labels, save_view
from grasp3d.viewer.window.panel import content_of
from grasp3d.viewer.window.rows import Spot
from grasp3d.viewer.window.sliders import Ranges

REST = 0.01
"""Between two looks at what there is to do [s]."""
PANEL, NARROWEST, WIDEST = 0.297, 300.0, 420.0
"""Width of the panel as a share of the window's, and its limits [pixels]."""
MOST = 0.45
"""Share of the window that the panel has at most."""
FINE = 144.0
"""Screens with more dots per inch have letters of twice the pixels, if there is room."""
ROOM = (1100, 700)
"""Least room for letters [their pixels]."""
ZOOM = 1.15
HAND, ARROW = 9, 1
"""VTK's numbers of cursors."""

KEYSYMS = {
    "bracketleft": "[", "bracketright": "]", "plus": "+", "equal": "+", "minus": "-",
    "KP_Add": "+", "KP_Subtract": "-", "KP_Left": "Left", "KP_Right": "Right", "KP_Up": "Up",
    "KP_Down": "Down", "Escape": "Escape",
}  # fmt: skip
"""What VTK calls keys, where it is not what `KEYS` does."""

Watch = Callable[[Told, tuple[Spot, ...]], None]
"""Takes what is told, and what of the window answers to the mouse [pixels from the upper left]."""


def show_window(session: Session, *, title: str = "grasp3d", watch: Watch | None = None) -> None:
    """Open a window and wait until it is closed, by its button or the key q; then close all.

    Args:
        session: Who is looking.
        title: Of the window.
        watch: Is called after each drawing, for who wants to know what is seen.

    Raises:
        OutputError: No window can be opened here.
        KeyboardInterrupt: The terminal asked to end.
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
    """Brings a session, a scene and a panel together in a plotter's window."""

    def __init__(self, session: Session, plotter: Any, watch: Watch | None = None) -> None:  # noqa: ANN401
        """Lay out a window that is not open yet.

        Args:
            session: Who is looking.
            plotter: Of `new_plotter`, with a panel.
            watch: Is called after each drawing.
        """
        self._session, self._plotter, self._watch = session, plotter, watch
        self._mouse: Any = plotter.iren.interactor
        self._scene = Scene(plotter, legend=False)
        self._board = Board(plotter.renderers[2])
        self._help = Help(plotter.render_window)
        self._history, self._ranges = History(session), Ranges()
        self._told = tell(session)
        self._seen = -1
        self._now: tuple[object, ...] = ()
        self._size = (0, 0)
        self._scale, self._panel = 1.0, 0
        self._interrupted = False
        self._stale = True

    def run(self, title: str) -> None:
        """Open it and wait for its end."""
        plotter = self._plotter
        plotter.iren.style = vtkInteractorStyleTrackballCamera()
        plotter.iren.clear_key_event_callbacks()
        self._listen()
        self._draw()
        plotter.show(title=title, interactive_update=True, auto_close=False)
        # VTK's own loop would keep Python from working in the background. What events ask to be
        # drawn is drawn after all of them, so that no slow machine falls behind the mouse.
        self._mouse.EnableRenderOff()
        while not self._mouse.GetDone():
            self._mouse.ProcessEvents()
            if not self._mouse.GetDone():
                self._tick()
            time.sleep(REST)
        if self._interrupted:
            raise KeyboardInterrupt

    def _listen(self) -> None:
        events = Events(self._mouse, self._fail)
        events.on("RenderEvent", self._expose)
        events.on("KeyPressEvent", self._key)
        events.on("CharEvent", lambda: True)  # VTK's own keys
        for name in ("LeftButtonPressEvent", "LeftButtonDoubleClickEvent"):
            events.on(name, self._press)
        events.on("LeftButtonReleaseEvent", self._release)
        events.on("MouseMoveEvent", self._move)
        events.on("MouseWheelForwardEvent", lambda: self._turn(1))
        events.on("MouseWheelBackwardEvent", lambda: self._turn(-1))
        for name in ("RightButtonPressEvent", "MiddleButtonPressEvent"):
            events.on(name, lambda: self._place() is not None)
        Clicks(self._plotter, self._click)

    def _expose(self) -> bool:
        self._stale = True
        return False

    def _tick(self) -> None:
        try:
            self._session.poll()
            if not self._board.held:
                self._history.note()
            self._draw()
        except Exception as error:  # noqa: BLE001
            self._fail(error)

    def _draw(self) -> None:
        """Draw what is another than before."""
        session = self._session
        resized = self._lay_out()
        now = (session.revision, session.working, *self._board.touched)
        if now == self._now and not (resized or self._stale):
            return
        self._now = now
        changed = session.revision != self._seen
        if changed:
            self._seen = session.revision
            self._scene.update(session)
            self._told = tell(session)
        told = replace(self._told, working=session.working)
        width, height = self._panel / self._scale, self._size[1] / self._scale
        content = content_of(
            session, told, self._ranges, row_width(width), press=self._do,
            dragged=self._board.dragged,
        )  # fmt: skip
        redrawn = self._board.show(content, width, height, self._scale)
        if changed or resized or redrawn or self._stale:
            self._stale = False
            self._plotter.render()
            if self._watch is not None:
                self._watch(told, self._spots())

    def _lay_out(self) -> bool:
        """Share out the window; tells whether its size is another than before."""
        width, height = self._plotter.window_size
        if (width, height) == self._size:
            return False
        self._size = (width, height)
        fine = self._plotter.render_window.DetectDPI() >= FINE
        room = min(width / ROOM[0], height / ROOM[1])
        self._scale = 2.0 if fine and room >= 2.0 else 1.0
        wanted = min(WIDEST, max(NARROWEST, PANEL * width / self._scale)) * self._scale
        self._panel = round(min(wanted, MOST * width))
        border = 1.0 - self._panel / width
        self._scene.area = (0.0, 0.0, border, 1.0)
        self._plotter.renderers[2].viewport = (border, 0.0, 1.0, 1.0)
        self._seen = -1
        self._help.fit(width, height, self._scale)
        return True

    def _look(self) -> None:
        self._scene.look(self._session)
        self._stale = True

    def _key(self) -> bool:
        mouse = self._mouse
        if not mouse.GetControlKey() and not mouse.GetAltKey():
            name = str(mouse.GetKeySym())
            self._do(KEYSYMS.get(name, name.removeprefix("KP_")))
        return True

    def _do(self, key: str) -> None:
        """Answer a key, or a button that does the same."""
        if len(key) == 1:
            key = key.lower()
        session = self._session
        own: dict[str, Callable[[], None]] = {
            "h": self._toggle_help, "Escape": self._close_help, "r": self._look,
            "q": self._plotter.iren.terminate_app, "z": self._history.undo,
            "+": lambda: self._zoom(ZOOM), "-": lambda: self._zoom(1.0 / ZOOM),
            "s": lambda: save_labels(session), "g": self._save_view,
        }  # fmt: skip
        if key in own:
            own[key]()
        else:
            press(session, key)

    def _zoom(self, factor: float) -> None:
        self._scene.camera.zoom(factor)
        self._stale = True

    def _save_view(self) -> None:
        self._session.check_shown()
        width, height = self._size
        save_view(self._session, self._scene.camera, width - self._panel, height)

    def _toggle_help(self) -> None:
        self._help.show(not self._help.shown)
        self._stale = True

    def _close_help(self) -> None:
        if self._help.shown:
            self._toggle_help()

    def _press(self) -> bool:
        if self._help.shown:
            self._toggle_help()
            return True
        place = self._place()
        if place is not None:
            self._board.press(*place)
        return place is not None

    def _move(self) -> bool:
        place = self._place()
        moved = self._board.leave() if place is None else self._board.move(*place)
        if moved:
            self._stale = True
            self._plotter.render_window.SetCurrentCursor(HAND if self._board.over else ARROW)
        return place is not None

    def _release(self) -> bool:
        place = self._place()
        if not self._board.held or place is None:
            return False
        self._board.release(*place)
        return True

    def _turn(self, notches: int) -> bool:
        place = self._place()
        if place is not None:
            self._board.turn(*place, notches)
        return place is not None

    def _click(self, x: float, y: float, shift: bool) -> None:
        try:
            vertex = self._scene.pick(self._session, x, y)
            self._session.tap(vertex, inspect=shift)
        except BaseException as error:  # noqa: BLE001
            self._fail(error)

    def _place(self) -> tuple[float, float] | None:
        """Where in the panel the mouse is, or drags from; None: on the scene."""
        x, y = self._mouse.GetEventPosition()
        left = self._size[0] - self._panel
        if x < left and not self._board.held:
            return None
        return (x - left) / self._scale, (self._size[1] - 1 - y) / self._scale

    def _spots(self) -> tuple[Spot, ...]:
        """What answers to the mouse, in pixels of the window."""
        left, scale = self._size[0] - self._panel, self._scale

        def moved(spot: Spot) -> Spot:
            x0, y0, x1, y1 = (scale * side for side in spot.box)
            track = spot.track and (left + scale * spot.track[0], left + scale * spot.track[1])
            return Spot(spot.name, (left + x0, y0, left + x1, y1), track)

        return tuple(moved(spot) for spot in self._board.spots)

    def _fail(self, error: BaseException) -> None:
        """Say what went wrong; the window stays open."""
        if not isinstance(error, Exception):
            self._interrupted = True
            self._plotter.iren.terminate_app()
            return
        words = str(error) if isinstance(error, GraspError) else unexpected(error)
        if words != self._session.message:
            self._session.tell(words)
