"""`labels.show()` in notebooks and in other programs."""

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

from grasp3d.pictures.opengl import can_render
from grasp3d.viewer import show
from tests.helpers import viewing
from tests.helpers.browsers import BROWSER, CI, OPTIONS
from tests.viewer.test_page import coloured

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
