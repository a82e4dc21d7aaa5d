"""Malformed messages to the viewer's page, over a raw socket."""

import os
import re
import socket
import struct
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import aiohttp
import msgpack
import pytest

from grasp3d.rendering.opengl import can_render

SERVER = """
from math import radians
from grasp3d import Sampling, label_surface
from grasp3d.mesh.primitives import box_mesh
from grasp3d.viewer.session.collection import collection_of
from grasp3d.viewer.web.page import serve
from grasp3d.viewer.view_settings import ViewSettings
labels = label_surface(box_mesh((0.1, 0.2, 0.3), max_edge=0.1), sampling=Sampling(rays=8))
serve(collection_of(labels), ViewSettings(), port=0, ready=lambda one: print(one, flush=True))
"""
SECRET = {"secret": "wslink-secret"}
LOGGED = "a connection was closed after a malformed message: "


def frame(payload: bytes, opcode: int = 2, length: int | None = None) -> bytes:
    """A frame of a web socket; `length` is what it promises."""
    count, mask = len(payload) if length is None else length, bytes(4)
    size = bytes([0x80 | 127]) + struct.pack(">Q", count)
    return bytes([0x80 | opcode]) + size + mask + payload


def chunk(content: bytes, length: int | None = None) -> bytes:
    """A message as wslink packs it; `length` is what it promises."""
    return struct.pack("<III", 7, 0, len(content) if length is None else length) + content


def call(method: object, *args: object, number: object = "rpc:1") -> bytes:
    return chunk(msgpack.packb({"id": number, "method": method, "args": list(args)}))


def event(**values: object) -> bytes:
    return frame(call("trame.rca.event", "view", "origin", values))


HELLO = frame(call("wslink.hello", SECRET, number="system:1"))
MALFORMED = {
    "a frame of 4 GB": frame(b"abc", length=1 << 32),
    "text": frame(b"{nonsense", opcode=1),
    "text that is no text": frame(b"\xff\xfe", opcode=1),
    "an unknown kind of frame": frame(b"x", opcode=5),
    "JSON": frame(b'{"id": "rpc:1", "method": "trame.trigger"}'),
    "nothing": frame(b""),
    "4 GB in parts": HELLO + frame(chunk(b"abc", length=(1 << 32) - 1)),
    "half a message": HELLO + frame(chunk(b"abc", length=100)),
    "nested too deeply": HELLO + frame(chunk(b"\x91" * 5000 + b"\x01")),
    "an unknown method": HELLO + frame(call("no.such.method")),
    "no method": HELLO + frame(call(5)),
    "too few arguments": HELLO + frame(call("trame.trigger")),
    "wrong arguments": HELLO + frame(call("trame.trigger", "step", ["x"], {})),
    "a wrong event": HELLO + frame(call("trame.rca.event", "view", "o", 5)),
    "a picture that is not there": HELLO + frame(call("trame.rca.event", "no", "o", {})),
    "an event without numbers": HELLO + event(type="MouseMove", x="a"),
    "a gesture of no fingers": HELLO + event(type="Pinch", positions=5),
    "half a translation": HELLO + event(type="Pan", translation=[1]),
    "a wrong state": HELLO + frame(call("trame.state.update", [1, 2])),
}


@dataclass
class Served:
    """A server in a child process, with its log."""

    address: str
    log: Path

    def request(self, path: str, *headers: str) -> tuple[socket.socket, bytes]:
        """Send a request; returns the connection, and the head of the answer."""
        at = urlsplit(self.address)
        made = socket.create_connection((at.hostname or "", at.port or 0), timeout=30.0)
        lines = [f"GET {path} HTTP/1.1", f"Host: {at.netloc}", *headers, "", ""]
        made.sendall("\r\n".join(lines).encode())
        head = b""
        while b"\r\n\r\n" not in head:
            head += made.recv(4096)
        return made, head

    def entered(self) -> str:
        """Path of a new visitor."""
        made, head = self.request("/")
        made.close()
        found = re.search(rb"Location: (\S+)", head)
        assert found is not None
        return "/" + found[1].decode()

    def web_socket(self, path: str) -> socket.socket:
        made, head = self.request(
            f"{path}ws", "Upgrade: websocket", "Connection: Upgrade", "Sec-WebSocket-Version: 13",
            "Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==", f"Origin: {self.address.rstrip('/')}",
        )  # fmt: skip
        assert b" 101 " in head
        return made


@pytest.fixture(scope="module")
def served(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    if not can_render():
        if os.environ.get("CI") == "true":
            pytest.fail("the page's tests need OpenGL")
        pytest.skip("needs OpenGL")
    log = tmp_path_factory.mktemp("messages") / "log"
    with log.open("w") as errors:
        process = subprocess.Popen(
            [sys.executable, "-c", SERVER], stdout=subprocess.PIPE, stderr=errors, text=True
        )
    assert process.stdout is not None
    with process:
        yield Served(process.stdout.readline().strip(), log)
        process.terminate()


def read_to_end(made: socket.socket) -> None:
    """Read until the server closes the connection; a timeout fails the test."""
    try:
        while made.recv(65536):
            pass
    except ConnectionResetError:
        pass


@pytest.mark.slow
def test_a_malformed_message_closes_its_connection_with_one_line(served: Served) -> None:
    path = served.entered()
    for name, data in MALFORMED.items():
        before = len(served.log.read_text(encoding="utf-8"))
        with served.web_socket(path) as made:
            made.sendall(data)
            read_to_end(made)
        lines = served.log.read_text(encoding="utf-8")[before:].splitlines()
        assert len(lines) == 1, (name, lines)
        assert lines[0].startswith(LOGGED), name
    with served.web_socket(path) as made:  # the visitor's view is still there
        made.sendall(HELLO)
        assert b"clientID" in made.recv(4096)


@pytest.mark.slow
def test_events_without_values_do_not_end_the_server(served: Served) -> None:
    path = served.entered()
    before = served.log.read_text(encoding="utf-8")
    kinds = ("MouseMove", "LeftButtonPress", "MouseWheel", "StartPinch", "Rotate", "EndPan", "Key")
    for kind in kinds:
        with served.web_socket(path) as made:
            made.sendall(HELLO + event(type=kind) + event(type=kind, w=300, h=200) + HELLO)
            assert b"clientID" in made.recv(4096)
    with served.web_socket(path) as made:
        size = call("trame.rca.size", "view", "origin", {"w": 4_000_000, "h": 1, "p": 1})
        made.sendall(HELLO + frame(size) + HELLO)
        assert b"clientID" in made.recv(4096)
    assert served.log.read_text(encoding="utf-8") == before


def message(kind: Any, data: Any) -> Any:
    return aiohttp.WSMessage(kind, data, None)


def test_calls_of_known_methods_are_accepted() -> None:
    from grasp3d.viewer.web.client import check_message

    binary = aiohttp.WSMsgType.BINARY
    check_message(message(binary, call("a", 1)), {"a"})
    check_message(message(binary, call("wslink.hello", SECRET, number="system:1")), {"a"})


@pytest.mark.slow
@pytest.mark.parametrize(
    ("data", "reason"),
    [
        (call("b"), "there is no method 'b'"),
        (call("a", number=5), "without a method and an identifier"),
        (chunk(msgpack.packb([1])), "list instead of a call"),
        (call("a")[:-1], "an incomplete message"),
        (chunk(msgpack.packb({"id": "1", "method": "a", "args": 5})), "neither a list"),
        (chunk(b"", length=1 << 30), "exceeds the allocation limit"),
    ],
)
def test_other_messages_are_refused(data: bytes, reason: str) -> None:
    from grasp3d.viewer.web.client import MessageError, check_message

    with pytest.raises(MessageError, match=reason):
        check_message(message(aiohttp.WSMsgType.BINARY, data), {"a"})
