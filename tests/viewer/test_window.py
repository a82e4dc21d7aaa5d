"""The desktop window, under a real X server with real events."""

import io
import re
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import nbformat
import numpy as np
import pytest
from nbclient import NotebookClient
from PIL import Image
from plyfile import PlyData

from grasp3d import GraspModel, Sampling, SurfaceLabels, label_surface, load_mesh
from grasp3d.errors import OutputError
from grasp3d.pictures.opengl import can_render
from grasp3d.settings import DEGREE
from grasp3d.viewer import show
from grasp3d.viewer.collection import collection_of
from grasp3d.viewer.session import Session
from grasp3d.viewer.window import display_problem, show_window
from tests.helpers import viewing
from tests.helpers.browsers import BROWSER, CI, OPTIONS
from tests.helpers.shapes import LIBRARY
from tests.helpers.viewing import label_parts
from tests.helpers.windows import Image8, Window, needs_screen
from tests.viewer.test_page import coloured

pytestmark = [pytest.mark.slow, needs_screen]

NAME = "spray.glb"
WIDTH, HEIGHT, SCENE = 1000, 700, 680
"""Size of the window, and a width that only the scene has [pixels]."""
TRACK = 268.0
"""Length of a slider's track [pixels], to a few of them."""
CONE = 60.0 * DEGREE
"""Wide enough for all tested settings, so that there is no second search."""
SCRIPT = """
import json, sys
from grasp3d import GraspModel, Sampling, label_surface, load_mesh
from grasp3d.viewer.collection import collection_of
from grasp3d.viewer.panel_text import panel_text
from grasp3d.viewer.window import show_window
from grasp3d.viewer.session import Session
from grasp3d.pictures.view_settings import ViewSettings
sampling = Sampling(rays=8, search_angle={cone})
labels = label_surface(load_mesh({mesh!r}), GraspModel(), sampling=sampling)
session = Session(collection_of(labels), ViewSettings(width={width}, height={height}))
lines = open(sys.argv[1], "w", encoding="utf-8")
def watch():
    state, text = session.state, panel_text(session)
    print(json.dumps(dict(
        fractions=dict((one.letter, one.fraction) for one in text.fractions),
        friction=state.model.friction, resolution=state.model.sensor_resolution,
        paint=state.paint, vertex=state.vertex, message=session.message,
    )), file=lines, flush=True)
show_window(session, title="a window to test", watch=watch)
print("closed")
"""


@pytest.fixture(scope="module")
def labels() -> SurfaceLabels:
    mesh = load_mesh(LIBRARY / NAME)
    sampling = Sampling(rays=8, search_angle=CONE)
    return label_surface(mesh, GraspModel(), sampling=sampling)


def pixel_of_object(picture: Image8) -> tuple[int, int]:
    """Position of a pixel well inside the object, x and y."""
    painted = np.ptp(picture.astype(int), axis=2) > 60
    painted[:, SCENE:] = painted[650:] = False  # the legend is below the object
    rows = np.flatnonzero(painted.sum(axis=1) > 40)
    y = int(rows[len(rows) // 2])
    columns = np.flatnonzero(painted[y])
    return int(np.median(columns)), y


def stable(picture: Image8) -> float:
    """Fraction of the scene's coloured pixels that are S."""
    return label_parts(picture[:650, :SCENE])["S"]


def test_the_window_shows_and_changes_an_object(tmp_path: Path, labels: SurfaceLabels) -> None:
    script = SCRIPT.format(mesh=str(LIBRARY / NAME), width=WIDTH, height=HEIGHT, cone=CONE)
    with Window.open(script, tmp_path) as window:
        before = window.picture()
        x, y = pixel_of_object(before)
        assert window.state["fractions"] == pytest.approx(labels.fractions())
        window.slide(0, -0.2 * TRACK)
        state = window.until(lambda state: state["friction"] < 0.22, "friction")
        assert state["friction"] == pytest.approx(0.5 - 0.2 * 1.49, abs=0.03)
        relabelled = labels.relabel(friction=state["friction"])
        assert state["fractions"] == pytest.approx(relabelled.fractions())
        assert stable(before) > stable(window.picture()) + 0.2
        window.drag((900, 400), (800, 500))  # on the panel, which does not turn the object
        window.click(x, y)
        window.until(lambda state: state["vertex"] is not None, "an inspected vertex")
        window.key("h")
        window.key("2")
        window.until(lambda state: state["paint"] == "critical_angle", "colours")
        window.key("s")
        path = window.folder / "spray_labeled.ply"
        window.until(lambda state: state["message"] == f"saved: {path}", "a file")
        assert np.array_equal(PlyData.read(path)["vertex"].data["label"], relabelled.label)
        window.key("g")
        path = window.folder / "spray_view.png"
        window.until(lambda state: state["message"] == f"saved: {path}", "a picture")
        with Image.open(path) as image:
            assert (image.size[0] < WIDTH, image.size[1]) == (True, HEIGHT)
        window.close()
        assert window.ended() == (0, "closed\n", "")


def test_the_error_without_a_display_names_the_alternatives(
    labels: SurfaceLabels, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.setenv("WAYLAND_DISPLAY", "wayland-0")
    session = Session(collection_of(labels))
    with pytest.raises(OutputError, match=r"DISPLAY is not set; .* browser .* --screenshot FILE"):
        show_window(session)
    assert session.working is None
    monkeypatch.setenv("DISPLAY", ":65000")
    assert "no window opens on display :65000" in display_problem()
    monkeypatch.setattr("sys.platform", "darwin")
    assert not display_problem()


LABELS = """
import grasp3d
from tests.helpers.solids import box_mesh
labels = grasp3d.label_surface(box_mesh((0.1, 0.2, 0.3), max_edge=0.1))
"""
SHOW = "labels.show(height=500)"


@pytest.mark.slow
def test_a_notebook_shows_a_page() -> None:
    if not (BROWSER and can_render()):
        (pytest.fail if CI else pytest.skip)("needs Chromium and OpenGL")
    playwright = pytest.importorskip("playwright.sync_api", reason="needs playwright")
    cells = [nbformat.v4.new_code_cell(code) for code in (LABELS, SHOW)]
    client = NotebookClient(nbformat.v4.new_notebook(cells=cells), timeout=240)
    with client.setup_kernel(cwd=str(Path(__file__).parents[2])):
        for number, cell in enumerate(client.nb.cells):
            executed = client.execute_cell(cell, number)
        frame = str(executed.outputs[-1]["data"]["text/html"])
        assert re.search(r'src="http://127\.0\.0\.1:\d+/[0-9a-f]{32}/"', frame)
        assert 'height="500"' in frame
        with playwright.sync_playwright() as started:
            browser = started.chromium.launch(executable_path=BROWSER, args=OPTIONS)
            page = browser.new_page()
            page.set_content(frame)
            inside = page.frame_locator("iframe")
            inside.locator("#fractions li").first.wait_for(timeout=60_000)
            assert "vertices" in inside.locator("#facts").inner_text()

            def picture() -> Any:
                image = Image.open(io.BytesIO(page.screenshot())).convert("RGB")
                return np.asarray(image, dtype=float)

            while coloured(picture()).mean() < 0.02:
                page.wait_for_timeout(50)
            browser.close()


def test_outside_notebooks_a_window_opens(monkeypatch: pytest.MonkeyPatch) -> None:
    opened = list[Any]()
    window = SimpleNamespace(show_window=opened.append)
    monkeypatch.setitem(sys.modules, "grasp3d.viewer.window", window)
    assert viewing.box().show() is None
    assert opened[0].name == viewing.box().mesh.report.source
    opened[0].close()


def test_addresses_behind_a_proxy(monkeypatch: pytest.MonkeyPatch) -> None:
    proxies: list[bool] = []

    def serve(_: object, *, proxied: bool) -> str:
        proxies.append(proxied)
        return "http://127.0.0.1:1234/b/"

    page = SimpleNamespace(serve_in_background=serve)
    monkeypatch.setitem(sys.modules, "grasp3d.viewer.page", page)
    monkeypatch.setattr(show, "in_notebook", lambda: True)
    monkeypatch.delenv(show.HUB, raising=False)

    def source(**options: str) -> str:
        found = re.search('src="([^"]*)"', viewing.box().show(**options)._repr_html_())
        assert found is not None
        return found[1]

    assert source() == "http://127.0.0.1:1234/b/"
    assert source(proxy='/a"b/proxy') == "/a&quot;b/proxy/1234/b/"
    monkeypatch.setenv(show.HUB, "/user/ada/")
    assert source() == "/user/ada/proxy/1234/b/"
    assert proxies == [False, True, True]
