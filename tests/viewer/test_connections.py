"""Connections to the viewer's page: how many, for how long, and what is written about them."""

import asyncio
import contextlib
import gc
import logging
import os
import weakref
from collections.abc import AsyncIterator, Coroutine
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import Any

import pytest

from grasp3d.rendering.opengl import can_render
from grasp3d.viewer.session.collection import collection_of
from grasp3d.viewer.session.session import Session
from grasp3d.viewer.web.page import listen, serving
from tests.helpers.viewing import box

pytestmark = pytest.mark.slow  # imports trame


def run(coroutine: Coroutine[Any, Any, None]) -> None:
    with ThreadPoolExecutor(1) as executor:  # another test may have a loop in this thread
        executor.submit(asyncio.run, coroutine).result()


@pytest.fixture
def _opengl() -> None:
    if not can_render():
        if os.environ.get("CI") == "true":
            pytest.fail("the page's tests need OpenGL")
        pytest.skip("needs OpenGL")
    os.environ["TRAME_ARGS"] = ""


@contextlib.asynccontextmanager
async def served(server: Any) -> AsyncIterator[int]:
    """Serve at a free port, as the viewer does; yields the port."""
    with contextlib.closing(listen("127.0.0.1", 0)) as listener:
        async with serving(server, listener):
            yield listener.getsockname()[1]


def new_server() -> Any:
    from grasp3d.viewer.web.server import ViewerServer

    server = ViewerServer()
    server.add(partial(Session, collection_of(box())), main=True)
    return server


async def answer(port: int, path: str, host: str = "localhost") -> tuple[int, str]:
    """Status and headers of the answer to a request."""
    reader, writer = await asyncio.open_connection("127.0.0.1", port)
    writer.write(f"GET {path} HTTP/1.1\r\nHost: {host}\r\nConnection: close\r\n\r\n".encode())
    got = (await reader.read()).decode()
    await closed(writer)
    return int(got.split()[1]), got.partition("\r\n\r\n")[0]


async def closed(*writers: asyncio.StreamWriter) -> None:
    for writer in writers:
        writer.close()
        with contextlib.suppress(ConnectionError):
            await writer.wait_closed()


async def is_closed(reader: asyncio.StreamReader) -> bool:
    """Whether the server closes a connection within a short time."""
    try:
        return await asyncio.wait_for(reader.read(), 2.0) == b""
    except ConnectionError:
        return True
    except TimeoutError:
        return False


def test_connections_that_idle_are_closed(monkeypatch: pytest.MonkeyPatch) -> None:
    from grasp3d.viewer.web import connections

    monkeypatch.setattr(connections, "IDLE_CONNECTION", 0.2)

    async def attack() -> None:
        async with served(new_server()) as port:
            silent, one = await asyncio.open_connection("127.0.0.1", port)
            half, other = await asyncio.open_connection("127.0.0.1", port)
            other.write(b"GET / HTTP/1.1\r\nHost: local")
            assert await is_closed(silent)
            assert await is_closed(half)
            await closed(one, other)

    run(attack())


def test_the_oldest_connection_of_an_address_gives_way(monkeypatch: pytest.MonkeyPatch) -> None:
    from grasp3d.viewer.web import connections

    monkeypatch.setattr(connections, "MAX_PER_ADDRESS", 3)

    async def attack() -> None:
        async with served(new_server()) as port:
            made = [await asyncio.open_connection("127.0.0.1", port) for _ in range(5)]
            assert (await answer(port, "/"))[0] == 302
            assert [reader.at_eof() for reader, _ in made] == [True, True, True, False, False]
            await closed(*(writer for _, writer in made))

    run(attack())


@pytest.mark.parametrize(
    ("path", "host", "status"),
    [
        ("/s/TOKEN/%00", "localhost", 400),
        ("/s/TOKEN/own/%00", "localhost", 400),
        ("/s/TOKEN/" + "a" * 5000, "localhost", 400),
        ("/s/TOKEN/" + "a" * 300, "localhost", 400),
        ("/s/TOKEN/own/page.css", "localhost", 200),
        ("/s/TOKEN/%ff", "localhost", 404),
        ("/", "[::1", 400),
        ("/", "evil.example", 403),
        ("/", "[::1]:80", 302),
    ],
)
def test_malformed_requests_are_answered_without_a_line_in_the_log(
    path: str, host: str, status: int, caplog: pytest.LogCaptureFixture
) -> None:
    async def attack() -> None:
        async with served(new_server()) as port:
            _, headers = await answer(port, "/")
            token = headers.partition("Location: s/")[2][:32]
            got, headers = await answer(port, path.replace("TOKEN", token), host)
            assert got == status
            assert "Content-Security-Policy: default-src 'none'" in headers

    run(attack())
    assert not caplog.records


def test_only_the_page_may_evaluate_and_nothing_runs_inline() -> None:
    from grasp3d.viewer.web.server import PAGE_POLICY, _page

    async def visit() -> None:
        async with served(new_server()) as port:
            _, headers = await answer(port, "/")
            _, headers = await answer(port, f"/{headers.partition('Location: ')[2][:35]}")
            assert PAGE_POLICY in headers

    run(visit())
    scripts = PAGE_POLICY.partition("script-src ")[2].partition(";")[0]
    assert scripts == "'self' 'unsafe-eval'"
    assert "<script>" not in _page()


@pytest.mark.usefixtures("_opengl")
def test_the_page_that_is_used_least_gives_way_to_another_of_its_address(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    import aiohttp

    monkeypatch.setattr("grasp3d.viewer.web.server.MAX_CLIENTS", 2)

    async def attack() -> None:
        server = new_server()
        async with served(server) as port, aiohttp.ClientSession() as browser:
            own = f"http://127.0.0.1:{port}"
            links = []
            for _ in range(3):
                page = await browser.get(f"{own}/")
                assert page.status == 200
                links.append(await browser.ws_connect(f"{page.url}ws", headers={"Origin": own}))
            closed = await links[0].receive(5.0)
            assert closed.type in {aiohttp.WSMsgType.CLOSE, aiohttp.WSMsgType.CLOSED}
            with pytest.raises(TimeoutError):
                await links[2].receive(0.2)

    run(attack())


@pytest.mark.usefixtures("_opengl")
def test_what_a_closed_page_showed_is_released_at_once() -> None:
    from grasp3d.viewer.web.client import Client

    async def visit() -> None:
        client = Client("token", Session(collection_of(box())))
        parts = (client.session, client._scene, client._plotter)  # noqa: SLF001
        released = [weakref.ref(part) for part in parts]
        del parts
        await asyncio.wait_for(client.close(), 5.0)  # even if trame has only just started
        client.show_message("too late")
        await asyncio.sleep(0.0)
        assert [one() for one in released] == [None, None, None]

    gc.collect()
    gc.disable()
    try:
        run(visit())
    finally:
        gc.enable()


def test_the_log_has_few_lines_without_tracebacks(
    caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    from grasp3d.viewer.web import client

    terse = client.Terse()
    log = logging.getLogger("grasp3d.test of terse lines")
    log.addFilter(terse)
    for number in range(100):
        error = ValueError(f"first line\nand second {number}")
        log.error("a request of %s", "somebody\n", exc_info=error)
    assert len(caplog.records) == client.MOST_LINES
    assert caplog.messages[0] == "a request of somebody: ValueError: first line and second 0"
    assert "Traceback" not in caplog.text
    monkeypatch.setattr(terse, "_began", -client.LOG_PERIOD)
    log.error("later")
    assert caplog.messages[-1] == "later (and 70 more lines before that were not written)"
