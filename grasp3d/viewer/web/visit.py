"""One visitor: a session, a picture and a page of their own."""

import asyncio
import contextlib
import secrets
import time
from collections.abc import AsyncIterator
from importlib.resources import files
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from aiohttp import web
from trame.app import get_server
from trame.app.core import AVAILABLE_SERVERS
from trame.ui.vuetify3 import VAppLayout
from trame.widgets import html, rca

from grasp3d.arrays import Bytes
from grasp3d.errors import GraspError, SettingError
from grasp3d.viewer.scene.clicks import Clicks
from grasp3d.viewer.scene.pictures import copied, saved_as
from grasp3d.viewer.scene.scene import Scene, new_plotter
from grasp3d.viewer.session.album import Album
from grasp3d.viewer.session.history import History
from grasp3d.viewer.session.keys import press
from grasp3d.viewer.session.session import Session
from grasp3d.viewer.view_settings import ViewSettings
from grasp3d.viewer.web.area import MOST_PIXELS, Area
from grasp3d.viewer.web.fields import CHOICES, choices, choose
from grasp3d.viewer.web.mirror import fixed_part, mirrored, progress

BEAT = 0.1
"""How often the background is asked for news [s]."""
FRAMES = 30.0
"""Most pictures per second."""
ZOOMS = {"+": 1.2, "-": 1.0 / 1.2}
QUALITY, STILL_QUALITY = 70, 95
"""Of the pictures while something moves, and of those that stay [percent of JPEG]."""
STATIC = files("grasp3d.viewer.web") / "static"


class Visit:
    """What belongs to one visitor; all of it lives in the thread of the event loop."""

    def __init__(self, album: Album, settings: ViewSettings) -> None:
        self.token = secrets.token_hex(16)
        self.session = Session(album, settings)
        self._plotter = new_plotter(settings, off_screen=True)
        self._plotter.enable_trackball_style()  # type: ignore[call-arg]
        self._history = History(self.session)
        self._scene = Scene(self._plotter, legend=False)
        self._clicks = Clicks(self._plotter, self._click)
        self._server = get_server(self.token, client_type="vue3")
        self._stir, self._beat = asyncio.Event(), asyncio.Event()
        self._saving, self._open = asyncio.Lock(), True
        self.browser = ""
        """Whose it is."""
        self.entered = False
        """Whether a browser has been given the page."""
        self._drawn = -1
        self._connections = 0
        self._alone_since = time.monotonic()
        self._area = Area(self._plotter)
        self._build()
        self._bound: list[Any] = []
        self._server.controller.on_server_bind.add(self._bound.append)
        self._running = self._server.start(
            exec_mode="task", backend="generic", show_connection_info=False, open_browser=False,
            disable_logging=True, timeout=0,
        )  # fmt: skip
        self._watching = asyncio.create_task(self._watch())

    @property
    def alone_for(self) -> float:
        """For how long nobody has looked [s]; 0 while somebody does."""
        return 0.0 if self._connections else time.monotonic() - self._alone_since

    @property
    def folders(self) -> dict[str, Path]:
        """Where the files of the page lie, by the beginning of their address."""
        served = {name: Path(folder) for name, folder in self._server.serve.items()}
        return {**served, "": Path(self._server._www)}  # noqa: SLF001

    @contextlib.asynccontextmanager
    async def connected(self, socket: web.WebSocketResponse) -> AsyncIterator[Any]:
        """Let a browser's connection talk with this visit."""
        await self._server.ready
        link = await self._bound[0]["ws"].connect()

        async def send(binary: bool, data: Any) -> None:  # noqa: ANN401
            with contextlib.suppress(ConnectionError):  # it went away; the next lines notice
                await (socket.send_bytes(data) if binary else socket.send_str(data))

        link.on_message(send)
        self._connections += 1
        try:
            yield link
        finally:
            self._connections -= 1
            self._alone_since = time.monotonic()
            await link.close()

    def shot(self) -> tuple[str, Bytes]:
        """What the picture that is seen is called, and it, with a legend, shape (height, width, 3).

        Raises:
            SettingError: It does not belong to what is chosen yet.
        """
        self.session.check_shown()
        name = saved_as(self.session, "view", ".png")
        width, height = self._plotter.render_window.GetSize()  # type: ignore[union-attr]
        return name, copied(self.session, self._scene.camera, width, height)

    async def saved(self) -> tuple[str, bytes]:
        """The labelled PLY that is shown, and a name for it.

        Raises:
            GraspError: There is nothing to save yet.
        """
        name = saved_as(self.session, "labeled", ".ply")
        async with self._saving:
            return name, await self._written(name)

    async def _written(self, name: str) -> bytes:
        with TemporaryDirectory() as folder:
            path = Path(folder) / name
            self.session.save_soon(path)
            while self.session.working is not None and not self.session.message and self._open:
                self._beat.clear()
                await self._beat.wait()
            if not path.exists():
                raise SettingError(self.session.message or "nothing was saved")
            data = path.read_bytes()
        self.tell(f"saved: {name}")
        return data

    def tell(self, message: str) -> None:
        """Say something on the page."""
        self.session.tell(message)
        self._stir.set()

    async def close(self) -> None:
        """Free all that belongs to the visit."""
        self._open = False
        self._beat.set()  # whoever waits for a file
        self.session.close()
        self._watching.cancel()
        await self._view.close()
        await self._server.stop()
        await asyncio.gather(self._watching, self._running, return_exceptions=True)
        AVAILABLE_SERVERS.pop(self.token, None)
        self._plotter.close()

    def _build(self) -> None:
        """Make the page, and have its fields answered."""
        state, controller = self._server.state, self._server.controller
        state.update({**fixed_part(self.session), **mirrored(self.session), "help": False})
        state.update(progress(self.session))
        with VAppLayout(self._server):
            html.Div(_template("help.html"))
            with html.Div(classes="page"):
                with html.Main(classes="stage", id="stage", aria_label=("`Surface of ${title}`",)):
                    shown = rca.RemoteControlledArea(
                        name="view", display="image", event_throttle_ms=20
                    )
                    html.Div(_template("stage.html"), classes="over")
                html.Aside(_template("panel.html"), classes="panel", id="panel")
        self._view = shown.create_view_handler(
            self._area, encoder="jpeg", target_fps=FRAMES, interactive_quality=QUALITY,
            still_quality=STILL_QUALITY,
        )  # fmt: skip
        self._view.max_pixel_count = MOST_PIXELS
        state.change(*CHOICES)(self._changed)
        controller.trigger("press")(self._press)
        controller.trigger("step")(lambda by: self._do(lambda: self.session.step(int(by))))
        controller.trigger("release")(lambda: self._do(lambda: self.session.change(fixed=())))
        controller.trigger("look")(self._look)

    def _changed(self, **state: Any) -> None:  # noqa: ANN401
        """Take over the fields that differ from what the session has."""
        now = choices(self.session)
        for name in CHOICES:
            if state[name] != now[name]:
                self._do(lambda name=name: choose(self.session, name, state[name]))

    def _do(self, what: Any) -> None:  # noqa: ANN401
        """Do something for the visitor; what is refused is said, and the fields go back."""
        try:
            what()
        except SettingError as error:
            self.session.tell(str(error))
        self._drawn = -1
        self._stir.set()

    def _press(self, key: str) -> None:
        if key == "z":
            self._do(self._history.undo)
        elif key in ZOOMS:
            self._scene.camera.zoom(ZOOMS[key])
            self._view.update()
        else:
            self._do(lambda: press(self.session, str(key)))

    def _look(self) -> None:
        self._scene.look(self.session)
        self._view.update()

    def _click(self, x: float, y: float, inspect: bool) -> None:
        vertex = self._scene.pick(self.session, x, y)
        self._do(lambda: self.session.tap(vertex, inspect=inspect))

    async def _watch(self) -> None:
        """Draw and tell what has changed, until the visit ends."""
        while True:
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(self._stir.wait(), BEAT)
            self._stir.clear()
            try:
                self._refresh()
            except GraspError as error:
                self.session.tell(str(error))
            self._beat.set()

    def _refresh(self) -> None:
        self.session.poll()
        if self.session.revision != self._drawn:
            self._drawn = self.session.revision
            self._scene.update(self.session)
            self._view.update()
            with self._server.state as state:
                state.update(mirrored(self.session))
        else:  # nothing moves: what is chosen can be come back to
            self._history.note()
        with self._server.state as state:
            state.update(progress(self.session))


def _template(name: str) -> str:
    return (STATIC / name).read_text(encoding="utf-8")
