"""Serving the viewer's page to browsers."""

import asyncio
import contextlib
import errno
import ipaddress
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
from urllib.parse import urlsplit

from grasp3d.errors import OutputError
from grasp3d.rendering.opengl import check_rendering
from grasp3d.viewer.session.collection import Collection
from grasp3d.viewer.session.session import Session
from grasp3d.viewer.view_settings import ViewSettings

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
    host: str = HOST,
    port: int = PORT,
    ready: Callable[[str], None] | None = None,
) -> None:
    """Serve a collection to browsers until SIGTERM.

    Args:
        collection: The objects; every visitor has a view of their own.
        settings: Initial view.
        host: Host name or address to serve at; 127.0.0.1: only this machine can connect.
        port: Port; if it is in use, the next free one. 0: any free port.
        ready: Called with the page's address when the server is ready.

    Raises:
        OutputError: There is no OpenGL, or the host or port cannot be used.
        KeyboardInterrupt: It was stopped with Ctrl+C.
    """
    server = create_server()
    server.local_only = _is_loopback(host)
    server.add(partial(Session, collection, settings), main=True)
    with contextlib.closing(listen(host, port)) as listener:
        asyncio.run(_serve(server, listener, host, ready))  # Ctrl+C ends it, too


def check_page(host: str, port: int) -> None:
    """Check that a page can be served.

    Raises:
        OutputError: It cannot; see `serve`.
    """
    create_server()
    listen(host, port).close()


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


def listen(host: str, port: int) -> socket.socket:
    """Open a listening socket at a port, or at the next free one.

    Raises:
        OutputError: None of the ports can be used.
    """
    if not 0 <= port <= LAST_PORT:
        raise OutputError(f"port must be from 0 to {LAST_PORT}; got {port}")
    last = min(port + OTHER_PORTS, LAST_PORT) if port else 0
    for candidate in range(port, last + 1):
        try:
            return _bound(host, candidate)
        except (OSError, UnicodeError) as error:
            if getattr(error, "errno", None) != errno.EADDRINUSE:
                raise OutputError(f"cannot serve at {host}, port {candidate}: {error}") from None
    raise OutputError(f"ports {port} to {last} are all in use; choose another one")


def address_of(host: str, listener: socket.socket) -> str:
    """Address of the page for a browser."""
    name = {"": "127.0.0.1", "0.0.0.0": "127.0.0.1", "::": "[::1]"}.get(host, host)  # noqa: S104
    if ":" in name and not name.startswith("["):
        name = f"[{name}]"
    return f"http://{name}:{listener.getsockname()[1]}/"


def uses_other_port(address: str, port: int) -> bool:
    """Whether a page is served at another port than requested."""
    return port not in {0, urlsplit(address).port}


class BackgroundServer:
    """Serves pages in a thread, for the lifetime of the process."""

    def __init__(self) -> None:
        self._server = create_server()
        self._listener = listen(HOST, PORT)
        started: Future[None] = Future()
        thread = threading.Thread(target=self._run, args=(started,), daemon=True, name="grasp3d")
        thread.start()
        started.result(START_TIMEOUT)

    @property
    def address(self) -> str:
        """Its address on the same machine."""
        return address_of(HOST, self._listener)

    @property
    def port(self) -> int:
        """Its port."""
        return int(self._listener.getsockname()[1])

    def add(self, start: Callable[[], Session]) -> str:
        """Add what visitors can open; returns its path.

        Args:
            start: Starts a session for a visitor.
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
    runner = import_module("aiohttp.web").AppRunner(server.app, shutdown_timeout=1.0)
    await runner.setup()
    try:
        connections = import_module("grasp3d.viewer.web.connections")
        accepting = await connections.accept(runner.server, listener)
        yield
        accepting.close()
    finally:
        await runner.cleanup()


async def _serve(
    server: "ViewerServer", listener: socket.socket, host: str, ready: Callable[[str], None] | None
) -> None:
    """Serve until SIGTERM."""
    stop = asyncio.Event()
    asyncio.get_running_loop().add_signal_handler(signal.SIGTERM, stop.set)
    async with serving(server, listener):
        if ready is not None:
            ready(address_of(host, listener))
        await stop.wait()


def _bound(host: str, port: int) -> socket.socket:
    family, *_, address = socket.getaddrinfo(
        host or None, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE
    )[0]
    both = family == socket.AF_INET6 and socket.has_dualstack_ipv6()
    return socket.create_server(address, family=family, dualstack_ipv6=both)


def _is_loopback(host: str) -> bool:
    """Whether only this machine can connect to a host."""
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"
