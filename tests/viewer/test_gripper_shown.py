"""A gripper in a real window and in a real browser."""

import signal
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import grasp3d
from tests.helpers.windows import Window, needs_screen
from tests.viewer.test_page import Visitor, browser, ended, started, visitor

__all__ = ["browser"]  # a fixture

ROOT = str(Path(grasp3d.__file__).parents[1])
OPENED = f"""
import json, sys
sys.path.insert(0, {ROOT!r})
from grasp3d.viewer.session import reached_grasps
from grasp3d.viewer.session.collection import collection_of
from grasp3d.viewer.view_settings import ViewSettings
from tests.helpers.held_grasps import held_box, neighbours_grasps
reached_grasps.alternatives_at = neighbours_grasps
collection = collection_of(held_box())
"""
IN_WINDOW = f"""{OPENED}
from grasp3d.viewer.session.panel_text import grasp_number, panel_text
from grasp3d.viewer.session.session import Session
from grasp3d.viewer.window.desktop import show_window
session = Session(collection, ViewSettings(width=1000, height=700))
lines = open(sys.argv[1], "w", encoding="utf-8")
def watch():
    text = panel_text(session)
    state, seen = session.state, text.inspection
    print(json.dumps(dict(
        fractions=dict((one.letter, one.fraction) for one in text.fractions),
        vertex=state.vertex, paint=state.paint, gripper=state.show_gripper,
        table=state.show_table, grasp=seen and grasp_number(seen), working=text.working,
        message=text.message, numbers=dict(seen.numbers) if seen else dict(),
    )), file=lines, flush=True)
show_window(session, title="a window to test", watch=watch)
"""
IN_BROWSER = f"""{OPENED}
from grasp3d.viewer.web.page import serve
try:
    serve(collection, ViewSettings(), port=0, ready=lambda address: print(address, flush=True))
except KeyboardInterrupt:
    sys.exit(130)
"""


def greys(picture: NDArray[Any]) -> float:
    """Fraction of grey pixels that are not the background: gripper and table."""
    image = picture[:, :600].astype(float)
    return float(((np.ptp(image, axis=2) < 20.0) & (image.mean(axis=2) < 225.0)).mean())


def middle_of_object(picture: NDArray[Any]) -> tuple[int, int]:
    """Position of a pixel well inside the coloured object, x and y."""
    rows, columns = np.nonzero(np.ptp(picture[:, :600].astype(int), axis=2) > 60)
    return int(np.median(columns)), int(np.median(rows))


@needs_screen
@pytest.mark.slow
def test_a_click_in_a_window_shows_the_gripper(tmp_path: Path) -> None:
    with Window.open(IN_WINDOW, tmp_path) as window:
        before = window.picture()
        window.click(*middle_of_object(before))
        state = window.until(lambda state: state["grasp"] == "1 of 5", "the gripper")
        assert "approach margin" in state["numbers"]
        shown = greys(window.picture())
        assert shown > greys(before) + 0.03
        window.key("period")
        window.until(lambda state: state["grasp"] == "2 of 5", "the next grasp")
        window.key("comma")
        window.until(lambda state: state["grasp"] == "1 of 5", "the grasp before")
        window.key("6")
        window.until(lambda state: state["paint"] == "approach_margin", "colours")
        window.key("j", "t")
        window.until(lambda state: not (state["gripper"] or state["table"]), "nothing beside")
        assert greys(window.picture()) < 0.5 * shown


@pytest.mark.slow
def test_a_click_in_a_browser_shows_the_gripper(browser: Any) -> None:
    server = started(IN_BROWSER)
    try:
        seen = visitor(browser, server, 1000, 700)
        before = greys(seen.picture())
        click_object(seen)
        page = seen.page
        page.wait_for_function(
            "document.querySelector('#grasp-number')?.textContent === 'grasp 1 of 5'"
        )
        seen.until(lambda: greys(seen.picture()) > before + 0.03)
        assert "approach margin" in page.locator("#numbers").inner_text()
        page.click("#grasp-next")
        page.wait_for_function(
            "document.querySelector('#grasp-number').textContent === 'grasp 2 of 5'"
        )
        shown = greys(seen.picture())
        page.uncheck("#show-gripper")
        page.uncheck("#show-table")
        seen.until(lambda: greys(seen.picture()) < 0.5 * shown)
        page.select_option("#paint", "approach_margin")
        seen.until(lambda: "not reached" in page.locator("#ramp").inner_text())
        assert not seen.errors
    finally:
        assert ended(server, signal.SIGTERM) == 0


def click_object(seen: Visitor) -> None:
    left, top, _, _ = seen.box("#stage")
    x, y = middle_of_object(seen.picture())
    seen.page.mouse.click(left + x, top + y)
