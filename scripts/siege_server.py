"""Besiege the viewer's page: `python scripts/siege_server.py [MESH] [--visits 1000]`.

Starts `grasp3d view MESH --web` with few open files and a log, and treats it badly, on loopback
only and for a bounded time: connections that never ask, visitors who never rest, what is no HTTP
and no message, foreign hosts, 100 MB where a line belongs, many visits. All the while a new
visitor asks for the page once a second. Prints how long that took, the server's memory and its
log, and ends with 1 if a page took longer than 2 s, memory grew by 200 MB or the log holds a
traceback.
"""

import argparse
import asyncio
import contextlib
import os
import re
import resource
import shutil
import struct
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Awaitable, Callable, Iterator
from dataclasses import dataclass, field
from http.client import HTTPConnection, HTTPException
from pathlib import Path
from typing import Any

import aiohttp
import msgpack  # type: ignore[import-untyped]
import psutil

MESH = Path(__file__).parents[1] / "meshes" / "spray.glb"
OPEN_FILES = 1024
"""Limit of the server's open files: what most systems begin with."""
PATIENCE, PAUSE = 2.0, 1.0
"""Longest wait for a page, and time between two new visitors [s]."""
GROWTH = 200.0
"""Largest growth of memory over all visits [MB]."""
LONG = 100_000_000
FORGOTTEN = 75.0
"""Time after which a view without a page is closed [s]."""
PATHS = (
    "/s/TOKEN/%00", "/s/TOKEN/own/%00", "/s/TOKEN/" + "a" * 5000, "/s/TOKEN/" + "a/" * 2500,
    "/s/TOKEN/../../../etc/passwd", "/s/TOKEN/own/%2e%2e/client.py", "/" + "%ff" * 50,
    "/s/%00/", "/a/%00/", "//", "/s/TOKEN/own//etc/passwd", "/s/TOKEN/" + "%F0%9F%98%80" * 100,
)  # fmt: skip
HOSTS = ("[::1", "evil.example", "a" * 3000, "[", "127.0.0.1:x", "[::1]]", "\x80", "")
NO_HTTP = (
    b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03", b"GET / HTTP/9.9\r\n\r\n", b"\r\n" * 1000,
    b"GET / HTTP/1.1\r\nContent-Length: -1\r\n\r\n", b"GET\x00/ HTTP/1.1\r\n\r\n", bytes(1000),
    b"GET / HTTP/1.1\r\nHost: localhost\r\n" + b"a: b\r\n" * 2000 + b"\r\n",
    b"GET / HTTP/1.1\r\nHost: localhost\r\na: " + b"b" * 100_000 + b"\r\n\r\n",
    b"POST / HTTP/1.1\r\nHost: localhost\r\nTransfer-Encoding: chunked\r\n\r\nzz\r\n",
    b"GET http://[::1 HTTP/1.1\r\nHost: localhost\r\n\r\n",
    b"GET /s/a/ws HTTP/1.1\r\nHost: localhost\r\nUpgrade: websocket\r\n\r\n",
)  # fmt: skip


@dataclass
class Besieged:
    """The server, with what new visitors see of it."""

    process: psutil.Process
    port: int
    log: Path
    waits: list[float] = field(default_factory=list)
    refusals: list[str] = field(default_factory=list)
    over: threading.Event = field(default_factory=threading.Event)

    @property
    def address(self) -> str:
        """Its address."""
        return f"http://127.0.0.1:{self.port}"

    @property
    def memory(self) -> float:
        """Resident memory [MB]."""
        return float(self.process.memory_info().rss) / 1e6

    def visit_now_and_then(self) -> None:
        """Ask for the page like a new browser, again and again, and note how long it takes."""
        while not self.over.wait(PAUSE):
            began = time.monotonic()
            try:
                problem = self._visited()
            except (OSError, HTTPException) as error:
                problem = f"{type(error).__name__}: {error}"
            self.waits.append(time.monotonic() - began)
            if problem:
                self.refusals.append(problem)

    def _visited(self) -> str:
        """Follow the address of the page; why there is none."""
        path = "/"
        for _ in range(3):
            link = HTTPConnection("127.0.0.1", self.port, timeout=10.0)
            with contextlib.closing(link):
                link.request("GET", path)
                answer = link.getresponse()
                page = answer.read()
                if answer.status != 302:
                    return "" if answer.status == 200 and b"app" in page else f"{answer.status}"
                path = "/" + (answer.getheader("Location") or "").replace("../", "")
        return "redirected in a circle"

    def report(self, name: str, since: int = 0, **figures: object) -> None:
        """Print one line."""
        waits = self.waits[since:] or [0.0]
        figures = {
            "page after": f"{max(waits):.2f} s at most ({len(waits)} new visitors)",
            "memory": f"{self.memory:.0f} MB",
            "log": f"{self.log.stat().st_size:,} bytes",
            **figures,
        }
        print(f"{name}: " + ", ".join(f"{key} {value}" for key, value in figures.items()))
        sys.stdout.flush()

    @contextlib.asynccontextmanager
    async def browser(self) -> Any:
        """A browser with cookies of its own."""
        connector = aiohttp.TCPConnector(limit=0)
        wait = aiohttp.ClientTimeout(total=10.0)
        async with aiohttp.ClientSession(connector=connector, timeout=wait) as session:
            yield session

    async def page(self, session: aiohttp.ClientSession) -> str:
        """Ask for the page; its address, '' if it was refused."""
        async with session.get(f"{self.address}/") as answer:
            await answer.read()
            return str(answer.url) if answer.status == 200 else ""

    async def raw(self, data: bytes, wait: float = 20.0) -> bytes:
        """Send bytes; returns what comes back until the server closes the connection."""
        reader, writer = await asyncio.open_connection("127.0.0.1", self.port)
        got = b""
        with contextlib.suppress(ConnectionError, TimeoutError):
            writer.write(data)
            await asyncio.wait_for(writer.drain(), wait)
            while part := await asyncio.wait_for(reader.read(65536), wait):
                got += part
        writer.close()
        return got


def call(method: str, *args: object, number: str = "rpc:1") -> bytes:
    """A message as wslink packs it."""
    content: bytes = msgpack.packb({"id": number, "method": method, "args": list(args)})
    return struct.pack("<III", 7, 0, len(content)) + content


HELLO = call("wslink.hello", {"secret": "wslink-secret"}, number="system:1")
BROKEN = (
    b"", b"\xff" * 20, HELLO[:-3], struct.pack("<III", 7, 0, 1 << 31), call("no.such.method"),
    call("trame.trigger"), call("trame.rca.event", "view", "o", 5), HELLO * 3,
    call("trame.rca.event", "view", "o", {"type": "MouseMove"}),
    call("trame.rca.event", "view", "o", {"type": "MouseMove", "x": float("nan"), "y": "a"}),
    call("trame.rca.event", "view", "o", {"type": "Pinch"}),
    call("trame.rca.event", "view", "o", {"type": "StartPan", "translation": [1]}),
    call("trame.rca.event", "nothing", "o", {"type": "MouseMove"}),
    call("trame.rca.size", "view", "o", {"w": 1e9, "h": 1e9, "p": 1e9}),
    call("trame.rca.size", "view", "o", {"w": 4_000_000, "h": 1, "p": 1}),
    call("trame.rca.size", "view", "o", {"w": "a", "h": None}),
)  # fmt: skip


@contextlib.contextmanager
def besieged(mesh: Path, folder: Path) -> Iterator[Besieged]:
    """Run the server, and new visitors who ask for its page."""
    log = folder / "log"
    command = [shutil.which("grasp3d") or "grasp3d", "view", str(mesh), "--web", "--port", "0"]

    with log.open("wb") as errors:
        server = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=errors, text=True)  # noqa: S603
    psutil.Process(server.pid).rlimit(psutil.RLIMIT_NOFILE, (OPEN_FILES, OPEN_FILES))
    assert server.stdout is not None
    found = re.search(r"http://127\.0\.0\.1:(\d+)/", server.stdout.readline())
    if found is None:
        server.kill()
        raise SystemExit(log.read_text())
    one = Besieged(psutil.Process(server.pid), int(found[1]), log)
    visitor = threading.Thread(target=one.visit_now_and_then)
    visitor.start()
    try:
        yield one
    finally:
        one.over.set()
        visitor.join()
        server.terminate()
        server.wait(30)


async def idle(one: Besieged, seconds: float) -> str:
    """2,000 connections that never ask, or never end their question."""
    made = []

    async def connect(number: int) -> None:
        with contextlib.suppress(OSError, TimeoutError):
            link = await asyncio.wait_for(asyncio.open_connection("127.0.0.1", one.port), 10.0)
            link[1].write(b"GET / HTTP/1.1\r\nHost: local" if number % 2 else b"")
            made.append(link)

    for first in range(0, 2000, 500):
        await asyncio.gather(*(connect(first + number) for number in range(500)))
    await asyncio.sleep(seconds)
    kept = sum(not (reader.at_eof() or reader.exception()) for reader, _ in made)
    for _, writer in made:
        writer.close()
    return f"{len(made)} made, {kept} still open after {seconds:.0f} s"


async def busy(one: Besieged, seconds: float) -> str:
    """200 visitors who drag the object, ask for files and come again."""
    until, counts = time.monotonic() + seconds, {"pages": 0, "messages": 0, "refused": 0}

    async def visitor() -> None:
        while time.monotonic() < until:
            with contextlib.suppress(aiohttp.ClientError, TimeoutError, OSError):
                async with one.browser() as session:
                    await visit(one, session, counts, until)
            await asyncio.sleep(0.1)

    await asyncio.gather(*(visitor() for _ in range(200)))
    return ", ".join(f"{value} {name}" for name, value in counts.items())


async def visit(
    one: Besieged, session: aiohttp.ClientSession, counts: dict[str, int], until: float
) -> None:
    """Open the page, and drag the object until a time or until the server has enough of it."""
    address = await one.page(session)
    counts["pages" if address else "refused"] += 1
    if not address:
        return
    await (await session.get(f"{address}own/page.css")).read()
    async with session.ws_connect(f"{address}ws", headers={"Origin": one.address}) as link:
        await link.send_bytes(HELLO)
        await link.send_bytes(call("trame.rca.size", "view", "o", {"w": 800, "h": 600, "p": 1}))
        position = 100
        while time.monotonic() < until and not link.closed:
            position = 100 + (position + 7) % 300
            event = {"type": "MouseMove", "x": position, "y": position, "w": 800, "h": 600}
            await link.send_bytes(call("trame.rca.event", "view", "o", event))
            counts["messages"] += 1
            with contextlib.suppress(TimeoutError):
                await link.receive(0.02)


async def malformed(one: Besieged) -> str:
    """What is no HTTP, no path, no host and no message."""
    async with one.browser() as session:
        address = await one.page(session)
        path = address.removeprefix(one.address)
        statuses: list[str] = []
        for _ in range(5):
            requests = [
                *NO_HTTP,
                *(request(bad.replace("/s/TOKEN/", path), "127.0.0.1") for bad in PATHS),
                *(request("/", host) for host in HOSTS),
            ]
            answers = await asyncio.gather(*map(one.raw, requests), return_exceptions=True)
            statuses += [status(answer) for answer in answers if isinstance(answer, bytes)]
            for data in BROKEN:
                with contextlib.suppress(aiohttp.ClientError, TimeoutError):
                    origin = {"Origin": one.address}
                    async with session.ws_connect(f"{address}ws", headers=origin) as link:
                        await link.send_bytes(HELLO)
                        await link.send_bytes(data)
                        await link.receive(0.2)
                        await link.send_str(str(data))
    return ", ".join(f"{name}: {statuses.count(name)}" for name in sorted(set(statuses)))


def request(path: str, host: str) -> bytes:
    """A request."""
    return f"GET {path} HTTP/1.1\r\nHost: {host}\r\nConnection: close\r\n\r\n".encode("latin-1")


def status(answer: bytes) -> str:
    """The status of an answer."""
    found = re.match(rb"HTTP/1\.\d (\d+)", answer)
    return found[1].decode() if found else "closed"


async def foreign(one: Besieged) -> str:
    """Pages of other hosts, directly and by the socket."""
    opened = 0
    async with one.browser() as session:
        address = await one.page(session)
        for number in range(200):
            async with session.get(address, headers={"Host": f"evil{number}.example"}) as answer:
                opened += answer.status != 403
            with contextlib.suppress(aiohttp.ClientError):
                origin = {"Origin": f"http://evil{number}.example"}
                async with session.ws_connect(f"{address}ws", headers=origin):
                    opened += 1
    return f"{opened} of 400 let in"


async def large(one: Besieged) -> str:
    """100 MB in a body, in a header and in a message."""
    peak = one.memory
    async with one.browser() as session:
        address = await one.page(session)

        async def body() -> None:
            head = f"POST / HTTP/1.1\r\nHost: localhost\r\nContent-Length: {LONG}\r\n\r\n".encode()
            await one.raw(head + bytes(LONG))

        async def header() -> None:
            await one.raw(b"GET / HTTP/1.1\r\na: " + b"b" * LONG)

        async def message() -> None:
            with contextlib.suppress(aiohttp.ClientError, ConnectionError):
                origin = {"Origin": one.address}
                async with session.ws_connect(f"{address}ws", headers=origin) as link:
                    await link.send_bytes(HELLO)
                    await link.send_bytes(bytes(LONG))
                    await link.receive(20.0)

        for attack in (body, header, message):
            task = asyncio.create_task(attack())
            while not task.done():
                peak = max(peak, one.memory)
                await asyncio.sleep(0.05)
            await task
    return f"{peak:.0f} MB at most"


async def visits(one: Besieged, count: int) -> str:
    """Visitors who look at one picture and go, one after the other."""
    pictures, began = 0, time.monotonic()
    for _ in range(count):
        with contextlib.suppress(aiohttp.ClientError, TimeoutError):
            async with one.browser() as session:
                address = await one.page(session)
                if not address:
                    continue
                origin = {"Origin": one.address}
                async with session.ws_connect(f"{address}ws", headers=origin) as link:
                    await link.send_bytes(HELLO)
                    size = {"w": 800, "h": 600, "p": 1}
                    await link.send_bytes(call("trame.rca.size", "view", "o", size))
                    while len((await link.receive(5.0)).data or b"") < 5000:
                        pass  # what is not the picture
                    pictures += 1
    return f"{pictures} pictures in {time.monotonic() - began:.0f} s"


async def siege(one: Besieged, count: int, seconds: float) -> bool:
    """Run all attacks; whether the server withstood them."""
    await asyncio.sleep(3.0)
    attacks: dict[str, Callable[[], Awaitable[str]]] = {
        "2,000 idle connections": lambda: idle(one, seconds),
        "200 busy visitors": lambda: busy(one, seconds),
        "malformed requests and messages": lambda: malformed(one),
        "foreign hosts": lambda: foreign(one),
        "100 MB at once": lambda: large(one),
        "50 visits": lambda: visits(one, 50),
        f"{count:,} visits": lambda: visits(one, count),
    }
    one.report("before")
    start = 0.0
    for name, attack in attacks.items():
        start, since, refused = one.memory, len(one.waits), len(one.refusals)
        result = await attack()
        await asyncio.sleep(2.0 * PAUSE)
        seen = one.refusals[refused:]
        one.report(name, since, seen=result, refused=f"{len(seen)} {sorted(set(seen))[:3]}")
    one.over.set()
    await asyncio.sleep(FORGOTTEN)
    grown = one.memory - start
    traces = one.log.read_text(errors="replace").count("Traceback")
    figures = f"{grown:+.0f} MB by {count:,} visits"
    one.report("after all have left", seen=figures, tracebacks=traces)
    slow = sum(wait > PATIENCE for wait in one.waits)
    print(f"{slow + len(one.refusals)} of {len(one.waits)} new visitors had no page within 2 s")
    return not slow and not one.refusals and grown < GROWTH and not traces


def main() -> None:
    """Run the siege."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("mesh", type=Path, nargs="?", default=MESH)
    parser.add_argument("--visits", type=int, default=1000)
    parser.add_argument("--seconds", type=float, default=20.0, help="of the first two attacks")
    options = parser.parse_args()
    _, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (hard, hard))
    os.environ.pop("PYTHONUNBUFFERED", None)
    with tempfile.TemporaryDirectory() as folder, besieged(options.mesh, Path(folder)) as one:
        withstood = asyncio.run(siege(one, options.visits, options.seconds))
    raise SystemExit(0 if withstood else 1)


if __name__ == "__main__":
    main()
