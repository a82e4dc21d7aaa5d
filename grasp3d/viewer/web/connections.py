"""Connections to the page's server: limited per address and in all, and closed when they idle."""

import asyncio
import contextlib
import socket
from collections.abc import Iterator
from typing import Any

from aiohttp import web

from grasp3d.viewer.web.client import LOG

MAX_CONNECTIONS, MAX_PER_ADDRESS = 500, 250
"""Largest number of connections, in all and of one address; most systems allow 1,024 open files."""
IDLE_CONNECTION = 5.0
"""How long a connection is kept without a complete request [s]."""
LINGERING = 1.0
"""How long the rest of a request is read that was answered before its end [s]."""


class Connections:
    """The open connections, by address; the one that waits longest gives way to a new one."""

    def __init__(self) -> None:
        self._of: dict[str, dict[Connection, bool]] = {}  # whether a request is being answered

    def add(self, connection: "Connection") -> None:
        """Add a new connection, and close another one if there are too many."""
        if len(self._of.get(connection.address, ())) >= MAX_PER_ADDRESS:
            self._close_one(connection.address)
        elif sum(map(len, self._of.values())) >= MAX_CONNECTIONS:
            self._close_one(max(self._of, key=lambda address: len(self._of[address])))
        self._of.setdefault(connection.address, {})[connection] = False

    def remove(self, connection: "Connection") -> bool:
        """Forget a connection; whether it was known."""
        of_address = self._of.get(connection.address, {})
        known = of_address.pop(connection, None) is not None
        if not of_address:
            self._of.pop(connection.address, None)
        return known

    def note(self, connection: "Connection", *, busy: bool) -> None:
        """Note that a connection has asked for something, or has its answer."""
        if self.remove(connection):
            self._of.setdefault(connection.address, {})[connection] = busy

    def _close_one(self, address: str) -> None:
        """Close the connection of an address that waits longest, or else has asked first."""
        waiting = (one for one, busy in self._of[address].items() if not busy)
        one = next(waiting, None) or next(iter(self._of[address]))
        self.remove(one)
        one.force_close()


class Connection(web.RequestHandler):
    """A connection that is counted."""

    __slots__ = ("address", "connections")

    def __init__(self, connections: Connections, server: web.Server) -> None:
        super().__init__(
            server,
            loop=asyncio.get_running_loop(),
            access_log=None,  # type: ignore[arg-type]
            logger=LOG,
            keepalive_timeout=IDLE_CONNECTION,
            lingering_time=LINGERING,
        )
        self.connections = connections
        self.address = ""

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Count the connection."""
        self.address = str((transport.get_extra_info("peername") or ("",))[0])
        super().connection_made(transport)
        self.connections.add(self)

    def connection_lost(self, exc: BaseException | None) -> None:
        """Forget the connection."""
        self.connections.remove(self)
        super().connection_lost(exc)


@contextlib.contextmanager
def answering(request: web.Request) -> Iterator[None]:
    """Count a connection as busy while its request is being answered."""
    connection = request.protocol
    if not isinstance(connection, Connection):
        yield
        return
    connection.connections.note(connection, busy=True)
    try:
        yield
    finally:
        connection.connections.note(connection, busy=False)


async def accept(server: web.Server, listener: socket.socket) -> asyncio.Server:
    """Accept connections to a server, and log what goes wrong beside all requests in a line."""
    loop, connections = asyncio.get_running_loop(), Connections()
    loop.set_exception_handler(_report)
    return await loop.create_server(lambda: Connection(connections, server), sock=listener)


def _report(_: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
    LOG.error("%s", context.get("message"), exc_info=context.get("exception"))
