"""The viewer in a browser: serves a page until it is stopped."""

import asyncio
import contextlib
import errno
import ipaddress
import os
import signal
import socket
from collections.abc import AsyncIterator, Callable
from importlib import import_module
from importlib.util import find_spec
from typing import TYPE_CHECKING
from urllib.parse import urlsplit

from grasp3d.errors import OutputError
from grasp3d.rendering import can_render
from grasp3d.viewer.session.album import Album
from grasp3d.viewer.view_settings import ViewSettings

if TYPE_CHECKING:
    from grasp3d.viewer.web.door import FrontDoor

HOST, PORT = "127.0.0.1", 8080
OTHER_PORTS = 20
"""How many ports after the one that is asked for are tried."""
LAST_PORT = 65535

NEEDED = ("trame", "trame_rca", "trame_vuetify", "aiohttp")


def serve(
    album: Album,
    settings: ViewSettings,
    *,
    host: str = HOST,
    port: int = PORT,
    ready: Callable[[str], None] | None = None,
) -> None:
    """Show an album in the browsers that ask for it, until SIGTERM.

    Args:
        album: What is looked at; every visitor goes through it by themselves.
        settings: How it is first shown.
        host: The name or number under which this machine is to be reached; 127.0.0.1: only from
            itself.
        port: Where; if it is taken, the next free one. 0: any.
        ready: Called with the address when visitors may come.

    Raises:
        OutputError: There is no OpenGL, the extra is missing, or the host or port cannot be used.
        KeyboardInterrupt: It was stopped with Ctrl+C.
    """
    door = front_door()
    door.guarded = _is_loopback(host)
    door.offer(album, settings, main=True)
    with contextlib.closing(listening(host, port)) as listener:
        stopped_by = asyncio.run(_serve(door, listener, host, ready))
    if stopped_by == signal.SIGINT:
        raise KeyboardInterrupt


def check_page(host: str, port: int) -> None:
    """Tell before the work whether a page could be served.

    Raises:
        OutputError: It could not, as `serve` says.
    """
    front_door()
    listening(host, port).close()


def can_serve() -> bool:
    """Tell whether the extra is installed."""
    return all(find_spec(name) is not None for name in NEEDED)


def front_door() -> "FrontDoor":
    """Make what visitors come in by; tells before it begins what it lacks.

    Raises:
        OutputError: The extra is missing, or there is no OpenGL.
    """
    if not can_serve():
        raise OutputError("the page needs trame and aiohttp: pip install 'grasp3d[web]'")
    if not can_render():
        raise OutputError(
            "the page's pictures need OpenGL, which is not here; install EGL (on Debian: libegl1 "
            "libgl1) or run where there is a display"
        )
    os.environ["TRAME_ARGS"] = ""  # trame would read our own command line
    door: FrontDoor = import_module("grasp3d.viewer.web.door").FrontDoor()
    return door


def listening(host: str, port: int) -> socket.socket:
    """Take a port, or the next free one.

    Raises:
        OutputError: None of them can be used.
    """
    if not 0 <= port <= LAST_PORT:
        raise OutputError(f"port must be from 0 to {LAST_PORT}; got {port}")
    last = min(port + OTHER_PORTS, LAST_PORT) if port else 0
    for tried in range(port, last + 1):
        try:
            return _bound(host, tried)
        except (OSError, UnicodeError) as error:
            if getattr(error, "errno", None) != errno.EADDRINUSE:
                raise OutputError(f"cannot serve at {host}, port {tried}: {error}") from None
    raise OutputError(f"ports {port} to {last} are all in use; choose another one")


def address_of(host: str, listener: socket.socket) -> str:
    """Where a browser finds the page."""
    name = {"": "127.0.0.1", "0.0.0.0": "127.0.0.1", "::": "[::1]"}.get(host, host)  # noqa: S104
    if ":" in name and not name.startswith("["):
        name = f"[{name}]"
    return f"http://{name}:{listener.getsockname()[1]}/"


def taken(address: str, port: int) -> bool:
    """Whether a page is at another port than was asked for, because that one is in use."""
    return port not in {0, urlsplit(address).port}


@contextlib.asynccontextmanager
async def opened(door: "FrontDoor", listener: socket.socket) -> AsyncIterator[None]:
    """Let visitors in through a port while the block runs."""
    web = import_module("aiohttp.web")
    runner = web.AppRunner(door.app, access_log=None, shutdown_timeout=1.0)
    await runner.setup()
    try:
        await web.SockSite(runner, listener).start()
        yield
    finally:
        await runner.cleanup()


async def _serve(
    door: "FrontDoor", listener: socket.socket, host: str, ready: Callable[[str], None] | None
) -> int:
    """Serve until a signal comes; which one."""
    loop = asyncio.get_running_loop()
    stop: asyncio.Future[int] = loop.create_future()

    def stopped(number: int) -> None:
        if not stop.done():
            stop.set_result(number)

    for number in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(number, stopped, number)
    async with opened(door, listener):
        if ready is not None:
            ready(address_of(host, listener))
        return await stop


def _bound(host: str, port: int) -> socket.socket:
    family, kind, protocol, _, place = socket.getaddrinfo(
        host or None, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE
    )[0]
    made = socket.socket(family, kind, protocol)
    try:
        if os.name == "posix":  # elsewhere it would share a port that is taken
            made.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        made.bind(place)
        made.listen()
    except OSError:
        made.close()
        raise
    return made


def _is_loopback(host: str) -> bool:
    """Whether only this machine reaches what is served at a host."""
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"
