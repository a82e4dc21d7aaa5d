"""Serving the viewer's page to browsers."""

import asyncio
import contextlib
import errno
import os
import signal
import socket
import threading
import webbrowser
from collections.abc import AsyncIterator, Callable
from concurrent.futures import Future
from functools import cache, partial
from importlib import import_module
from typing import TYPE_CHECKING

from grasp3d.errors import OutputError
from grasp3d.pictures.opengl import check_rendering
from grasp3d.pictures.view_settings import ViewSettings
from grasp3d.viewer.session.collection import Collection
from grasp3d.viewer.session.session import Session

if TYPE_CHECKING:
    from grasp3d.viewer.web.server import ViewerServer

HOST, PORT = "127.0.0.1", 8080
OTHER_PORTS = 20
"""Number of following ports that are tried if the requested one is in use."""
LAST_PORT = 65535
START_TIMEOUT = 60.0
"""Longest wait for a server in the background to start [s]."""


def serve(
    collection: Collection,
    settings: ViewSettings,
    *,
    port: int = PORT,
    ready: Callable[[str], None] | None = None,
) -> None:
    """Serve a collection to browsers of this machine until SIGTERM.

    Args:
        collection: The objects.
        settings: Initial view.
        port: Port; if it is in use, the next free one. 0: any free port.
        ready: Called with the page's address when the server is ready.

    Raises:
        OutputError: There is no OpenGL, or the port cannot be used.
        KeyboardInterrupt: It was stopped with Ctrl+C.
    """
    server = create_server()
    server.add(partial(Session, collection, settings))
    with contextlib.closing(listen(port)) as listener:
        asyncio.run(_serve(server, listener, ready))  # Ctrl+C ends it, too


def check_page() -> None:
    """Check that a page can be served.

    Raises:
        OutputError: It cannot; see `serve`.
    """
    create_server()
    listen(PORT).close()


def open_page(session: Session) -> str:
    """Serve what a session shows until the process ends, and open it in a browser.

    The page has a session of its own, which starts with the same object and the same choices:
    friction, resolution, errors, colours, section, inspected vertex and fixed fingers.

    Args:
        session: The session, which is not changed.

    Returns:
        Address of the page.

    Raises:
        OutputError: It cannot be served, or there is no browser.
    """
    server = background_server()
    start = partial(
        Session, session.collection, session.settings, state=session.state, number=session.number
    )
    address = server.address + server.add(start)
    if not webbrowser.open(address):
        raise OutputError(f"no browser was found; open {address} in one while this program runs")
    return address


def create_server() -> "ViewerServer":
    """Make a server without content.

    Raises:
        OutputError: There is no OpenGL.
    """
    check_rendering()
    os.environ["TRAME_ARGS"] = ""  # otherwise trame parses this program's command line
    server: ViewerServer = import_module("grasp3d.viewer.web.server").ViewerServer()
    return server


def listen(port: int) -> socket.socket:
    """Open a listening socket at a port, or at the next free one.

    Raises:
        OutputError: None of the ports can be used.
    """
    if not 0 <= port <= LAST_PORT:
        raise OutputError(f"port must be from 0 to {LAST_PORT}; got {port}")
    last = min(port + OTHER_PORTS, LAST_PORT) if port else 0
    for candidate in range(port, last + 1):
        try:
            return socket.create_server((HOST, candidate))
        except OSError as error:
            if error.errno != errno.EADDRINUSE:
                raise OutputError(f"cannot serve at {HOST}, port {candidate}: {error}") from None
    raise OutputError(f"ports {port} to {last} are all in use; choose another one")


def address_of(listener: socket.socket) -> str:
    """Address of the page for a browser."""
    return f"http://{HOST}:{listener.getsockname()[1]}/"


class BackgroundServer:
    """Serves pages in a thread, for the lifetime of the process."""

    def __init__(self) -> None:
        self._server = create_server()
        self._listener = listen(PORT)
        started: Future[None] = Future()
        thread = threading.Thread(target=self._run, args=(started,), daemon=True, name="grasp3d")
        thread.start()
        started.result(START_TIMEOUT)

    @property
    def address(self) -> str:
        """Its address on the same machine."""
        return address_of(self._listener)

    @property
    def port(self) -> int:
        """Its port."""
        return int(self._listener.getsockname()[1])

    def add(self, start: Callable[[], Session]) -> str:
        """Add a view; returns its path.

        Args:
            start: Starts its session.
        """
        return self._server.add(start)

    def allow_other_hosts(self) -> None:
        """Accept requests through a proxy, with any host name."""
        self._server.local_only = False

    def _run(self, started: "Future[None]") -> None:
        async def forever() -> None:
            async with serving(self._server, self._listener):
                started.set_result(None)
                await asyncio.Event().wait()

        try:
            asyncio.run(forever())
        except Exception as error:  # noqa: BLE001
            if not started.done():
                started.set_exception(error)


@cache
def background_server() -> BackgroundServer:
    """The server in the background of this process; started at the first call."""
    return BackgroundServer()


@contextlib.asynccontextmanager
async def serving(server: "ViewerServer", listener: socket.socket) -> AsyncIterator[None]:
    """Accept connections while the block runs."""
    web = import_module("aiohttp.web")
    runner = web.AppRunner(server.app, access_log=None, shutdown_timeout=1.0)
    await runner.setup()
    try:
        await web.SockSite(runner, listener).start()
        yield
    finally:
        await runner.cleanup()


async def _serve(
    server: "ViewerServer", listener: socket.socket, ready: Callable[[str], None] | None
) -> None:
    """Serve until SIGTERM."""
    stop = asyncio.Event()
    asyncio.get_running_loop().add_signal_handler(signal.SIGTERM, stop.set)
    async with serving(server, listener):
        if ready is not None:
            ready(address_of(listener))
        await stop.wait()
