"""The HTTP server: creates a client for every visitor and forwards requests to it."""

import asyncio
import contextlib
import gc
import ipaddress
import re
import secrets
import time
from collections import Counter
from collections.abc import AsyncIterator, Awaitable, Callable
from dataclasses import dataclass, field
from functools import cache
from urllib.parse import quote, urlsplit

from aiohttp import WSCloseCode, web
from aiohttp.typedefs import Handler

from grasp3d.errors import GraspError
from grasp3d.system.isolation.limits import return_memory
from grasp3d.viewer.session.session import Session
from grasp3d.viewer.web.client import LOG, MAX_MESSAGE_BYTES, Client, MessageError, static_folders
from grasp3d.viewer.web.connections import answering

MAX_CLIENTS = 16
MAX_VISITS, MAX_WAITING = 1000, 8
"""Largest number of known visits, and of those of one address that wait for their client."""
IDLE_TIMEOUT = 60.0
"""How long a client is kept without connections [s]."""
COOKIE = "grasp3d"
"""Cookie that identifies a browser; another browser with the same address gets its own client."""
CLOSE_TIMEOUT = 0.3
"""Longest wait for a browser to confirm that its connection is closed [s]."""

CLOSED = "This view has been closed."
FULL = "The viewer has too many visitors. Try again in a minute."
ASSETS = re.compile(r'<script type="module"[^>]*></script>|<link rel="stylesheet"[^>]*>')
"""Scripts and styles in trame's own page; their names change with its version."""

MAX_PATH = 1024
"""Largest number of characters of a path."""

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
    "Referrer-Policy": "no-referrer",  # the address contains the client's token
    "X-Content-Type-Options": "nosniff",
}


@dataclass(eq=False)
class Visit:
    """One visitor's page; what it shows is made when it connects."""

    content: str
    """Name of what it shows."""
    address: str
    browser: str
    """Identifier of its browser."""
    token: str = field(default_factory=lambda: secrets.token_hex(16))
    sent: bool = False
    """Whether the page was sent to a browser."""
    client: Client | None = None


class ViewerServer:
    """Gives every visitor a client of their own, at an address with a random token."""

    def __init__(self) -> None:
        """Make a server without content."""
        self.local_only = True
        """Refuse requests for other host names than localhost and IP addresses, as protection
        against DNS rebinding."""
        self._contents: dict[str, Callable[[], Session]] = {}
        self._visits: dict[str, Visit] = {}
        self._content_of: dict[str, str] = {}
        self._making = asyncio.Lock()
        self._waiting: Counter[str] = Counter()
        self._has_closed = False
        self.app = web.Application(middlewares=[_with_headers, self._answer])
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

    @property
    def _clients(self) -> list[tuple[Visit, Client]]:
        return [(one, one.client) for one in self._visits.values() if one.client is not None]

    async def _enter(self, request: web.Request) -> web.StreamResponse:
        """Note a new visit and redirect the browser to it."""
        name = request.match_info.get("content", "")
        if name not in self._contents:
            raise web.HTTPNotFound(text="There is no object here.")
        await self._make_room()
        browser = request.cookies.get(COOKIE) or secrets.token_hex(16)
        visit = Visit(name, request.remote or "", browser)
        self._visits[visit.token] = visit
        self._content_of[visit.token] = name
        self._forget_visits()
        response = web.HTTPFound(f"{'../../' if name else ''}s/{visit.token}/")
        response.set_cookie(COOKIE, browser, httponly=True, samesite="Lax")
        raise response

    def _forget_visits(self) -> None:
        """Forget the oldest visits that have no client if there are too many."""
        for known in (self._visits, self._content_of):
            extra = len(known) - MAX_VISITS
            for token in list(known)[: max(0, extra)]:
                if token not in self._visits or self._visits[token].client is None:
                    known.pop(token)

    async def _make_room(self) -> None:
        """Close a client if there are too many: one without connections, or without messages.

        Raises:
            HTTPServiceUnavailable: All are in use, each by another address.
        """
        clients = self._clients
        if len(clients) < MAX_CLIENTS:
            return
        visit, client = max(clients, key=lambda one: one[1].idle_time)
        if not client.idle_time:
            address, count = Counter(one.address for one, _ in clients).most_common(1)[0]
            if count == 1:
                raise web.HTTPServiceUnavailable(text=FULL)
            of_address = [one for one in clients if one[0].address == address]
            visit, _ = min(of_address, key=lambda one: one[1].last_used)
        await self._close(visit)

    async def _client_of(self, visit: Visit) -> Client:
        """The client of a visit, made now if there is none.

        Raises:
            HTTPServiceUnavailable: There is no room for it.
        """
        if visit.client is None:
            if self._waiting[visit.address] >= MAX_WAITING:
                raise web.HTTPServiceUnavailable(text=FULL)
            self._waiting[visit.address] += 1
            try:
                async with self._making:
                    await self._make_client(visit)
            finally:
                self._waiting[visit.address] -= 1
                self._waiting += Counter()  # only what is above 0
        if visit.client is None:
            raise web.HTTPNotFound(text=CLOSED)
        return visit.client

    async def _make_client(self, visit: Visit) -> None:
        if visit.client is None and visit.token in self._visits:
            await self._make_room()
            began = time.monotonic()
            visit.client = Client(visit.token, self._contents[visit.content]())
            await asyncio.sleep(time.monotonic() - began)  # half of the time is for the others

    async def _close(self, visit: Visit) -> None:
        self._visits.pop(visit.token, None)
        client, visit.client = visit.client, None
        try:
            if client is not None:
                self._has_closed = True
                await client.close()
        except Exception:  # noqa: BLE001 - the other clients must not be affected
            LOG.exception("a client could not be closed")

    @web.middleware
    async def _answer(self, request: web.Request, handler: Handler) -> web.StreamResponse:
        if self.local_only and not _is_local(request.host):
            raise web.HTTPForbidden(text="Use the address 127.0.0.1 or localhost.")
        with answering(request):
            return await handler(request)

    def _visit(self, request: web.Request) -> Visit:
        visit = self._visits.get(request.match_info["token"])
        if visit is None:
            raise web.HTTPNotFound(text=CLOSED)
        return visit

    def _client(self, request: web.Request) -> Client:
        client = self._visit(request).client
        if client is None:
            raise web.HTTPNotFound(text=CLOSED)
        return client

    async def _page(self, request: web.Request) -> web.StreamResponse:
        token = request.match_info["token"]
        visit = self._visits.get(token)
        # The first page is sent without the cookie as well, as frames may not store cookies.
        browser = request.cookies.get(COOKIE)
        if visit is None or (visit.sent and visit.browser != browser):
            # The client was closed, or belongs to another browser: make a new client.
            name = self._content_of.get(token, "")
            raise web.HTTPFound(f"../../a/{name}/" if name else "../../")
        visit.sent = True
        headers = {**HEADERS, "Content-Security-Policy": PAGE_POLICY}
        return web.Response(text=_page(), content_type="text/html", headers=headers)

    async def _socket(self, request: web.Request) -> web.StreamResponse:
        visit = self._visit(request)
        if not _is_same_origin(request):
            raise web.HTTPForbidden(text="Connections from other sites are not allowed.")
        socket = web.WebSocketResponse(
            max_msg_size=MAX_MESSAGE_BYTES, heartbeat=30.0, timeout=CLOSE_TIMEOUT
        )
        with contextlib.suppress(ConnectionError):  # the browser has gone meanwhile
            client = await self._client_of(visit)
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
        return await _download(client, client.labels_file(), "application/octet-stream")

    async def _picture(self, request: web.Request) -> web.StreamResponse:
        client = self._client(request)
        return await _download(client, client.picture_file(), "image/png")

    async def _file(self, request: web.Request) -> web.StreamResponse:
        name = request.match_info["name"]
        top, _, rest = name.partition("/")
        self._visit(request)
        folders = static_folders()
        folder, rest = (folders[top], rest) if top in folders else (folders[""], name)
        try:
            if len(name) > MAX_PATH:
                raise ValueError  # noqa: TRY301
            path = (folder / rest).resolve()
            found = path.is_relative_to(folder.resolve()) and path.is_file()
        except (OSError, ValueError):  # a null character, or a name that no file may have
            raise web.HTTPBadRequest(text="The path is malformed.") from None
        if not found:
            raise web.HTTPNotFound(text="There is no such file.")
        return web.FileResponse(path)

    async def _cleanup(self, _: web.Application) -> AsyncIterator[None]:
        """Close idle clients while the server runs, and all clients when it ends."""
        task = asyncio.create_task(self._close_idle())
        yield
        task.cancel()
        for visit in [one for one, _ in self._clients]:
            await self._close(visit)

    async def _close_idle(self) -> None:
        while True:
            await asyncio.sleep(min(1.0, IDLE_TIMEOUT / 4.0))
            clients = self._clients
            active = sum(client.is_active for _, client in clients)
            for _, client in clients:
                client.share_time(active - client.is_active)
            for visit, client in clients:
                if client.idle_time > IDLE_TIMEOUT:
                    await self._close(visit)
            if self._has_closed:
                self._has_closed = False
                if not self._clients:
                    gc.collect()  # what trame holds in cycles; nobody waits now
                return_memory()


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
    """Whether a Host header is an IP address or localhost; other names may be rebound by DNS.

    Raises:
        HTTPBadRequest: It is no host.
    """
    try:
        name = urlsplit(f"//{host}").hostname or ""
    except ValueError:
        raise web.HTTPBadRequest(text="The host is malformed.") from None
    try:
        ipaddress.ip_address(name)
    except ValueError:
        return name == "localhost"
    return True


def _is_same_origin(request: web.Request) -> bool:
    """Whether a request comes from a page of this server, directly or through a proxy."""
    try:
        origin = urlsplit(request.headers.get("Origin", "")).netloc
    except ValueError:
        return False
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
