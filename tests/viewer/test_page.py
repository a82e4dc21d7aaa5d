"""The viewer's page in a real browser, and access to its server."""

import http.client
import io
import re
import socket
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any
from urllib.error import HTTPError
from urllib.parse import SplitResult, urlsplit
from urllib.request import urlopen

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image
from plyfile import PlyData

from grasp3d import GraspModel, Sampling, SurfaceLabels, label_surface, load_mesh
from grasp3d.errors import MeshError, OutputError
from grasp3d.pictures.opengl import can_render
from grasp3d.pictures.subject import Subject
from grasp3d.settings import DEGREE
from grasp3d.viewer import page as served_page
from grasp3d.viewer.collection import Item, collection_of
from grasp3d.viewer.page import free_port, serve_in_background
from grasp3d.viewer.session import Session
from tests.helpers import viewing
from tests.helpers.browsers import BROWSER, CI
from tests.helpers.shapes import LIBRARY
from tests.helpers.viewing import label_parts
from tests.helpers.windows import wait_for

LONG = 20_000.0
MODEL = GraspModel(friction=0.3, sensor_resolution=20.0 * DEGREE)
SAMPLING = Sampling(rays=8, search_angle=80.0 * DEGREE)
NAME = "knob.ply"

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module", autouse=True)
def _requirements() -> None:
    required = (("OpenGL", can_render()), ("Chromium", BROWSER))
    missing = [name for name, available in required if not available]
    if missing and CI:
        pytest.fail(f"the page's tests need {missing}")
    if missing:
        pytest.skip(f"needs {missing}")


@pytest.fixture(scope="module")
def labels() -> SurfaceLabels:
    return label_surface(load_mesh(LIBRARY / NAME), MODEL, sampling=SAMPLING)


@pytest.fixture(scope="module")
def server(labels: SurfaceLabels) -> SplitResult:
    """The address of a page of two objects, the second of which has a name that is no text."""
    first, second = (collection_of(one).items[0] for one in (labels, viewing.box()))
    second = replace(second, name="<img src='x' onerror='document.title = 1'>")
    collection = replace(collection_of(labels), items=(first, second))
    return urlsplit(serve_in_background(Session(collection)))


@dataclass
class Visitor:
    """One visitor's browser."""

    page: Any
    errors: list[str]

    def picture(self) -> NDArray[np.float64]:
        """Picture of the scene, shape (height, width, 3)."""
        data = self.page.locator("#stage").screenshot()
        return np.asarray(Image.open(io.BytesIO(data)).convert("RGB"), dtype=float)

    def fractions(self) -> dict[str, float]:
        values = self.page.locator("#fractions li").evaluate_all(
            "all => all.map(one => [one.dataset.label, +one.dataset.fraction])"
        )
        return dict(values)

    def click_middle(self) -> None:
        """Click near the centre of the object."""
        rows, columns = np.nonzero(coloured(self.picture()))
        middle = int(np.argmin(np.hypot(rows - rows.mean(), columns - columns.mean())))
        at = {"x": float(columns[middle]), "y": float(rows[middle])}
        self.page.locator("#stage").click(position=at)

    def until(self, done: Callable[[], bool]) -> None:
        """Wait for a condition that is checked outside the page."""
        over = time.monotonic() + LONG / 1000.0
        while not done():
            assert time.monotonic() < over
            self.page.wait_for_timeout(50)

    def shows(self, expected: dict[str, float]) -> None:
        """Wait until the page shows these area fractions."""
        wanted = {letter: pytest.approx(value, abs=1e-9) for letter, value in expected.items()}
        self.until(lambda: self.fractions() == wanted)


def visitor(browser: Any, server: SplitResult, width: int = 1280, height: int = 800) -> Visitor:
    context = browser.new_context(viewport={"width": width, "height": height})
    context.set_default_timeout(LONG)
    made = Visitor(context.new_page(), [])
    add, page = made.errors.append, made.page
    own = (server.geturl(), "data:", "blob:")
    page.on("console", lambda entry: add(entry.text) if entry.type == "error" else None)
    page.on("pageerror", lambda error: add(str(error)))
    page.on("response", lambda got: add(f"{got.status} {got.url}") if got.status >= 400 else None)
    page.on(
        "request", lambda sent: None if sent.url.startswith(own) else add(f"outside: {sent.url}")
    )
    page.goto(server.geturl())
    page.wait_for_selector("#fractions li[data-fraction]")
    made.until(lambda: coloured(made.picture()).mean() > 0.05)
    return made


@pytest.fixture
def seen(browser: Any, server: SplitResult) -> Iterator[Visitor]:
    made = visitor(browser, server)
    yield made
    made.page.context.close()
    assert not made.errors


def coloured(picture: NDArray[np.float64]) -> NDArray[np.bool_]:
    return np.ptp(picture, axis=-1) > 60.0


def fractions(labels: SurfaceLabels, friction: float, degrees: float = 20.0) -> dict[str, float]:
    return labels.relabel(friction=friction, sensor_resolution=degrees * DEGREE).fractions()


def test_the_page_shows_and_changes_an_object(
    seen: Visitor, labels: SurfaceLabels, tmp_path: Path
) -> None:
    page = seen.page
    seen.shows(labels.fractions())
    before = label_parts(seen.picture())
    page.locator("#friction-number").fill("1.2")
    page.locator("#friction-number").press("Enter")
    seen.shows(fractions(labels, 1.2))
    seen.until(lambda: label_parts(seen.picture())["S"] > before["S"] + 0.02)
    box = page.locator("#resolution").bounding_box()
    at = box["y"] + 0.5 * box["height"]
    page.mouse.move(box["x"] + 0.5 * box["width"], at)
    page.mouse.down()
    page.mouse.move(box["x"] + 0.6 * box["width"], at, steps=5)
    page.mouse.up()
    degrees = float(page.input_value("#resolution"))
    assert 50.0 < degrees < 58.0
    seen.shows(fractions(labels, 1.2, degrees))
    page.locator("h1").click()  # keys belong to a field while it has the focus
    page.keyboard.press("2")
    page.wait_for_selector("#ramp")
    page.locator("#friction-number").fill("-1")
    page.locator("#friction-number").press("Enter")
    page.wait_for_selector("#message")
    assert "friction must be a finite number above 0" in page.locator("#message").inner_text()
    seen.click_middle()
    page.wait_for_selector("#numbers")
    assert page.locator("#reason").inner_text()[0] in "SMU"
    page.locator("h1").click()
    page.keyboard.press("h")
    page.wait_for_selector("#help")
    page.locator("#help-close").click()
    for name, expected in (("save", "knob_labeled.ply"), ("picture", "knob_view.png")):
        with page.expect_download() as begun:
            page.locator(f"#{name}").click()
        assert begun.value.suggested_filename == expected
        begun.value.save_as(tmp_path / name)
    table = PlyData.read(tmp_path / "save")["vertex"]
    relabelled = labels.relabel(friction=1.2, sensor_resolution=degrees * DEGREE)
    assert np.array_equal(table["label"], relabelled.label)
    with Image.open(tmp_path / "picture") as picture:
        assert picture.size == pytest.approx(seen.picture().shape[1::-1], abs=1)
    page.reload()
    page.wait_for_selector("#fractions li[data-fraction]")
    seen.shows(fractions(labels, 1.2, degrees))


def test_a_narrow_page_has_every_control_and_names_of_files_are_texts(
    browser: Any, server: SplitResult
) -> None:
    seen = visitor(browser, server, 390, 844)
    page = seen.page
    assert page.evaluate("document.documentElement.scrollWidth") <= 390
    before = seen.fractions()
    page.locator("#axis").select_option("x")
    page.locator("#position-number").fill("0.25")
    page.locator("#position-number").press("Enter")
    seen.until(lambda: page.input_value("#position") == "0.25")
    page.locator("#axis").select_option("off")
    page.locator("#click").select_option("fix")
    seen.click_middle()
    seen.until(lambda: "1 finger fixed" in page.locator("#hint").inner_text())
    page.locator("#release").click()
    page.locator("#click").select_option("inspect")
    seen.shows(before)
    page.locator("#number").select_option("1")
    name = "<img src='x' onerror='document.title = 1'> (2 of 2)"
    seen.until(lambda: name in page.locator("#title").inner_text())
    assert page.title() != "1"
    assert not page.locator("#panel img").count()
    page.context.close()
    assert not seen.errors


def response(server: SplitResult, path: str, **headers: str) -> tuple[int, str]:
    link = http.client.HTTPConnection("127.0.0.1", server.port, timeout=60)
    link.request("GET", path, headers={"Host": f"127.0.0.1:{server.port}", **headers})
    answer = link.getresponse()
    got = answer.status, "" if answer.status == 101 else answer.read().decode()
    link.close()
    return got


UPGRADE = {
    "Connection": "Upgrade",
    "Upgrade": "websocket",
    "Sec-WebSocket-Version": "13",
    "Sec-WebSocket-Key": "dGhlIHNhbXBsZSBub25jZQ==",
}


def test_only_pages_of_the_server_may_connect(server: SplitResult) -> None:
    assert re.fullmatch(r"/[0-9a-f]{32}/", server.path)
    own, link = f"http://127.0.0.1:{server.port}", f"{server.path}ws"
    assert response(server, link, **UPGRADE, Origin=own)[0] == 101
    for headers in ({**UPGRADE, "Origin": "http://evil.example"}, UPGRADE, {}):
        assert response(server, link, **headers)[0] == 403
    for path in (server.path, f"{server.path}picture.png", link):
        status, text = response(server, path, Host="elsewhere.example:80")
        assert (status, "localhost" in text) == (403, True)
    assert response(server, server.path, Host=f"localhost:{server.port}")[0] == 200


def test_nothing_is_shown_without_the_token_or_of_other_folders(server: SplitResult) -> None:
    own = f"http://127.0.0.1:{server.port}"
    files = ("", "index.html", "ws", "labels.ply", "picture.png", "own/page.css", "vue.global.js")
    for start in ("/", f"/{'0' * 32}/", server.path[:-1]):
        for name in files:
            assert response(server, start + name, **UPGRADE, Origin=own)[0] == 404
    status, text = response(server, "/")
    assert (status, "use the whole address" in text) == (404, True)
    assert response(server, f"{server.path}own/page.css")[0] == 200
    for name in ("own/../page.py", "own/%2e%2e/page.py", "..%2f..%2fpage.py", "own/", "nothing"):
        assert response(server, server.path + name)[0] in {403, 404}


def test_a_port_in_use_is_passed_over(monkeypatch: pytest.MonkeyPatch) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        assert port < free_port(port) <= port + served_page.OTHER_PORTS
        monkeypatch.setattr(served_page, "OTHER_PORTS", 0)
        assert free_port(port) not in {0, port}
    monkeypatch.setattr(served_page, "HOST", "192.0.2.1")  # of no machine
    with pytest.raises(OutputError, match="no port of"):
        free_port()


def test_a_file_that_cannot_be_saved_leaves_the_page_as_it_is(labels: SurfaceLabels) -> None:
    def fail() -> Subject:
        raise MeshError("it is no mesh")

    session = Session(replace(collection_of(labels), items=(Item("broken", fail),)))
    address = serve_in_background(session)
    for name in ("labels.ply", "picture.png"):
        with urlopen(address + name) as answer:  # noqa: S310
            assert (answer.status, answer.read()) == (204, b"")
        assert "nothing to save yet" in session.message


def test_pages_in_the_background_are_apart_and_end_where_nobody_uses_them(
    labels: SurfaceLabels, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(served_page, "UNUSED", 3)
    first, second = (serve_in_background(Session(collection_of(labels))) for _ in range(2))
    one, two = urlsplit(first), urlsplit(second)
    assert one.port != two.port
    with urlopen(first) as page:  # noqa: S310
        assert b"<html" in page.read()
    with pytest.raises(HTTPError):
        urlopen(one._replace(path=two.path).geturl())  # noqa: S310

    def refuses() -> bool:
        with socket.socket() as link:
            return link.connect_ex((str(one.hostname), int(one.port or 0))) != 0

    assert not refuses()
    wait_for(refuses, "the end of the page")
