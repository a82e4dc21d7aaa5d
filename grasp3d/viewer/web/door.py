"""The only thing that the network sees: lets visitors in, and each one only to their own visit."""

import asyncio
import io
import ipaddress
import logging
import re
import secrets
from collections.abc import AsyncIterator
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import quote, urlsplit

from aiohttp import WSMsgType, web
from aiohttp.typedefs import Handler
from PIL import Image

from grasp3d.errors import GraspError
from grasp3d.viewer.session.album import Album
from grasp3d.viewer.view_settings import ViewSettings
from grasp3d.viewer.web.visit import STATIC, Visit

LOG = logging.getLogger(__name__)

MOST_VISITS = 16
PATIENCE = 60.0
"""How long a visit waits for its visitor to come back [s]."""
COOKIE = "grasp3d"
"""Tells browsers apart, so that an address that was passed on begins a visit of its own."""
LONGEST_MESSAGE = 1 << 20
"""Of a browser [bytes]; it sends the moves of a mouse."""

FULL = "Too many people look at this at once. Try again in a minute."
ASSETS = re.compile(r'<script type="module"[^>]*></script>|<link rel="stylesheet"[^>]*>')
"""What trame's page loads; the names change with its version."""

HEADERS = {
    "Cache-Control": "no-store",
    "Content-Security-Policy": "default-src 'self' 'unsafe-inline' 'unsafe-eval' data: blob:; "
    "connect-src 'self' ws: wss:; object-src 'none'; base-uri 'self'",
    "Referrer-Policy": "no-referrer",  # the address is what lets a visitor in
    "X-Content-Type-Options": "nosniff",
}


@dataclass(frozen=True, eq=False)
class Offer:
    """What a visitor is to look at."""

    album: Album
    settings: ViewSettings


class FrontDoor:
    """Gives every visitor a visit of their own, under an address that nobody can guess."""

    def __init__(
        self, *, guarded: bool = True, most_visits: int = MOST_VISITS, patience: float = PATIENCE
    ) -> None:
        """Make a door that leads nowhere yet.

        Args:
            guarded: Let in only who asks for this very machine; otherwise another site whose name
                is led here could look.
            most_visits: How many there may be at once.
            patience: How long a visit waits for its visitor to come back [s].
        """
        self.guarded = guarded
        self._most_visits = most_visits
        self._patience = patience
        self._offers: dict[str, Offer] = {}
        self._visits: dict[str, Visit] = {}
        self._offer_of: dict[str, str] = {}
        self.app = web.Application(middlewares=[_with_headers, self._guard])
        self.app.add_routes([
            web.get("/", self._enter),
            web.get("/a/{offer}/", self._enter),
            web.get("/s/{token}/", self._page),
            web.get("/s/{token}/index.html", self._page),
            web.get("/s/{token}/ws", self._socket),
            web.get("/s/{token}/labels.ply", self._labels),
            web.get("/s/{token}/picture.png", self._picture),
            web.get("/s/{token}/{name:.+}", self._file),
        ])  # fmt: skip
        self.app.cleanup_ctx.append(self._tidying)

    def offer(self, album: Album, settings: ViewSettings, *, main: bool = False) -> str:
        """Offer something to look at; returns its path, '' for the main one."""
        name = "" if main else secrets.token_hex(16)
        self._offers[name] = Offer(album, settings)
        return f"a/{name}/" if name else ""

    async def _enter(self, request: web.Request) -> web.StreamResponse:
        name = request.match_info.get("offer", "")
        offer = self._offers.get(name)
        if offer is None:
            raise web.HTTPNotFound(text="There is nothing to look at here.")
        await self._make_room()
        visit = Visit(offer.album, offer.settings)
        self._visits[visit.token] = visit
        self._offer_of[visit.token] = name
        browser = request.cookies.get(COOKIE) or secrets.token_hex(16)
        visit.browser = browser
        answer = web.HTTPFound(f"{'../../' if name else ''}s/{visit.token}/")
        answer.set_cookie(COOKIE, browser, httponly=True, samesite="Lax")
        raise answer

    async def _make_room(self) -> None:
        """Where there are too many visits end the one that was left first, if any was."""
        if len(self._visits) < self._most_visits:
            return
        left = max(self._visits.values(), key=lambda visit: visit.alone_for)
        if not left.alone_for:
            raise web.HTTPServiceUnavailable(text=FULL)
        await self._end(left)

    async def _end(self, visit: Visit) -> None:
        self._visits.pop(visit.token, None)
        try:
            await visit.close()
        except Exception:  # one that does not end must not keep the others
            LOG.exception("a visit could not be closed")

    @web.middleware
    async def _guard(self, request: web.Request, handler: Handler) -> web.StreamResponse:
        if self.guarded and not _is_this_machine(request.host):
            raise web.HTTPForbidden(text="Ask for 127.0.0.1 or localhost.")
        return await handler(request)

    def _visit(self, request: web.Request) -> Visit:
        visit = self._visits.get(request.match_info["token"])
        if visit is None:
            raise web.HTTPNotFound(text="This visit has ended.")
        return visit

    async def _page(self, request: web.Request) -> web.StreamResponse:
        token = request.match_info["token"]
        visit = self._visits.get(token)
        # The first page is given without the cookie as well, which frames may not keep.
        browser = request.cookies.get(COOKIE)
        if visit is None or (visit.entered and visit.browser != browser):
            # It has ended, or is somebody else's: begin another one.
            name = self._offer_of.get(token, "")
            raise web.HTTPFound(f"../../a/{name}/" if name else "../../")
        visit.entered = True
        return web.Response(text=_page_of(visit), content_type="text/html")

    async def _socket(self, request: web.Request) -> web.StreamResponse:
        visit = self._visit(request)
        if not _is_own(request):
            raise web.HTTPForbidden(text="Another site's page must not look here.")
        socket = web.WebSocketResponse(max_msg_size=LONGEST_MESSAGE, heartbeat=30.0)
        await socket.prepare(request)
        async with visit.connected(socket) as link:
            async for message in socket:
                if message.type == WSMsgType.BINARY:
                    await link.send(True, message)  # noqa: FBT003
        return socket

    async def _labels(self, request: web.Request) -> web.StreamResponse:
        visit = self._visit(request)
        try:
            name, data = await visit.saved()
        except GraspError as error:
            visit.tell(str(error))
            return web.Response(status=204)  # the browser stays where it is
        return _download(name, data, "application/octet-stream")

    async def _picture(self, request: web.Request) -> web.StreamResponse:
        visit = self._visit(request)
        try:
            name, drawn = visit.shot()
        except GraspError as error:
            visit.tell(str(error))
            return web.Response(status=204)
        data = io.BytesIO()
        Image.fromarray(drawn).save(data, "PNG")
        return _download(name, data.getvalue(), "image/png")

    async def _file(self, request: web.Request) -> web.StreamResponse:
        name = request.match_info["name"]
        top, _, rest = name.partition("/")
        folders = {"own": Path(str(STATIC)), **self._visit(request).folders}
        folder, rest = (folders[top], rest) if top in folders else (folders[""], name)
        path = (folder / rest).resolve()
        if not path.is_relative_to(folder.resolve()) or not path.is_file():
            raise web.HTTPNotFound(text="There is no such file.")
        return web.FileResponse(path)

    async def _tidying(self, _: web.Application) -> AsyncIterator[None]:
        """End visits that nobody comes back to, and at last all of them."""
        task = asyncio.create_task(self._tidy())
        yield
        task.cancel()
        for visit in list(self._visits.values()):
            await self._end(visit)

    async def _tidy(self) -> None:
        while True:
            await asyncio.sleep(min(1.0, self._patience / 4.0))
            over = [visit for visit in self._visits.values() if visit.alone_for > self._patience]
            for visit in over:
                await self._end(visit)


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


def _is_this_machine(host: str) -> bool:
    """Whether a browser that asks for a host means a number, or this machine; names can be led."""
    name = urlsplit(f"//{host}").hostname or ""
    try:
        ipaddress.ip_address(name)
    except ValueError:
        return name == "localhost"
    return True


def _is_own(request: web.Request) -> bool:
    """Whether a request comes from a page of this server, as its address is seen by the browser."""
    origin = urlsplit(request.headers.get("Origin", "")).netloc
    return bool(origin) and origin in {request.host, request.headers.get("X-Forwarded-Host")}


def _page_of(visit: Visit) -> str:
    """Our page, with the script and the style of trame's own page."""
    theirs = (visit.folders[""] / "index.html").read_text(encoding="utf-8")
    ours = (Path(str(STATIC)) / "index.html").read_text(encoding="utf-8")
    return ours.replace("TRAME", "\n    ".join(ASSETS.findall(theirs)))


def _download(name: str, data: bytes, kind: str) -> web.Response:
    told = f"attachment; filename*=UTF-8''{quote(name)}"
    return web.Response(body=data, content_type=kind, headers={"Content-Disposition": told})
