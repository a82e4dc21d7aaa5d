"""The viewer as a page for browsers on this machine, with trame's server.

The page shows the state of a session as plain values.
"""

import asyncio
import contextlib
import io
import os
import re
import secrets
import signal
import socket
import threading
from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import asdict
from functools import partial
from importlib.resources import files
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any
from urllib.parse import quote

from aiohttp import web
from aiohttp.typedefs import Handler
from PIL import Image
from trame.app import get_server
from trame.app.core import AVAILABLE_SERVERS
from trame.ui.html import DivLayout
from trame.widgets import html, rca
from trame_client.module import vue3  # type: ignore[import-untyped]

from grasp3d.errors import GraspError, OutputError, SettingError
from grasp3d.pictures.colors import HEX_PALETTE, Ramp
from grasp3d.pictures.opengl import check_rendering, new_plotter
from grasp3d.settings.grasp_model import friction_text
from grasp3d.stability.label import MEANING, Label
from grasp3d.system.names import describe_unexpected
from grasp3d.viewer.controls import CONTROLS, KEYS, OF_WINDOW, handle_key, is_labelled
from grasp3d.viewer.panel_text import PanelText, panel_text
from grasp3d.viewer.scene import ClickDetector, Scene
from grasp3d.viewer.screenshots import file_name, render_copy
from grasp3d.viewer.session import Session

STOPS = slice(None, None, 17)
"""Selects the colours of a ramp that the page's gradient contains."""

OF_SEVERAL = "n"
"""Keys that need several objects."""


def page_state(session: Session) -> dict[str, Any]:
    """Return the state that depends on the session's choices and results."""
    text, inspection = panel_text(session), session.inspection
    hidden = {*OF_WINDOW, *(OF_SEVERAL if len(session.collection.items) == 1 else "")}
    controls = [_control(session, name) for name, one in CONTROLS.items() if one.shown(session)]
    first = [one["name"] for one in controls].index("resolution") + 1
    return {
        **{name: control.read(session) for name, control in CONTROLS.items()},
        "parts": [controls[:first], controls[first:]],
        "keys": [
            {"names": one.names, "text": one.text, "keys": list(one.actions)}
            for one in KEYS
            if not hidden & one.actions.keys()
        ],
        **{name: getattr(text, name) for name in ("title", "facts", "rule", "hint", "stale")},
        "rows": _rows(session, text),
        "ramp": text.ramp and _ramp(text.ramp, stale=text.stale),
        "inspection": inspection
        and {
            "vertex": inspection.vertex,
            "color": HEX_PALETTE[inspection.code],
            "reason": inspection.reason,
            "numbers": [list(number) for number in inspection.numbers],
        },
        "notes": list(text.notes),
        "fixed_count": len(session.state.fixed),
        "message": session.message,
        "ready": session.subject is not None,
        "labelled": is_labelled(session),
        "trame__title": f"{session.name} · grasp3d",
    }


def progress_state(session: Session) -> dict[str, Any]:
    """Return the state of the background job."""
    text, fraction = session.working or ("", 0.0)
    return {"working": text, "percent": round(100.0 * fraction)}


def _control(session: Session, name: str) -> dict[str, Any]:
    """Return a control as the page needs it: a slider with a number, a list, or a check box."""
    one, model = CONTROLS[name], session.state.model
    uncertain = name == "friction" and len(set(model.friction_interval)) > 1
    return {
        "name": name,
        "text": f"{one.text}, {friction_text(model)}" if uncertain else one.text,
        "options": one.options and [list(item) for item in one.options(session).items()],
        **{name: getattr(one, name) for name in ("least", "most", "step", "unit")},
    }


def _rows(session: Session, text: PanelText) -> list[dict[str, Any]]:
    """Return the rows of the area fractions, with an ellipsis while they are unknown."""
    if text.fractions or not (text.stale or session.working is not None):
        return [{**asdict(one), "percent": one.percent} for one in text.fractions]
    meaning = MEANING["scan" if session.state.fixed else "label"]
    return [
        {"letter": one.name, "text": meaning[one], "color": HEX_PALETTE[one], "percent": "…"}
        for one in sorted(Label, reverse=True)
    ]


def _ramp(ramp: Ramp, *, stale: bool) -> dict[str, Any]:
    colors = ", ".join(f"rgb({r}, {g}, {b})" for r, g, b in ramp.colors[STOPS])
    return {
        "text": ramp.text,
        "minimum": ramp.start,
        "maximum": "…" if stale else ramp.end,
        "grey": "" if stale else ramp.grey,
        "note": ramp.note,
        "css": f"linear-gradient(to right, {colors})",
    }


os.environ["TRAME_ARGS"] = ""  # otherwise trame parses this program's command line
HOST, PORT = "127.0.0.1", 8080
OTHER_PORTS = 20
"""Number of following ports to try if the requested one is in use."""
START_TIMEOUT = 60.0
"""Longest time that a page in the background may take to start [s]."""
UNUSED = 3600
"""Time without a browser after which a page in the background ends [s]."""
POLL_INTERVAL = 0.1
"""Time between two polls of the background job [s]."""
ZOOM = 1.2
MAX_PIXELS = 4_000_000
"""Largest number of pixels rendered for a browser, which enlarges smaller pictures."""

STATIC = files("grasp3d.viewer") / "static"
SCRIPTS = re.compile(r'<script type="module"[^>]*></script>|<link rel="stylesheet"[^>]*>')
"""Scripts and styles in trame's own page; their names change with its version."""
FILES = {"labels.ply": ("labeled", ".ply"), "picture.png": ("view", ".png")}
"""Paths of the files that can be saved, and the ends of their names."""
HEADERS = {
    "Cache-Control": "no-store",
    # Vue compiles the template that trame sends, which needs unsafe-eval. The picture's element has
    # styles of its own, which need unsafe-inline.
    "Content-Security-Policy": (
        "default-src 'none'; script-src 'self' 'unsafe-eval'; style-src 'self' 'unsafe-inline'; "
        "img-src 'self' data: blob:; connect-src 'self' ws: wss:; base-uri 'self'; "
        "form-action 'none'"
    ),
    "Referrer-Policy": "no-referrer",  # the address contains the page's token
    "X-Content-Type-Options": "nosniff",
}


def serve(session: Session, *, port: int = PORT, ready: Callable[[str], None]) -> None:
    """Serve a session to browsers of this machine until SIGTERM.

    Args:
        session: Session to show; it belongs to the page from now on.
        port: Port; if it is in use, another one. 0: any free port.
        ready: Called with the page's address when the server is ready.

    Raises:
        OutputError: There is no OpenGL, or no port can be used.
        KeyboardInterrupt: Ctrl+C was pressed.
    """

    async def run() -> None:
        page = Page(session)
        asyncio.get_running_loop().add_signal_handler(signal.SIGTERM, page.stop)
        await page.run(ready, port)

    asyncio.run(run())  # Ctrl+C ends it as well


def serve_in_background(session: Session, *, proxied: bool = False) -> str:
    """Serve a page in a thread until the process ends or no browser has shown it for long.

    Args:
        session: Session to show; it belongs to the page from now on.
        proxied: Accept requests through a proxy, with any host name.

    Returns:
        Address of the page on the same machine.

    Raises:
        OutputError: There is no OpenGL, or no port can be used.
    """
    served: Future[str] = Future()

    async def run() -> None:
        try:
            await Page(session, proxied=proxied).run(served.set_result, unused=UNUSED)
        except Exception as error:  # noqa: BLE001
            if not served.done():
                served.set_exception(error)

    threading.Thread(target=lambda: asyncio.run(run()), daemon=True).start()
    return served.result(START_TIMEOUT)


def free_port(port: int = PORT) -> int:
    """Return the first free port from a given one on, or else any free port.

    Raises:
        OutputError: No port is free.
    """
    for candidate in (*range(port, port + OTHER_PORTS + 1), 0):
        with contextlib.suppress(OSError), socket.create_server((HOST, candidate)) as found:
            return int(found.getsockname()[1])
    raise OutputError(f"no port of {HOST} can be used to serve the page")


class Page:
    """A session as a page whose address contains a random token; used in one event loop.

    All browsers that open the address show the same view. Only the token protects the page: anyone
    who knows the address can see the object, change the view, save files and end the page.
    """

    def __init__(self, session: Session, *, proxied: bool = False) -> None:
        """Make the page; `run` serves it.

        Args:
            session: Session to show; it belongs to the page.
            proxied: Accept requests with any host name.

        Raises:
            OutputError: There is no OpenGL.
        """
        check_rendering()
        self._session, self._proxied = session, proxied
        self._plotter = new_plotter(session.settings.width, session.settings.height)
        self._plotter.enable_trackball_style()  # type: ignore[call-arg]
        for name in ("KeyPressEvent", "CharEvent"):  # the page handles keys
            self._plotter.iren.interactor.RemoveObservers(name)  # type: ignore[union-attr]
        self._scene = Scene(self._plotter, legend=False)
        ClickDetector(self._plotter, self._click)
        self._path = f"/{secrets.token_hex(16)}/"
        self._wake, self._drawn = asyncio.Event(), -1
        self._server = get_server(self._path, client_type="vue3")
        self._build()

    async def run(self, ready: Callable[[str], None], port: int = PORT, unused: int = 0) -> None:
        """Serve the page until `stop`.

        Args:
            ready: Called with the address when a browser can open the page.
            port: Port; if it is in use, another one.
            unused: Time without a browser after which the page ends [s]. 0: never.
        """
        server = self._server
        server.cli.set_defaults(ws=f"{self._path}ws")
        server.controller.on_server_bind.add(self._protect)
        address = f"http://{HOST}:{(port := free_port(port))}{self._path}"
        server.controller.on_server_ready.add(lambda **_: ready(address))
        watching = asyncio.create_task(self._watch())
        try:
            await server.start(
                exec_mode="coroutine", backend="aiohttp", thread=True, timeout=unused,
                host=HOST, port=port, open_browser=False, show_connection_info=False,
                disable_logging=True,
            )  # fmt: skip
        finally:
            self._session.close()  # a waiting download ends
            with contextlib.suppress(asyncio.InvalidStateError):  # the server has stopped itself
                await server.stop()
            watching.cancel()
            await self._view.close()
            AVAILABLE_SERVERS.pop(self._path)
            self._plotter.close()
            # trame's objects refer to this one, so large data are released here.
            vars(self).clear()

    def stop(self) -> None:
        """End `run`."""
        self._session.close()
        self._stopping = asyncio.create_task(self._server.stop())

    def _build(self) -> None:
        """Create the page's elements and connect its events."""
        server = self._server
        server.state.update({**page_state(self._session), **progress_state(self._session)})
        server.state.trame__template_error = (STATIC / "ended.html").read_text(encoding="utf-8")
        with DivLayout(server, classes="page"):
            with html.Main(id="stage", aria_label=("`Surface of ${title}`",)):
                view = rca.RemoteControlledArea(display="image", event_throttle_ms=20)
            html.Div((STATIC / "page.html").read_text(encoding="utf-8"), classes="beside")
        self._view = view.create_view_handler(
            self._plotter.render_window, encoder="jpeg", target_fps=30.0,
            interactive_quality=70, still_quality=95,
        )  # fmt: skip
        self._view.max_pixel_count = MAX_PIXELS
        server.state.change(*CONTROLS)(self._on_change)
        server.controller.trigger("key")(self._on_key)

    def _protect(self, bound: Any) -> None:
        """Prepare trame's server: all paths begin with the token, and all responses get headers."""
        app, path, front = bound.app, self._path, _front()

        async def page(_: web.Request) -> web.StreamResponse:
            return web.Response(text=front, content_type="text/html")

        async def no_launcher(_: web.Request) -> web.StreamResponse:
            return web.json_response(None)

        app.middlewares.append(self._check)
        app.on_response_prepare.append(_add_headers)
        folders = {"own": str(STATIC), **self._server.serve, "": vue3.www}
        app.add_routes([
            web.get(path, page),
            *(web.get(path + one, partial(self._download, *FILES[one])) for one in FILES),
            # trame's client first asks for the address of another server; there is none.
            web.post(f"{path}paraview/", no_launcher),
            *(web.static(path + name, folder) for name, folder in folders.items()),
        ])  # fmt: skip

    @web.middleware
    async def _check(self, request: web.Request, handler: Handler) -> web.StreamResponse:
        """Refuse requests from pages of other sites, and from programs without the token."""
        if not (self._proxied or _is_local(request.host)):
            raise web.HTTPForbidden(text="Use the address 127.0.0.1 or localhost.")
        if not request.path.startswith(self._path):
            raise web.HTTPNotFound(text="There is no object here: use the whole address.")
        is_socket = "Upgrade" in request.headers and _is_same_origin(request)
        if request.path == f"{self._path}ws" and not is_socket:
            raise web.HTTPForbidden(text="Connections from other sites are not allowed.")
        return await handler(request)

    async def _download(self, kind: str, suffix: str, _: web.Request) -> web.StreamResponse:
        """Send a file; without one the browser stays on the page, which shows the reason."""
        name, headers = file_name(self._session, kind, suffix), {}
        try:
            data = self._picture() if suffix == ".png" else await self._labels(name)
            headers["Content-Disposition"] = f"attachment; filename*=UTF-8''{quote(name)}"
            status, message = 200, f"saved: {name}"
        except GraspError as error:
            data, status, message = b"", 204, str(error)
        self._run(lambda: self._session.show_message(message))
        return web.Response(body=data, status=status, headers=headers)

    async def _labels(self, name: str) -> bytes:
        with TemporaryDirectory() as folder:
            path, session = Path(folder) / name, self._session
            session.save(path)
            while session.saving:  # noqa: ASYNC110
                await asyncio.sleep(POLL_INTERVAL)
            if not path.exists():
                raise SettingError(session.message or "nothing was saved")
            return path.read_bytes()

    def _picture(self) -> bytes:
        self._session.check_current()
        width, height = self._plotter.render_window.GetSize()  # type: ignore[union-attr]
        picture, data = render_copy(self._session, self._scene.camera, width, height), io.BytesIO()
        Image.fromarray(picture).save(data, "PNG")
        return data.getvalue()

    def _run(self, action: Callable[[], object]) -> None:
        """Run an action of the user; after an error the page shows the old values again."""
        try:
            action()
        except SettingError as error:
            self._session.show_message(str(error))
        self._drawn = -1
        self._wake.set()

    def _on_change(self, **state: Any) -> None:
        """Apply the fields that differ from those of the session."""
        for name, control in CONTROLS.items():
            if state[name] != control.read(self._session):
                self._run(partial(control.change, self._session, state[name]))

    def _on_key(self, key: str) -> None:
        camera = self._scene.camera
        actions: dict[str, Callable[[], object]] = {
            "+": lambda: camera.zoom(ZOOM), "-": lambda: camera.zoom(1.0 / ZOOM),
            "r": lambda: self._scene.look(self._session),
        }  # fmt: skip
        self._run(actions.get(key, lambda: handle_key(self._session, str(key))))

    def _click(self, x: float, y: float, inspect: bool) -> None:
        vertex = self._scene.pick(x, y)
        self._run(lambda: self._session.click(vertex, inspect=inspect))

    async def _watch(self) -> None:
        """Poll the session and update the page."""
        while True:
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(self._wake.wait(), POLL_INTERVAL)
            self._wake.clear()
            try:
                self._refresh()
            except Exception as error:  # noqa: BLE001, the page goes on
                text = str(error) if isinstance(error, GraspError) else describe_unexpected(error)
                if text != self._session.message:
                    self._session.show_message(text)

    def _refresh(self) -> None:
        session = self._session
        session.poll()
        with self._server.state as state:
            state.update(progress_state(session))
            if session.revision != self._drawn:
                self._drawn = session.revision
                state.update(page_state(session))
                self._scene.update(session)
                self._view.update()


async def _add_headers(_: web.Request, response: web.StreamResponse) -> None:
    response.headers.update(HEADERS)


def _front() -> str:
    """Return the page with the scripts of trame's own page."""
    trame = Path(vue3.www, "index.html").read_text(encoding="utf-8")
    scripts = "\n    ".join(SCRIPTS.findall(trame))
    return (STATIC / "index.html").read_text(encoding="utf-8").replace("TRAME", scripts)


def _is_local(host: str) -> bool:
    """Whether a Host header is an address or localhost; other names may be rebound by DNS."""
    return bool(re.fullmatch(r"(localhost|[\d.]+|\[[\da-fA-F:]+\])(:\d+)?", host))


def _is_same_origin(request: web.Request) -> bool:
    """Whether a request comes from a page of this server, directly or through a proxy."""
    _, _, origin = request.headers.get("Origin", "").partition("://")
    return bool(origin) and origin in {request.host, request.headers.get("X-Forwarded-Host")}
