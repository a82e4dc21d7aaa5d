"""What belongs to one page: a session, its renderer and the page's state."""

import asyncio
import contextlib
import io
import logging
from collections.abc import AsyncIterator, Awaitable, Callable
from functools import cache, partial
from importlib.resources import files
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import trame_client.module  # type: ignore[import-untyped]
from aiohttp import WSCloseCode, WSMessage, web
from PIL import Image
from trame.app import get_server
from trame.app.core import AVAILABLE_SERVERS
from trame.ui.vuetify3 import VAppLayout
from trame.widgets import html, rca
from trame_rca.rca import VtkRemoteControlledArea

from grasp3d.errors import GraspError, SettingError
from grasp3d.pictures.opengl import new_plotter
from grasp3d.viewer.scene import ClickDetector, Scene
from grasp3d.viewer.screenshots import file_name, render_copy
from grasp3d.viewer.session.controls import CONTROLS, control_values, handle_key
from grasp3d.viewer.session.session import Session
from grasp3d.viewer.web.page_state import constant_state, page_state, progress_state

LOG = logging.getLogger("grasp3d.viewer.web")
"""What the server reports."""

VIEW = "view"
"""Name of the page's one picture."""

POLL_INTERVAL = 0.1
"""Time between two polls of the background job [s]."""
FRAMES = 30.0
"""Largest number of pictures per second."""
ZOOMS = {"+": 1.2, "-": 1.0 / 1.2}
QUALITY, STILL_QUALITY = 70, 95
"""JPEG quality of the pictures during and after interaction [percent]."""
Receive = Callable[[WSMessage], Awaitable[None]]
"""Handles a message."""
STATIC = files("grasp3d.viewer.web") / "static"


MAX_PIXELS = 4_000_000
"""Largest number of pixels rendered for a browser, which enlarges the picture if it needs more."""


class Client:
    """Everything that belongs to one page; used only in the thread of the event loop."""

    def __init__(self, token: str, session: Session) -> None:
        self.token = token
        self.session = session
        self._plotter = new_plotter(
            session.settings.width, session.settings.height, off_screen=True
        )
        self._plotter.enable_trackball_style()  # type: ignore[call-arg]
        self._scene = Scene(self._plotter, legend=False)
        self._clicks = ClickDetector(self._plotter, self._click)
        self._server = get_server(self.token, client_type="vue3")
        self._wake, self._polled = asyncio.Event(), asyncio.Event()
        self._saving, self._open = asyncio.Lock(), True
        self._drawn = -1
        self._sockets: list[web.WebSocketResponse] = []
        self._build()
        self._bound: list[Any] = []
        self._server.controller.on_server_bind.add(self._bound.append)
        self._running = self._server.start(
            exec_mode="task", backend="generic", show_connection_info=False, open_browser=False,
            disable_logging=True, timeout=0,
        )  # fmt: skip
        self._watching = asyncio.create_task(self._watch())

    @property
    def is_used(self) -> bool:
        """Whether a browser shows the page."""
        return bool(self._sockets)

    @contextlib.asynccontextmanager
    async def connected(self, socket: web.WebSocketResponse) -> AsyncIterator[Receive]:
        """Connect a browser's socket to trame; yields a function that handles its messages."""
        await self._server.ready
        link = await self._bound[0]["ws"].connect()

        async def send(binary: bool, data: Any) -> None:
            with contextlib.suppress(ConnectionError):  # the browser disconnected; handled below
                await (socket.send_bytes(data) if binary else socket.send_str(data))

        async def receive(message: WSMessage) -> None:
            await link.send(True, message)  # noqa: FBT003

        link.on_message(send)
        self._sockets.append(socket)
        try:
            yield receive
        finally:
            if socket in self._sockets:
                self._sockets.remove(socket)
            await link.close()

    async def picture_file(self) -> tuple[str, bytes]:
        """File name and contents of a PNG of the current view with a legend.

        Raises:
            SettingError: The displayed surface does not belong to the current choices yet.
        """
        self.session.check_current()
        name = file_name(self.session, "view", ".png")
        width, height = self._plotter.render_window.GetSize()  # type: ignore[union-attr]
        picture, data = render_copy(self.session, self._scene.camera, width, height), io.BytesIO()
        Image.fromarray(picture).save(data, "PNG")
        return name, data.getvalue()

    async def labels_file(self) -> tuple[str, bytes]:
        """File name and contents of the labelled PLY.

        Raises:
            GraspError: There are no labels to save yet.
        """
        name = file_name(self.session, "labeled", ".ply")
        async with self._saving:
            return name, await self._written(name)

    async def _written(self, name: str) -> bytes:
        with TemporaryDirectory() as folder:
            path, session = Path(folder) / name, self.session
            session.save(path)
            while session.working is not None and not session.message and self._open:
                self._polled.clear()
                await self._polled.wait()
            if not path.exists():
                raise SettingError(session.message or "nothing was saved")
            data = path.read_bytes()
        self.show_message(f"saved: {name}")
        return data

    def show_message(self, message: str) -> None:
        """Display a message on the page, unless it was closed."""
        if self._open:
            self.session.show_message(message)
            self._wake.set()

    async def close(self) -> None:
        """Release everything that belongs to the page."""
        self._open = False
        self._polled.set()  # for a request that waits for a file
        sockets, self._sockets = self._sockets, []
        await asyncio.gather(*map(_close, sockets))
        self.session.close()
        self._watching.cancel()
        self._running.cancel()  # trame would wait for ever if it has only just started
        await self._view.close()
        await self._server.stop()
        await asyncio.gather(self._watching, self._running, return_exceptions=True)
        AVAILABLE_SERVERS.pop(self.token, None)
        self._plotter.close()
        # trame's objects refer to this one and to each other until their cycles are collected;
        # what is large is released now.
        del self._plotter, self._scene, self._clicks, self._view, self.session

    def _build(self) -> None:
        """Make the page and connect its events."""
        state, controller = self._server.state, self._server.controller
        state.update({**constant_state(self.session), **page_state(self.session)})
        # A number that is being typed is kept when the page is drawn again.
        state.update({"help": False, "typed": {}})
        state.update(progress_state(self.session))
        with VAppLayout(self._server):
            html.Div(_template("help.html"))
            with html.Div(classes="page"):
                with html.Main(classes="stage", id="stage", aria_label=("`Surface of ${title}`",)):
                    view = rca.RemoteControlledArea(
                        name=VIEW, display="image", event_throttle_ms=20
                    )
                    html.Div(_template("stage.html"), classes="over")
                html.Aside(_template("panel.html"), classes="panel", id="panel")
        self._view = view.create_view_handler(
            RemoteView(self._plotter.render_window), encoder="jpeg", target_fps=FRAMES,
            interactive_quality=QUALITY, still_quality=STILL_QUALITY,
        )  # fmt: skip
        self._view.max_pixel_count = MAX_PIXELS
        state.change(*CONTROLS)(self._on_change)
        controller.on_error.add(partial(LOG.warning, "error in a page: %s"))
        controller.trigger("key")(self._on_key)
        controller.trigger("step")(lambda by: self._run(lambda: self.session.step(int(by))))
        controller.trigger("release")(lambda: self._run(lambda: self.session.change(fixed=())))
        controller.trigger("reset_view")(self._reset_view)

    def _on_change(self, **state: Any) -> None:
        """Apply the fields that differ from the session."""
        values = control_values(self.session)
        for name, control in CONTROLS.items():
            if state[name] != values[name]:
                self._run(partial(control.change, self.session, state[name]))

    def _run(self, action: Any) -> None:
        """Run an action of the user; after an error the fields are reset."""
        try:
            action()
        except SettingError as error:
            self.session.show_message(str(error))
        self._drawn = -1
        self._wake.set()

    def _on_key(self, key: str) -> None:
        if key in ZOOMS:
            self._scene.camera.zoom(ZOOMS[key])
            self._view.update()
        else:
            self._run(lambda: handle_key(self.session, str(key)))

    def _reset_view(self) -> None:
        self._scene.look(self.session)
        self._view.update()

    def _click(self, x: float, y: float, inspect: bool) -> None:
        vertex = self._scene.pick(self.session, x, y)
        self._run(lambda: self.session.click(vertex, inspect=inspect))

    async def _watch(self) -> None:
        """Poll the session and update the page, until the client is closed."""
        while True:
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(self._wake.wait(), POLL_INTERVAL)
            self._wake.clear()
            try:
                self._refresh()
            except GraspError as error:
                self.session.show_message(str(error))
            self._polled.set()

    def _refresh(self) -> None:
        self.session.poll()
        if self.session.revision != self._drawn:
            self._drawn = self.session.revision
            self._scene.update(self.session)
            self._view.update()
            with self._server.state as state:
                state.update(page_state(self.session))
        with self._server.state as state:
            state.update(progress_state(self.session))


@cache
def static_folders() -> dict[str, Path]:
    """Folders of every page's static files, by the beginning of their path."""
    server = get_server("static", client_type="vue3")
    with VAppLayout(server):
        rca.RemoteControlledArea(name=VIEW)
    server.enable_module(trame_client.module)
    AVAILABLE_SERVERS.pop("static")
    served = {name: Path(folder) for name, folder in server.serve.items()}
    return {"own": Path(str(STATIC)), **served, "": Path(server._www)}  # noqa: SLF001


async def _close(socket: web.WebSocketResponse) -> None:
    with contextlib.suppress(ConnectionError):
        await socket.close(code=WSCloseCode.GOING_AWAY)


def _template(name: str) -> str:
    return (STATIC / name).read_text(encoding="utf-8")


class RemoteView(VtkRemoteControlledArea):  # type: ignore[misc]
    """A render window without VTK's key bindings; the page handles keys."""

    def process_interaction_event(self, event: dict[str, Any]) -> None:
        """Forward events of the mouse and of fingers, but no key events."""
        if not event["type"].startswith("Key"):
            super().process_interaction_event(event)
