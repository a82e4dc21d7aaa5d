"""One visitor of the page: a session, its renderer and the page's state.

The messages that browsers send are checked before trame handles them.
"""

import asyncio
import contextlib
import inspect
import io
import logging
import time
from collections.abc import AsyncIterator, Awaitable, Callable, Container
from functools import cache, partial
from importlib.resources import files
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import pyvista
import trame_client.module  # type: ignore[import-untyped]
from aiohttp import WSCloseCode, WSMessage, WSMsgType, web
from PIL import Image
from trame.app import get_server
from trame.app.core import AVAILABLE_SERVERS
from trame.ui.vuetify3 import VAppLayout
from trame.widgets import html, rca
from trame_rca.rca import VtkRemoteControlledArea
from wslink.chunking import UnChunker

from grasp3d.errors import GraspError, SettingError
from grasp3d.system.names import printable
from grasp3d.viewer.scene.pictures import file_name, render_copy
from grasp3d.viewer.scene.scene import ClickDetector, Scene, new_plotter
from grasp3d.viewer.session.controls import CONTROLS, control_values, handle_key
from grasp3d.viewer.session.history import History
from grasp3d.viewer.session.session import Session
from grasp3d.viewer.web.page_state import constant_state, page_state, progress_state

LOG = logging.getLogger("grasp3d.viewer.web")
"""What the server reports."""

MAX_MESSAGE_BYTES = 1 << 20
"""Largest message from a browser; these are mouse events [bytes]."""

LONGEST_REASON = 200
"""Characters of a reason in the log."""

MOST_LINES, LOG_PERIOD = 30, 10.0
"""Number of lines that are logged in a period [s]; the others are only counted."""

VIEW = "view"
"""Name of the page's one picture."""

SYSTEM = "system"
"""Beginning of the identifiers of wslink's own messages."""


BUTTONS = tuple(
    f"{side}Button{what}" for side in ("Left", "Middle", "Right") for what in ("Press", "Release")
)
WHEELS = ("StartMouseWheel", "MouseWheel", "EndMouseWheel")
GESTURES = tuple(
    f"{when}{what}" for when in ("Start", "", "End") for what in ("Pinch", "Rotate", "Pan")
)
EVENTS = frozenset({"MouseMove", *BUTTONS, *WHEELS, *GESTURES})
"""Kinds of events that reach VTK."""
NUMBERS = (
    "x", "y", "w", "h", "ctrlKey", "altKey", "shiftKey", "metaKey", "spinY", "factor", "rotation",
)  # fmt: skip
MAX_TOUCHES = 10
MAX_NUMBER = 1e6


class MessageError(GraspError):
    """A browser has sent a message that no page of this server sends."""


class Terse(logging.Filter):
    """Makes every record one line, and passes few of them, so that no client fills a disk."""

    def __init__(self) -> None:
        super().__init__()
        self._began, self._count = -LOG_PERIOD, 0

    def filter(self, record: logging.LogRecord) -> bool:
        """Whether a record is written; it says then how many were not."""
        error = record.exc_info[1] if record.exc_info else None
        text = " ".join(record.getMessage().split())
        record.msg, record.args = f"{text}: {one_line(error)}" if error else text, ()
        record.exc_info = record.exc_text = None
        now, left_out = time.monotonic(), self._count - MOST_LINES
        if now - self._began >= LOG_PERIOD:
            if left_out > 0:
                record.msg += f" (and {left_out:,} more lines before that were not written)"
            self._began, self._count = now, 0
        self._count += 1
        return self._count <= MOST_LINES


LOG.addFilter(Terse())


def check_message(message: WSMessage, methods: Container[str]) -> None:
    """Check that a message is a complete call of a known method.

    trame would otherwise reserve as much memory as a message promises, and print a traceback for
    what it cannot decode.

    Args:
        message: From a browser's socket.
        methods: Names of the known methods.

    Raises:
        MessageError: It is malformed.
    """
    if message.type is WSMsgType.ERROR:
        raise MessageError(one_line(message.data))
    if message.type is not WSMsgType.BINARY:
        raise MessageError(f"{message.type.name.lower()} instead of binary data")
    reader = UnChunker()
    reader.set_max_message_size(MAX_MESSAGE_BYTES)
    try:
        call = reader.process_chunk(message.data)
    except (ValueError, TypeError, RecursionError) as error:
        raise MessageError(one_line(error)) from error
    if not isinstance(call, dict):
        kind = "an incomplete message" if call is None else type(call).__name__
        raise MessageError(f"{kind} instead of a call")
    _check_call(call, methods)


def checked_event(event: dict[str, Any]) -> dict[str, Any]:
    """An event of the mouse or of fingers with every value that VTK reads, 0 if it was not given.

    VTK ends the process where a value is missing or of another type.

    Raises:
        MessageError: A value is not of its type.
    """
    touches, shift = event.get("positions", {}), event.get("translation", (0.0, 0.0))
    if not isinstance(touches, dict) or len(touches) > MAX_TOUCHES:
        raise MessageError("an event whose positions are not those of some fingers")
    if not isinstance(shift, list | tuple) or len(shift) != 2:
        raise MessageError("an event whose translation is not two numbers")
    return {
        "type": event["type"],
        **{name: _number(event.get(name, 0)) for name in NUMBERS},
        "translation": [_number(one) for one in shift],
        "positions": {
            str(finger): {axis: _number(at[axis]) for axis in "xy"}
            for finger, at in touches.items()
        },
    }


def guarded(function: Callable[..., Any], report: Callable[[str], None]) -> Callable[..., Any]:
    """A method that browsers call, whose exceptions are reported in one line instead of raised.

    Args:
        function: The method.
        report: Called with the reason.
    """

    async def awaited(result: Any) -> Any:
        try:
            return await result
        except Exception as error:  # noqa: BLE001
            report(one_line(error))

    def called(*args: Any, **kwargs: Any) -> Any:
        try:
            result = function(*args, **kwargs)
        except Exception as error:  # noqa: BLE001
            report(one_line(error))
            return None
        return awaited(result) if inspect.isawaitable(result) else result

    return called


def one_line(error: object) -> str:
    """An error as one short line."""
    name = f"{type(error).__name__}: " if isinstance(error, Exception) else ""
    return printable(" ".join(f"{name}{error}".split()))[:LONGEST_REASON]


def _number(value: object) -> float:
    if not isinstance(value, int | float) or not -MAX_NUMBER <= value <= MAX_NUMBER:
        raise MessageError(f"an event with {one_line(repr(value))} instead of a number")
    return value


def _check_call(call: dict[Any, Any], methods: Container[str]) -> None:
    name, number = call.get("method"), call.get("id")
    if not isinstance(name, str) or not isinstance(number, str):
        raise MessageError("a call without a method and an identifier")
    if name not in methods and not number.startswith(SYSTEM):
        raise MessageError(f"there is no method {name[:LONGEST_REASON]!r}")
    if not isinstance(call.get("args", []), list) or not isinstance(call.get("kwargs", {}), dict):
        raise MessageError(f"{name}: its arguments are neither a list nor a mapping")
    if name.startswith("trame.rca.") and VIEW not in call.get("args", [])[:1]:
        raise MessageError(f"{name}: there is no such picture")  # trame would print a line


POLL_INTERVAL = 0.1
"""Time between two polls of the background job [s]."""
FRAMES = 30.0
"""Largest number of pictures per second."""
RENDERING = 0.25
"""Largest part of the time in which pictures are rendered if several visitors drag at once."""
ACTIVE = 2.0
"""How long a visitor counts as active after a message [s]."""
SLOW_READER = 10.0
"""Longest wait for a browser to take a message [s]."""
MAX_SOCKETS = 4
"""Largest number of sockets of one page; a page that is loaded again may leave one behind."""
ZOOMS = {"+": 1.2, "-": 1.0 / 1.2}
QUALITY, STILL_QUALITY = 70, 95
"""JPEG quality of the pictures during and after interaction [percent]."""
Receive = Callable[[WSMessage], Awaitable[None]]
"""Handles a message; raises MessageError if it is malformed."""
STATIC = files("grasp3d.viewer.web") / "static"


MAX_SIDE = 8192
"""Largest width and height of a picture [pixels]."""
MAX_PIXELS = 4_000_000
"""Largest number of pixels rendered for a browser, which enlarges the picture if it needs more."""


class Client:
    """Everything that belongs to one visitor; used only in the thread of the event loop."""

    def __init__(self, token: str, session: Session) -> None:
        self.token = token
        self.session = session
        self._plotter = new_plotter(session.settings, off_screen=True)
        self._plotter.enable_trackball_style()  # type: ignore[call-arg]
        self._history = History(self.session)
        self._scene = Scene(self._plotter, legend=False)
        self._clicks = ClickDetector(self._plotter, self._click)
        self._server = get_server(self.token, client_type="vue3")
        self._wake, self._polled = asyncio.Event(), asyncio.Event()
        self._saving, self._open = asyncio.Lock(), True
        self._drawn = -1
        self._sockets: list[web.WebSocketResponse] = []
        self._guarded, self._failure = False, ""
        self.last_used = time.monotonic()
        """When it sent its last message, or its last connection ended."""
        self._remote_view = RemoteView(self._plotter)
        self._build()
        self._bound: list[Any] = []
        self._server.controller.on_server_bind.add(self._bound.append)
        self._running = self._server.start(
            exec_mode="task", backend="generic", show_connection_info=False, open_browser=False,
            disable_logging=True, timeout=0,
        )  # fmt: skip
        self._watching = asyncio.create_task(self._watch())

    @property
    def idle_time(self) -> float:
        """Time without connections [s]; 0 if there is one."""
        return 0.0 if self._sockets else time.monotonic() - self.last_used

    @property
    def is_active(self) -> bool:
        """Whether it has sent a message just now."""
        return time.monotonic() - self.last_used < ACTIVE

    def share_time(self, others: int) -> None:
        """Render as often as the event loop has time for, with some other active clients."""
        share = RENDERING / (others + 1) / max(self._remote_view.duration, 1e-3)
        self._view.target_fps = max(1.0, min(FRAMES, share)) if others else FRAMES

    @contextlib.asynccontextmanager
    async def connected(self, socket: web.WebSocketResponse) -> AsyncIterator[Receive]:
        """Connect a browser's socket to trame; yields a function that handles its messages."""
        await self._server.ready
        endpoint = self._bound[0]["ws"]
        self._guard(endpoint)
        link = await endpoint.connect()

        async def send(binary: bool, data: Any) -> None:
            with contextlib.suppress(ConnectionError):  # the browser disconnected; handled below
                try:
                    async with asyncio.timeout(SLOW_READER):
                        await (socket.send_bytes(data) if binary else socket.send_str(data))
                except TimeoutError:  # pictures for it would fill the memory
                    await _close(socket)

        async def receive(message: WSMessage) -> None:
            check_message(message, endpoint.functionMap)
            self.last_used = time.monotonic()
            await link.send(True, message)  # noqa: FBT003
            await asyncio.sleep(0)  # no visitor has the event loop alone
            if self._failure:
                failure, self._failure = self._failure, ""
                raise MessageError(failure)

        link.on_message(send)
        while len(self._sockets) >= MAX_SOCKETS:
            await _close(self._sockets.pop(0))
        self._sockets.append(socket)
        try:
            yield receive
        finally:
            if socket in self._sockets:
                self._sockets.remove(socket)
            self.last_used = time.monotonic()
            await link.close()

    def _guard(self, endpoint: Any) -> None:
        """Report exceptions of the methods that browsers call in one line."""
        if self._guarded:
            return
        self._guarded = True

        def report(reason: str) -> None:
            self._failure = reason

        methods = endpoint.functionMap
        methods.update(
            {name: (one, guarded(call, report)) for name, (one, call) in methods.items()}
        )

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
        """Release everything that belongs to the visitor."""
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
        # trame's objects refer to this one and to each other until their cycles are collected,
        # which may take a hundred visits; what is large is released now.
        del self._plotter, self._scene, self._clicks, self._view, self._remote_view, self._history
        del self.session

    def _build(self) -> None:
        """Make the page and connect its events."""
        state, controller = self._server.state, self._server.controller
        state.update({**constant_state(self.session), **page_state(self.session)})
        # A number that is being typed is kept when the page is drawn again.
        state.update({"help": False, "held": False, "typed": {}})
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
            self._remote_view, encoder="jpeg", target_fps=FRAMES, interactive_quality=QUALITY,
            still_quality=STILL_QUALITY,
        )  # fmt: skip
        self._view.max_pixel_count = MAX_PIXELS
        state.change(*CONTROLS)(self._on_change)
        controller.on_error.add(lambda text: LOG.warning("error in a page: %s", one_line(text)))
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
        """Run an action of the visitor; after an error the fields are reset."""
        try:
            action()
        except SettingError as error:
            self.session.show_message(str(error))
        self._drawn = -1
        self._wake.set()

    def _on_key(self, key: str) -> None:
        if key == "z":
            self._run(self._history.undo)
        elif key in ZOOMS:
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
        if not self._server.state.held:  # a whole drag of a slider is one step for undo
            self._history.record()
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
    """The render window of a plotter, without VTK's key bindings; the page handles keys."""

    def __init__(self, plotter: pyvista.Plotter) -> None:
        super().__init__(plotter.render_window)
        self.duration = 0.0
        """Time that the last picture took [s]."""

    @property
    def img_cols_rows(self) -> tuple[Any, int, int]:
        """Render a picture; its pixels, width and height."""
        began = time.monotonic()
        picture: tuple[Any, int, int] = super().img_cols_rows
        self.duration = time.monotonic() - began
        return picture

    def process_interaction_event(self, event: dict[str, Any]) -> None:
        """Forward events of the mouse and of fingers, but no key events."""
        if event.get("type") in EVENTS:
            super().process_interaction_event(checked_event(event))

    def process_resize_event(self, width: int, height: int) -> None:
        """Resize the picture, within what can be rendered."""
        super().process_resize_event(min(width, MAX_SIDE), min(height, MAX_SIDE))
