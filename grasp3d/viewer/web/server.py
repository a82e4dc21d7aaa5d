"""The HTTP server of the viewer's pages, for one user on this machine."""

import asyncio
import contextlib
import ipaddress
import re
import secrets
from collections.abc import AsyncIterator, Awaitable, Callable
from functools import cache
from urllib.parse import quote, urlsplit

from aiohttp import web
from aiohttp.typedefs import Handler

from grasp3d.errors import GraspError
from grasp3d.viewer.session.session import Session
from grasp3d.viewer.web.client import Client, static_folders

CLOSE_TIMEOUT = 0.3
"""Longest wait for a browser to confirm that its connection is closed [s]."""

CLOSED = "There is no object here: this view has been closed."
ASSETS = re.compile(r'<script type="module"[^>]*></script>|<link rel="stylesheet"[^>]*>')
"""Scripts and styles in trame's own page; their names change with its version."""

PAGE_POLICY = (
    # Vue compiles the templates that trame sends, for which it needs unsafe-eval, and Vuetify adds
    # styles to the page, for which it needs unsafe-inline.
    "default-src 'none'; script-src 'self' 'unsafe-eval'; style-src 'self' 'unsafe-inline'; "
    "img-src 'self' data: blob:; font-src 'self' data:; connect-src 'self' ws: wss:; "
    "base-uri 'self'; form-action 'none'"
)
HEADERS = {
    "Cache-Control": "no-store",
    "Content-Security-Policy": "default-src 'none'",
    "Referrer-Policy": "no-referrer",  # the address contains the page's token
    "X-Content-Type-Options": "nosniff",
}


class ViewerServer:
    """Serves each view at an address with a random token; `/` leads to the first one.

    A view has one client, which all windows of a browser share. It is kept when the page is loaded
    again, until another view is opened.
    """

    def __init__(self) -> None:
        """Make a server without content."""
        self.local_only = True
        """Refuse requests for other host names than localhost and IP addresses, as protection
        against DNS rebinding."""
        self._contents: dict[str, Callable[[], Session]] = {}
        self._clients: dict[str, Client] = {}
        self._making = asyncio.Lock()
        self.app = web.Application(middlewares=[_with_headers, self._check_host])
        self.app.add_routes([
            web.get("/", self._enter),
            web.get("/a/{token}/", self._page),
            web.get("/a/{token}/ws", self._socket),
            web.get("/a/{token}/labels.ply", self._labels),
            web.get("/a/{token}/picture.png", self._picture),
            web.get("/a/{token}/{name:.+}", self._file),
        ])  # fmt: skip
        self.app.cleanup_ctx.append(self._cleanup)

    def add(self, start: Callable[[], Session]) -> str:
        """Add a view.

        Args:
            start: Starts its session.

        Returns:
            Its path.
        """
        token = secrets.token_hex(16)
        self._contents[token] = start
        return f"a/{token}/"

    async def _enter(self, _: web.Request) -> web.StreamResponse:
        for token in self._contents:
            raise web.HTTPFound(f"a/{token}/")
        raise web.HTTPNotFound(text=CLOSED)

    async def _client_of(self, token: str) -> Client:
        """The client of a view, made now if there is none."""
        async with self._making:
            if token not in self._clients:
                for other in [one for one, client in self._clients.items() if not client.is_used]:
                    await self._clients.pop(other).close()
                self._clients[token] = Client(token, self._contents[token]())
            return self._clients[token]

    @web.middleware
    async def _check_host(self, request: web.Request, handler: Handler) -> web.StreamResponse:
        if self.local_only and not _is_local(request.host):
            raise web.HTTPForbidden(text="Use the address 127.0.0.1 or localhost.")
        return await handler(request)

    def _token(self, request: web.Request) -> str:
        token = request.match_info["token"]
        if token not in self._contents:
            raise web.HTTPNotFound(text=CLOSED)
        return token

    def _client(self, request: web.Request) -> Client:
        client = self._clients.get(self._token(request))
        if client is None:
            raise web.HTTPNotFound(text=CLOSED)
        return client

    async def _page(self, request: web.Request) -> web.StreamResponse:
        self._token(request)
        headers = {**HEADERS, "Content-Security-Policy": PAGE_POLICY}
        return web.Response(text=_page(), content_type="text/html", headers=headers)

    async def _socket(self, request: web.Request) -> web.StreamResponse:
        token = self._token(request)
        if not _is_same_origin(request):
            raise web.HTTPForbidden(text="Connections from other sites are not allowed.")
        socket = web.WebSocketResponse(heartbeat=30.0, timeout=CLOSE_TIMEOUT)
        with contextlib.suppress(ConnectionError):  # the browser has gone meanwhile
            await socket.prepare(request)
            client = await self._client_of(token)
            async with client.connected(socket) as receive:
                async for message in socket:
                    await receive(message)
        return socket

    async def _labels(self, request: web.Request) -> web.StreamResponse:
        client = self._client(request)
        return await _download(client, client.labels_file(), "application/octet-stream")

    async def _picture(self, request: web.Request) -> web.StreamResponse:
        client = self._client(request)
        return await _download(client, client.picture_file(), "image/png")

    async def _file(self, request: web.Request) -> web.StreamResponse:
        self._token(request)
        name = request.match_info["name"]
        top, _, rest = name.partition("/")
        folders = static_folders()
        folder, rest = (folders[top], rest) if top in folders else (folders[""], name)
        path = (folder / rest).resolve()
        if not (path.is_relative_to(folder.resolve()) and path.is_file()):
            raise web.HTTPNotFound(text="There is no such file.")
        return web.FileResponse(path)

    async def _cleanup(self, _: web.Application) -> AsyncIterator[None]:
        """Close all clients when the server ends."""
        yield
        for client in self._clients.values():
            await client.close()


@web.middleware
async def _with_headers(request: web.Request, handler: Handler) -> web.StreamResponse:
    try:
        response = await handler(request)
    except web.HTTPException as answer:
        answer.headers.update(HEADERS)
        raise
    if not response.prepared:
        response.headers.update({**HEADERS, **response.headers})
    return response


def _is_local(host: str) -> bool:
    """Whether a Host header is an IP address or localhost; other names may be rebound by DNS."""
    try:
        name = urlsplit(f"//{host}").hostname or ""
        return name == "localhost" or bool(ipaddress.ip_address(name))
    except ValueError:
        return False


def _is_same_origin(request: web.Request) -> bool:
    """Whether a request comes from a page of this server, directly or through a proxy."""
    _, _, origin = request.headers.get("Origin", "").partition("://")
    return bool(origin) and origin in {request.host, request.headers.get("X-Forwarded-Host")}


@cache
def _page() -> str:
    """The page, with the scripts and styles of trame's own page."""
    folders = static_folders()
    trame = (folders[""] / "index.html").read_text(encoding="utf-8")
    page = (folders["own"] / "index.html").read_text(encoding="utf-8")
    return page.replace("TRAME", "\n    ".join(ASSETS.findall(trame)))


async def _download(
    client: Client, made: Awaitable[tuple[str, bytes]], kind: str
) -> web.StreamResponse:
    """A file of a client; without one the browser stays on the page, which says why."""
    try:
        name, data = await made
    except GraspError as error:
        client.show_message(str(error))
        return web.Response(status=204)
    disposition = f"attachment; filename*=UTF-8''{quote(name)}"
    return web.Response(body=data, content_type=kind, headers={"Content-Disposition": disposition})
