"""The HTTP server: creates a client for every visitor and forwards requests to it."""

import asyncio
import io
import ipaddress
import logging
import re
import secrets
from collections.abc import AsyncIterator, Callable
from pathlib import Path
from urllib.parse import quote, urlsplit

from aiohttp import WSCloseCode, web
from aiohttp.typedefs import Handler
from PIL import Image

from grasp3d.errors import GraspError
from grasp3d.viewer.session.session import Session
from grasp3d.viewer.web.client import STATIC, Client
from grasp3d.viewer.web.messages import MAX_MESSAGE_BYTES, MessageError

LOG = logging.getLogger(__name__)

MAX_CLIENTS = 16
IDLE_TIMEOUT = 60.0
"""How long a client is kept without connections [s]."""
COOKIE = "grasp3d"
"""Cookie that identifies a browser; another browser with the same address gets its own client."""
CLOSE_TIMEOUT = 0.3
"""Longest wait for a browser to confirm that its connection is closed [s]."""

FULL = "The viewer has too many visitors. Try again in a minute."
ASSETS = re.compile(r'<script type="module"[^>]*></script>|<link rel="stylesheet"[^>]*>')
"""Scripts and styles in trame's own page; their names change with its version."""

HEADERS = {
    "Cache-Control": "no-store",
    "Content-Security-Policy": "default-src 'self' 'unsafe-inline' 'unsafe-eval' data: blob:; "
    "connect-src 'self' ws: wss:; object-src 'none'; base-uri 'self'",
    "Referrer-Policy": "no-referrer",  # the address contains the client's token
    "X-Content-Type-Options": "nosniff",
}


class ViewerServer:
    """Gives every visitor a client of their own, at an address with a random token."""

    def __init__(
        self,
        *,
        local_only: bool = True,
        max_clients: int = MAX_CLIENTS,
        idle_timeout: float = IDLE_TIMEOUT,
    ) -> None:
        """Make a server without content.

        Args:
            local_only: Refuse requests for other host names than localhost and IP addresses, as
                protection against DNS rebinding.
            max_clients: Largest number of clients at the same time.
            idle_timeout: How long a client is kept without connections [s].
        """
        self.local_only = local_only
        self._max_clients = max_clients
        self._idle_timeout = idle_timeout
        self._contents: dict[str, Callable[[], Session]] = {}
        self._clients: dict[str, Client] = {}
        self._content_of: dict[str, str] = {}
        self.app = web.Application(middlewares=[_with_headers, self._check_host])
        self.app.add_routes([
            web.get("/", self._enter),
            web.get("/a/{content}/", self._enter),
            web.get("/s/{token}/", self._page),
            web.get("/s/{token}/index.html", self._page),
            web.get("/s/{token}/ws", self._socket),
            web.get("/s/{token}/labels.ply", self._labels),
            web.get("/s/{token}/picture.png", self._picture),
            web.get("/s/{token}/{name:.+}", self._file),
        ])  # fmt: skip
        self.app.cleanup_ctx.append(self._cleanup)

    def add(self, start: Callable[[], Session], *, main: bool = False) -> str:
        """Add what visitors can open.

        Args:
            start: Starts a session for a visitor.
            main: Whether it is at the server's address itself.

        Returns:
            Its path; '' for the main one.
        """
        name = "" if main else secrets.token_hex(16)
        self._contents[name] = start
        return f"a/{name}/" if name else ""

    async def _enter(self, request: web.Request) -> web.StreamResponse:
        """Make a new client and redirect the browser to it."""
        name = request.match_info.get("content", "")
        start = self._contents.get(name)
        if start is None:
            raise web.HTTPNotFound(text="There is no object here.")
        await self._limit_clients()
        client = Client(start())
        self._clients[client.token] = client
        self._content_of[client.token] = name
        browser = request.cookies.get(COOKIE) or secrets.token_hex(16)
        client.browser = browser
        response = web.HTTPFound(f"{'../../' if name else ''}s/{client.token}/")
        response.set_cookie(COOKIE, browser, httponly=True, samesite="Lax")
        raise response

    async def _limit_clients(self) -> None:
        """Close the client that has been idle longest if there are too many."""
        if len(self._clients) < self._max_clients:
            return
        idle = max(self._clients.values(), key=lambda client: client.idle_time)
        if not idle.idle_time:
            raise web.HTTPServiceUnavailable(text=FULL)
        await self._close(idle)

    async def _close(self, client: Client) -> None:
        self._clients.pop(client.token, None)
        try:
            await client.close()
        except Exception:  # the other clients must not be affected
            LOG.exception("a client could not be closed")

    @web.middleware
    async def _check_host(self, request: web.Request, handler: Handler) -> web.StreamResponse:
        if self.local_only and not _is_local(request.host):
            raise web.HTTPForbidden(text="Use the address 127.0.0.1 or localhost.")
        return await handler(request)

    def _client(self, request: web.Request) -> Client:
        client = self._clients.get(request.match_info["token"])
        if client is None:
            raise web.HTTPNotFound(text="This view has been closed.")
        return client

    async def _page(self, request: web.Request) -> web.StreamResponse:
        token = request.match_info["token"]
        client = self._clients.get(token)
        # The first page is sent without the cookie as well, as frames may not store cookies.
        browser = request.cookies.get(COOKIE)
        if client is None or (client.page_sent and client.browser != browser):
            # The client was closed, or belongs to another browser: make a new client.
            name = self._content_of.get(token, "")
            raise web.HTTPFound(f"../../a/{name}/" if name else "../../")
        client.page_sent = True
        return web.Response(text=_page_of(client), content_type="text/html")

    async def _socket(self, request: web.Request) -> web.StreamResponse:
        client = self._client(request)
        if not _is_same_origin(request):
            raise web.HTTPForbidden(text="Connections from other sites are not allowed.")
        socket = web.WebSocketResponse(
            max_msg_size=MAX_MESSAGE_BYTES, heartbeat=30.0, timeout=CLOSE_TIMEOUT
        )
        await socket.prepare(request)
        async with client.connected(socket) as receive:
            try:
                async for message in socket:
                    await receive(message)
            except MessageError as error:
                LOG.warning("a connection was closed after a malformed message: %s", error)
                await socket.close(code=WSCloseCode.POLICY_VIOLATION)
        return socket

    async def _labels(self, request: web.Request) -> web.StreamResponse:
        client = self._client(request)
        try:
            name, data = await client.labels_file()
        except GraspError as error:
            client.show_message(str(error))
            return web.Response(status=204)  # the browser stays on the page
        return _download(name, data, "application/octet-stream")

    async def _picture(self, request: web.Request) -> web.StreamResponse:
        client = self._client(request)
        try:
            name, picture = client.picture()
        except GraspError as error:
            client.show_message(str(error))
            return web.Response(status=204)
        data = io.BytesIO()
        Image.fromarray(picture).save(data, "PNG")
        return _download(name, data.getvalue(), "image/png")

    async def _file(self, request: web.Request) -> web.StreamResponse:
        name = request.match_info["name"]
        top, _, rest = name.partition("/")
        folders = {"own": Path(str(STATIC)), **self._client(request).folders}
        folder, rest = (folders[top], rest) if top in folders else (folders[""], name)
        path = (folder / rest).resolve()
        if not path.is_relative_to(folder.resolve()) or not path.is_file():
            raise web.HTTPNotFound(text="There is no such file.")
        return web.FileResponse(path)

    async def _cleanup(self, _: web.Application) -> AsyncIterator[None]:
        """Close idle clients while the server runs, and all clients when it ends."""
        task = asyncio.create_task(self._close_idle())
        yield
        task.cancel()
        for client in list(self._clients.values()):
            await self._close(client)

    async def _close_idle(self) -> None:
        while True:
            await asyncio.sleep(min(1.0, self._idle_timeout / 4.0))
            idle = [one for one in self._clients.values() if one.idle_time > self._idle_timeout]
            for client in idle:
                await self._close(client)


@web.middleware
async def _with_headers(request: web.Request, handler: Handler) -> web.StreamResponse:
    try:
        response = await handler(request)
    except web.HTTPException as answer:
        answer.headers.update(HEADERS)
        raise
    if not response.prepared:
        response.headers.update(HEADERS)
    return response


def _is_local(host: str) -> bool:
    """Whether a Host header is an IP address or localhost; other names may be rebound by DNS."""
    name = urlsplit(f"//{host}").hostname or ""
    try:
        ipaddress.ip_address(name)
    except ValueError:
        return name == "localhost"
    return True


def _is_same_origin(request: web.Request) -> bool:
    """Whether a request comes from a page of this server, directly or through a proxy."""
    origin = urlsplit(request.headers.get("Origin", "")).netloc
    return bool(origin) and origin in {request.host, request.headers.get("X-Forwarded-Host")}


def _page_of(client: Client) -> str:
    """The page, with the scripts and styles of trame's own page."""
    trame = (client.folders[""] / "index.html").read_text(encoding="utf-8")
    page = (Path(str(STATIC)) / "index.html").read_text(encoding="utf-8")
    return page.replace("TRAME", "\n    ".join(ASSETS.findall(trame)))


def _download(name: str, data: bytes, kind: str) -> web.Response:
    disposition = f"attachment; filename*=UTF-8''{quote(name)}"
    return web.Response(body=data, content_type=kind, headers={"Content-Disposition": disposition})
