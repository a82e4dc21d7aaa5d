"""The viewer's page in a real browser, and who is let in."""

import asyncio
import http.client
import io
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image
from plyfile import PlyData

from grasp3d import GraspModel, Sampling, SurfaceLabels, label_surface, load_mesh
from grasp3d.errors import OutputError, SettingError
from grasp3d.rendering import can_render
from grasp3d.settings import DEGREE
from grasp3d.stability.label import COLORS, Label
from grasp3d.viewer.session.album import album_of
from grasp3d.viewer.session.session import Session
from grasp3d.viewer.view_settings import ViewSettings
from grasp3d.viewer.web import page as served_page
from grasp3d.viewer.web.page import address_of, front_door, listening
from tests.helpers.shapes import LIBRARY
from tests.helpers.viewing import rest

CI = os.environ.get("CI") == "true"
BROWSERS = ("chromium", "chromium-browser", "google-chrome")
BROWSER = next(filter(None, map(shutil.which, BROWSERS)), None)
OPTIONS = [
    "--no-sandbox",
    "--disable-gpu",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--no-first-run",
]
LONG = 60_000.0
MODEL = GraspModel(friction=0.3, sensor_resolution=20.0 * DEGREE)
SAMPLING = Sampling(rays=8, search_angle=80.0 * DEGREE)
NAME = "knob.ply"

SERVER = """
import sys
from dataclasses import replace
from math import radians
from grasp3d import GraspModel, Sampling, label_surface, load_mesh
from grasp3d.mesh.primitives import box_mesh
from grasp3d.viewer.session.album import album_of
from grasp3d.viewer.web.page import serve
from grasp3d.viewer.view_settings import ViewSettings
model = GraspModel(friction=0.3, sensor_resolution=radians(20.0))
sampling = Sampling(rays=8, search_angle=radians(80.0))
meshes = [*map(load_mesh, sys.argv[1:]), box_mesh((0.1, 0.2, 0.3), max_edge=0.1)]
albums = [album_of(label_surface(mesh, model, sampling=sampling)) for mesh in meshes]
album = replace(albums[0], exhibits=tuple(album.exhibits[0] for album in albums))
try:
    serve(album, ViewSettings(), port=0, ready=lambda told: print(told, flush=True))
except KeyboardInterrupt:
    sys.exit(130)
"""


IDLE = """
import sys
from types import SimpleNamespace
from aiohttp import web
from grasp3d.viewer.web import page
page.front_door = lambda: SimpleNamespace(app=web.Application(), offer=lambda *_, main: "")
try:
    page.serve(None, None, port=0, ready=lambda told: print(told, flush=True))
except KeyboardInterrupt:
    sys.exit(130)
"""
"""A server that shows nothing, and so begins at once."""


@dataclass
class Served:
    """A server in a process of its own."""

    process: subprocess.Popen[str]
    address: str

    @property
    def port(self) -> int:
        return int(urlsplit(self.address).port or 0)


def started(script: str, *arguments: str) -> Served:
    process = subprocess.Popen(
        [sys.executable, "-c", script, *arguments],
        stdout=subprocess.PIPE,
        text=True,
    )
    assert process.stdout is not None
    address = process.stdout.readline().strip()
    if not address.startswith("http://127.0.0.1:"):
        process.kill()
        process.communicate()
        pytest.fail(f"the server said {address!r}")
    return Served(process, address)


def ended(server: Served, number: int) -> int:
    server.process.send_signal(number)
    with server.process:
        return server.process.wait(60)


@pytest.fixture(scope="module", autouse=True)
def _drawn() -> None:
    missing = [
        name for name, there in (("OpenGL", can_render()), ("Chromium", BROWSER)) if not there
    ]
    if missing and CI:
        pytest.fail(f"the page's tests need {missing}")
    if missing:
        pytest.skip(f"needs {missing}")


@pytest.fixture(scope="module")
def server() -> Iterator[Served]:
    running = started(SERVER, str(LIBRARY / NAME))
    yield running
    assert ended(running, signal.SIGTERM) == 0


@pytest.fixture(scope="module")
def labels() -> SurfaceLabels:
    return label_surface(load_mesh(LIBRARY / NAME), MODEL, sampling=SAMPLING)


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    playwright = pytest.importorskip("playwright.sync_api", reason="needs playwright")
    with playwright.sync_playwright() as driver:
        launched = driver.chromium.launch(executable_path=BROWSER, args=OPTIONS)
        yield launched
        launched.close()


@dataclass
class Visitor:
    """A browser of one person."""

    page: Any
    faults: list[str]

    def picture(self) -> NDArray[np.float64]:
        """What the stage shows, shape (height, width, 3)."""
        data = self.page.locator("#stage").screenshot()
        return np.asarray(Image.open(io.BytesIO(data)).convert("RGB"), dtype=float)

    def shares(self, name: str = "share") -> dict[str, float]:
        told = self.page.locator("#shares li").evaluate_all(
            "(all, name) => all.map(one => [one.dataset.label, +one.dataset[name]])", name
        )
        return dict(told)

    def box(self, name: str) -> tuple[float, float, float, float]:
        """Left, top, right, bottom of an element."""
        box = self.page.locator(name).bounding_box()
        return box["x"], box["y"], box["x"] + box["width"], box["y"] + box["height"]

    def click_middle(self) -> None:
        """Click the surface where it is surely hit."""
        rows, columns = np.nonzero(coloured(self.picture()))
        middle = int(np.argmin(np.hypot(rows - rows.mean(), columns - columns.mean())))
        left, top, _, _ = self.box("#stage")
        self.page.mouse.click(left + float(columns[middle]), top + float(rows[middle]))

    def until(self, done: Callable[[], bool]) -> None:
        """Wait for something that cannot be waited for in the page itself."""
        over = time.monotonic() + LONG / 1000.0
        while not done():
            assert time.monotonic() < over
            self.page.wait_for_timeout(50)

    def shows(self, expected: dict[str, float], name: str = "share") -> None:
        """Wait until these shares are told."""
        wanted = {letter: pytest.approx(share, abs=1e-9) for letter, share in expected.items()}
        self.until(lambda: self.shares(name) == wanted)


def visitor(browser: Any, server: Served, width: int = 1000, height: int = 620) -> Visitor:
    context = browser.new_context(viewport={"width": width, "height": height})
    context.set_default_timeout(LONG)
    made = Visitor(context.new_page(), [])
    told, page = made.faults.append, made.page
    page.on("console", lambda said: told(said.text) if said.type == "error" else None)
    page.on("pageerror", lambda error: told(str(error)))
    page.on("response", lambda got: told(f"{got.status} {got.url}") if got.status >= 400 else None)
    page.on(
        "request",
        lambda asked: (
            None
            if asked.url.startswith((server.address, "data:", "blob:"))
            else told(f"outside: {asked.url}")
        ),
    )
    page.goto(server.address)
    page.wait_for_selector("#shares li[data-share]")
    made.until(lambda: coloured(made.picture()).mean() > 0.05)
    return made


@pytest.fixture
def seen(browser: Any, server: Served) -> Iterator[Visitor]:
    made = visitor(browser, server)
    yield made
    made.page.context.close()
    assert not made.faults


def coloured(picture: NDArray[np.float64]) -> NDArray[np.bool_]:
    return np.ptp(picture, axis=-1) > 60.0


def hues(picture: NDArray[np.float64]) -> dict[str, float]:
    """Which share of the coloured part is nearest in hue to the colour of each label."""
    pixels = picture[coloured(picture)]
    pixels = pixels - pixels.min(axis=1, keepdims=True)
    pixels /= pixels.max(axis=1, keepdims=True)
    known = np.array([COLORS[label] for label in sorted(Label)], dtype=float)
    known -= known.min(axis=1, keepdims=True)
    known /= known.max(axis=1, keepdims=True)
    nearest = np.linalg.norm(pixels[:, None] - known, axis=2).argmin(axis=1)
    return {label.name: float((nearest == label).mean()) for label in Label}


def fractions(labels: SurfaceLabels, friction: float, degrees: float = 20.0) -> dict[str, float]:
    return labels.relabel(friction=friction, sensor_resolution=degrees * DEGREE).fractions()


def test_surface_has_the_colours_of_its_labels(seen: Visitor, labels: SurfaceLabels) -> None:
    seen.shows(labels.fractions())
    before = hues(seen.picture())
    assert sum(share > 0.02 for share in before.values()) >= 2
    seen.page.locator("#friction-number").fill("1.2")
    seen.page.locator("#friction-number").press("Enter")
    seen.shows(fractions(labels, 1.2))
    seen.until(lambda: hues(seen.picture())["S"] > before["S"] + 0.02)


def test_sliders_follow_keyboard_and_mouse(seen: Visitor, labels: SurfaceLabels) -> None:
    seen.page.locator("#friction").focus()
    for _ in range(7):
        seen.page.keyboard.press("ArrowRight")
    seen.shows(fractions(labels, 0.37))
    assert float(seen.page.input_value("#friction-number")) == pytest.approx(0.37)
    box = seen.page.locator("#resolution").bounding_box()
    at = box["y"] + 0.5 * box["height"]
    seen.page.mouse.move(box["x"] + 0.5 * box["width"], at)
    seen.page.mouse.down()
    seen.page.mouse.move(box["x"] + 0.6 * box["width"], at, steps=5)
    seen.page.mouse.up()
    degrees = float(seen.page.input_value("#resolution"))
    assert 50.0 < degrees < 58.0
    seen.shows(fractions(labels, 0.37, degrees))


def test_values_that_cannot_be_are_refused_in_a_sentence(seen: Visitor) -> None:
    for name, value in (("friction", "-1"), ("resolution", "200"), ("opening", "-3")):
        field = seen.page.locator("#opening" if name == "opening" else f"#{name}-number")
        before = field.input_value()
        field.fill(value)
        field.press("Enter")
        seen.page.wait_for_function(
            "name => document.querySelector('#message')?.textContent.includes(name)",
            arg={
                "friction": "friction must be a number above 0",
                "resolution": "sensor resolution must be from 0 to below 180 degrees",
                "opening": "the largest opening must be a number above 0",
            }[name],
        )
        seen.until(lambda field=field, before=before: field.input_value() == before)


def test_second_sensor_stands_beside_the_first(seen: Visitor, labels: SurfaceLabels) -> None:
    seen.page.locator("#comparing").check()
    seen.page.locator("#compare-number").fill("50")
    seen.page.locator("#compare-number").press("Enter")
    seen.shows(labels.fractions())
    seen.shows(fractions(labels, 0.3, 50.0), "other")

    def two() -> bool:
        mask = coloured(seen.picture())
        middle = mask.shape[1] // 2
        return bool(mask[:, :middle].mean() > 0.05 and mask[:, middle:].mean() > 0.05)

    seen.until(two)


def test_click_tells_of_a_place_and_a_drag_turns(seen: Visitor) -> None:
    rows, columns = np.nonzero(coloured(seen.picture()))
    middle = int(np.argmin(np.hypot(rows - rows.mean(), columns - columns.mean())))
    x, y = float(columns[middle]), float(rows[middle])
    before = seen.picture()
    seen.page.mouse.move(x, y)
    seen.page.mouse.down()
    seen.page.mouse.move(x + 60.0, y, steps=6)
    seen.page.mouse.up()
    seen.until(lambda: bool(np.abs(seen.picture() - before).mean() > 2.0))
    assert seen.page.locator("#numbers").count() == 0
    seen.page.mouse.click(x, y)
    seen.page.wait_for_selector("#numbers")
    assert seen.page.locator("#reason").inner_text()[0] in "SMU"
    seen.page.mouse.click(3.0, 3.0)
    seen.page.wait_for_selector("#numbers", state="detached")


def test_keys_work_except_while_typing(seen: Visitor) -> None:
    page = seen.page
    page.keyboard.press("2")
    page.wait_for_selector("#ramp")
    assert page.input_value("#paint") == "critical_angle"
    page.locator("#friction-number").focus()
    page.keyboard.press("1")
    page.locator("h1").click()
    page.keyboard.press("x")
    page.wait_for_selector("#share")
    assert page.input_value("#paint") == "critical_angle"
    page.keyboard.press("h")
    page.wait_for_selector("#help")
    told = page.locator("#help").inner_text()
    assert all(words in told for words in ("more friction", "next object", "grey cone"))
    page.locator("#help-close").click()
    page.wait_for_selector("#help", state="hidden")
    before = seen.picture()
    page.keyboard.press("-")
    seen.until(lambda: bool(coloured(seen.picture()).mean() < 0.9 * coloured(before).mean()))
    page.keyboard.press("z")
    page.wait_for_selector("#share", state="detached")
    page.keyboard.press("z")
    page.wait_for_function("document.querySelector('#paint').value === 'label'")


def test_fields_of_the_section_and_the_hand(seen: Visitor, labels: SurfaceLabels) -> None:
    page = seen.page
    page.locator("#axis-z").click()
    page.locator("#share").focus()
    page.keyboard.press("End")
    page.locator("#flipped").check()
    page.locator("#axis-off").click()
    page.wait_for_selector("#share", state="detached")
    assert page.locator("#release").count() == 0
    opening = 0.4 * labels.mesh.size
    page.locator("#opening").fill(str(opening))
    page.locator("#opening").press("Enter")
    narrow = Sampling(rays=8, search_angle=80.0 * DEGREE, max_opening=opening)
    seen.shows(label_surface(labels.mesh, MODEL, sampling=narrow).fractions())
    words = seen.page.locator("label[for=opening]")
    assert words.inner_text() == "opening at most"
    page.locator("#fingers-3").click()
    seen.until(lambda: words.inner_text() == "reach at most")


def test_visitors_do_not_disturb_each_other(
    browser: Any, server: Served, seen: Visitor, labels: SurfaceLabels
) -> None:
    other = visitor(browser, server)
    for one, friction in ((seen, 0.5), (other, 0.7)):
        one.page.locator("#friction-number").fill(str(friction))
        one.page.locator("#friction-number").press("Enter")
    seen.shows(fractions(labels, 0.5))
    other.shows(fractions(labels, 0.7))
    other.page.reload()
    other.page.wait_for_selector("#shares li[data-share]")
    other.shows(fractions(labels, 0.7))
    assert float(seen.page.input_value("#friction-number")) == 0.5
    assert not other.faults
    other.page.context.close()


def test_next_and_previous_object(seen: Visitor) -> None:
    seen.page.locator("#next").click()
    seen.page.wait_for_function("document.querySelector('#title').textContent.includes('2 of 2')")
    seen.page.wait_for_selector("#shares li[data-share]")
    assert NAME not in seen.page.title()
    seen.page.locator("#object").select_option("0")
    seen.page.wait_for_function("document.querySelector('#title').textContent.includes('1 of 2')")
    seen.page.wait_for_function("name => document.title === `${name} · grasp3d`", arg=NAME)


def test_downloads(seen: Visitor, labels: SurfaceLabels, tmp_path: Path) -> None:
    seen.page.locator("#friction-number").fill("0.5")
    seen.page.locator("#friction-number").press("Enter")
    seen.shows(fractions(labels, 0.5))
    for name, expected_name in (("save", "knob_labeled.ply"), ("picture", "knob_view.png")):
        with seen.page.expect_download() as begun:
            seen.page.locator(f"#{name}").click()
        assert begun.value.suggested_filename == expected_name
        begun.value.save_as(tmp_path / name)
    table = PlyData.read(tmp_path / "save")["vertex"]
    expected = labels.relabel(friction=0.5)
    assert np.array_equal(table["label"], expected.label)
    assert np.allclose(table["critical_angle"], expected.critical_angle, rtol=1e-6)
    picture = np.asarray(Image.open(tmp_path / "picture").convert("RGB"), dtype=float)
    assert coloured(picture).mean() > 0.05
    shown = seen.picture()
    assert picture.shape == shown.shape
    assert hues(picture) == pytest.approx(hues(shown), abs=0.05)
    corner = (slice(0, 60), slice(0, 120))  # of the legend, which a page has in its panel
    assert (picture[corner].max(axis=-1) < 150.0).any()
    assert not (shown[corner].max(axis=-1) < 150.0).any()


@pytest.mark.parametrize("size", [(1280, 800), (390, 844)])
def test_page_stays_as_it_is_and_shows_the_answer_to_a_click(
    browser: Any, server: Served, size: tuple[int, int]
) -> None:
    seen = visitor(browser, server, *size)
    before = {
        name: seen.box(name) for name in ("#stage", "#panel", "#save", "#shares", "#friction")
    }
    assert max(box[3] for box in before.values()) == size[1]
    seen.click_middle()
    seen.page.wait_for_selector("#numbers")
    seen.until(lambda: seen.box("#numbers")[3] <= size[1])
    assert seen.box("#reason")[1] >= seen.box("#rows")[1]
    fixed = ("#stage", "#panel", "#save") if size[0] < 700 else tuple(before)
    assert {name: seen.box(name) for name in fixed} == {name: before[name] for name in fixed}
    seen.page.evaluate("window.trame.state.set('help', true)")
    seen.page.wait_for_selector("#help")
    seen.until(lambda: seen.box("#help")[1] >= 0.0 and seen.box("#help")[3] <= size[1])
    assert not seen.faults
    seen.page.context.close()


def test_narrow_page_has_the_picture_above(browser: Any, server: Served) -> None:
    seen = visitor(browser, server, 360, 740)
    stage = seen.page.locator("#stage").bounding_box()
    panel = seen.page.locator("#panel").bounding_box()
    assert stage["height"] >= 0.45 * 740
    assert panel["y"] >= stage["y"] + stage["height"]
    assert seen.page.evaluate("document.querySelector('#panel').scrollWidth") <= 360
    assert seen.picture().shape[1] == 360
    assert coloured(seen.picture()).mean() > 0.1
    assert not seen.faults
    seen.page.context.close()


def asked(server: Served, path: str, **headers: str) -> tuple[int, str, dict[str, str]]:
    link = http.client.HTTPConnection("127.0.0.1", server.port, timeout=60)
    link.request("GET", path, headers={"Host": f"127.0.0.1:{server.port}", **headers})
    answer = link.getresponse()
    upgraded = answer.status == 101
    got = answer.status, "" if upgraded else answer.read().decode(), dict(answer.getheaders())
    link.close()
    return got


def test_only_own_pages_may_connect(server: Served) -> None:
    status, _, headers = asked(server, "/")
    path = headers["Location"]
    assert (status, bool(re.fullmatch(r"s/[0-9a-f]{32}/", path))) == (302, True)
    wish = {
        "Connection": "Upgrade",
        "Upgrade": "websocket",
        "Sec-WebSocket-Version": "13",
        "Sec-WebSocket-Key": "dGhlIHNhbXBsZSBub25jZQ==",
    }
    own = f"http://127.0.0.1:{server.port}"
    assert asked(server, f"/{path}ws", **wish, Origin="http://evil.example")[0] == 403
    assert asked(server, f"/{path}ws", **wish)[0] == 403
    assert asked(server, f"/{path}ws", **wish, Origin=own)[0] == 101
    assert asked(server, f"/s/{'0' * 32}/ws", **wish, Origin=own)[0] == 404
    assert asked(server, f"/s/{'0' * 32}/")[2]["Location"] == "../../"


def test_files_outside_the_page_are_not_given(server: Served) -> None:
    path = asked(server, "/")[2]["Location"]
    assert asked(server, f"/{path}own/page.css")[0] == 200
    for evil in ("own/../visit.py", "own/%2e%2e/visit.py", "..%2f..%2fvisit.py", "own/", "nothing"):
        assert asked(server, f"/{path}{evil}")[0] == 404
    assert asked(server, "/a/unknown/")[0] == 404


def test_ctrl_c_ends() -> None:
    assert ended(started(IDLE), signal.SIGINT) == 130


def test_places_that_cannot_be_served(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(OutputError, match="cannot serve at"):
        listening("256.256.256.256", 8080)
    with pytest.raises(OutputError, match="port must be from 0 to 65535"):
        listening("127.0.0.1", 65536)
    with listening("127.0.0.1", 0) as taken:
        port = taken.getsockname()[1]
        with listening("127.0.0.1", port) as free:
            assert port < free.getsockname()[1] <= port + served_page.OTHER_PORTS
        assert address_of("0.0.0.0", taken) == address_of("127.0.0.1", taken)  # noqa: S104
        assert address_of("::1", taken).startswith("http://[::1]:")
        assert not served_page.taken(address_of("127.0.0.1", taken), port)
        assert not served_page.taken(address_of("127.0.0.1", taken), 0)
        assert served_page.taken(address_of("127.0.0.1", taken), port - 1)
        monkeypatch.setattr(served_page, "OTHER_PORTS", 0)
        with pytest.raises(OutputError, match="all in use"):
            listening("127.0.0.1", port)


def test_what_is_missing_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(served_page, "can_render", lambda: False)
    with pytest.raises(OutputError, match="OpenGL"):
        front_door()
    monkeypatch.setitem(sys.modules, "aiohttp", None)
    with pytest.raises(OutputError, match=re.escape("pip install 'grasp3d[web]'")):
        front_door()


def test_visits_end_and_are_counted(labels: SurfaceLabels) -> None:
    from aiohttp import ClientSession
    from aiohttp.test_utils import TestClient, TestServer

    from grasp3d.viewer.web.door import FrontDoor

    os.environ["TRAME_ARGS"] = ""

    async def tried() -> None:
        door = FrontDoor(most_visits=1, patience=0.5)
        door.offer(album_of(labels), ViewSettings(), main=True)
        path = door.offer(album_of(labels), ViewSettings())
        async with TestClient(TestServer(door.app)) as client:
            led = await client.get("/", headers={"Host": "elsewhere.example:80"})
            assert (led.status, "localhost" in await led.text()) == (403, True)
            first = await client.get(f"/{path}", allow_redirects=False)
            assert first.headers["Location"].startswith("../../s/")
            token = first.headers["Location"].removeprefix("../../")
            assert (await client.get(f"/{token}")).status == 200
            assert (await client.get(f"/{token}")).status == 200  # a reload
            async with ClientSession() as other:  # another browser, given the address
                page = client.make_url(f"/{token}")
                passed_on = await other.get(page, allow_redirects=False)
                assert passed_on.headers["Location"] == f"../../{path}"
            origin = str(client.make_url("/")).rstrip("/")
            async with client.ws_connect(f"/{token}ws", headers={"Origin": origin}):
                refused = await client.get("/", allow_redirects=False)
                assert (refused.status, "Too many" in await refused.text()) == (503, True)
            async with asyncio.timeout(60):  # the one that was left makes room
                while (await client.get("/", allow_redirects=False)).status == 503:
                    pass  # the answer itself takes a moment
            gone = await client.get(f"/{token}", allow_redirects=False)
            assert gone.headers["Location"] == f"../../{path}"
            door.guarded = False
            led = await client.get("/a/none/", headers={"Host": "elsewhere.example:80"})
            assert led.status == 404

    with ThreadPoolExecutor(1) as apart:  # the browser's driver has a loop in this thread
        apart.submit(asyncio.run, tried()).result()


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("friction", "much"),
        ("friction", None),
        ("friction", float("nan")),
        ("resolution", 180.0),
        ("compare", -1.0),
        ("paint", "glitter"),
        ("axis", "w"),
        ("share", 2.0),
        ("fingers", "many"),
        ("opening", 0.0),
        ("click", "drop"),
        ("number", "last"),
    ],
)
def test_fields_take_only_what_they_mean(labels: SurfaceLabels, name: str, value: Any) -> None:
    from grasp3d.viewer.web.fields import choices, choose

    session = Session(album_of(labels))
    choose(session, "comparing", value=True)
    choose(session, "axis", "y")
    before = choices(session)
    with pytest.raises(SettingError) as refused:
        choose(session, name, value)
    assert "Python" not in str(refused.value)
    assert choices(session) == before
    session.close()


def test_the_page_says_what_a_click_does(labels: SurfaceLabels) -> None:
    from grasp3d.viewer.web.mirror import hint_of

    session = Session(album_of(labels))
    rest(session)
    assert "see the best grasp" in hint_of(session)
    session.change(click="fix")
    assert hint_of(session) == "Click the surface where a finger stands."
    session.tap(0)
    rest(session)
    assert hint_of(session).startswith("One finger is fixed")
    assert hint_of(session).endswith("A click moves it.")
    session.change(click="inspect")
    assert hint_of(session).endswith("A click shows the best grasp there.")
    session.change(click="fix", fingers=3)
    rest(session)
    assert hint_of(session).endswith("A click fixes another one.")
    session.tap(1)
    rest(session)
    assert hint_of(session).startswith("2 fingers are fixed")
    assert hint_of(session).endswith("A click moves the last one.")
    session.close()


def test_shares_are_not_told_while_grasps_are_searched(labels: SurfaceLabels) -> None:
    from grasp3d.viewer.web.mirror import hint_of, mirrored

    session = Session(album_of(labels))
    rest(session)
    assert [len(row["shares"]) for row in mirrored(session)["rows"]] == [1, 1, 1]
    session.change(compare=50.0 * DEGREE, max_opening=0.4 * labels.mesh.size)
    told = mirrored(session)
    assert [row["letter"] for row in told["rows"]] == ["S", "M", "U"]
    percents = {one["percent"] for row in told["rows"] for one in row["shares"]}
    assert percents == {"…"}
    assert (told["heads"], told["stale"]) == (["α 20°", "α 50°"], True)
    assert hint_of(session).endswith("…")
    rest(session)
    assert sum(row["shares"][1]["share"] for row in mirrored(session)["rows"]) == pytest.approx(1.0)
    session.close()


def test_help_names_only_what_there_is(labels: SurfaceLabels) -> None:
    from grasp3d.viewer.web.mirror import fixed_part

    album = album_of(labels)
    two = replace(album, exhibits=album.exhibits * 2)
    for looked_at, there in ((album, set()), (two, {"n", "p"})):
        session = Session(looked_at)
        keys = {item["key"] for item in fixed_part(session)["keys"]}
        assert keys & {"n", "p", "q"} == there
        session.close()
