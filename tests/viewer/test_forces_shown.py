"""Grip force and payload in a real window and in a real browser."""

import signal
from pathlib import Path
from typing import Any

import pytest

import grasp3d
from tests.helpers.windows import Window, needs_screen
from tests.viewer.test_gripper_shown import click_object, middle_of_object
from tests.viewer.test_page import browser, ended, started, visitor

__all__ = ["browser"]  # a fixture

ROOT = str(Path(grasp3d.__file__).parents[1])
OPENED = f"""
import json, sys
sys.path.insert(0, {ROOT!r})
from grasp3d.viewer.session.collection import collection_of
from grasp3d.viewer.view_settings import ViewSettings
from tests.viewer.test_forces import held
collection = collection_of(held())
"""
IN_WINDOW = f"""{OPENED}
from grasp3d.viewer.session.panel_text import panel_text
from grasp3d.viewer.session.session import Session
from grasp3d.viewer.window.desktop import show_window
session = Session(collection, ViewSettings(width=1000, height=800))
lines = open(sys.argv[1], "w", encoding="utf-8")
def watch():
    text = panel_text(session)
    state, seen, ramp = session.state, text.inspection, text.ramp
    print(json.dumps(dict(
        fractions=dict((one.letter, one.fraction) for one in text.fractions),
        vertex=state.vertex, paint=state.paint, working=text.working, message=text.message,
        ramp=ramp.text + ramp.end if ramp else "", reason=seen.reason if seen else "",
        numbers=dict(seen.numbers) if seen else dict(),
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


@needs_screen
@pytest.mark.slow
def test_a_window_shows_payloads(tmp_path: Path) -> None:
    with Window.open(IN_WINDOW, tmp_path) as window:
        window.click(*middle_of_object(window.picture()))
        state = window.until(lambda state: state["vertex"] is not None, "a vertex")
        assert "grip force" in state["numbers"]
        assert "20 N" in state["numbers"]["payload"] + state["reason"]
        window.key("8")
        window.until(lambda state: state["ramp"].endswith(" kg"), "colours of payloads")
        window.key("7")
        state = window.until(lambda state: state["paint"] == "grip_force", "colours of forces")
        assert state["ramp"].startswith("grip force of each finger for 0.5 kg")


@pytest.mark.slow
def test_a_page_shows_payloads(browser: Any) -> None:
    server = started(IN_BROWSER)
    try:
        seen = visitor(browser, server, 1000, 700)
        page = seen.page
        click_object(seen)
        seen.until(lambda: "grip force" in page.locator("#numbers").inner_text())
        assert "20 N" in page.locator("#numbers").inner_text()
        page.select_option("#paint", "payload")
        seen.until(lambda: "payload with 20 N" in page.locator("#ramp").inner_text())
        page.select_option("#paint", "grip_force")
        seen.until(lambda: "for 0.5 kg" in page.locator("#ramp").inner_text())
        assert "N" in page.locator("#ramp").inner_text()
        assert not seen.errors
    finally:
        assert ended(server, signal.SIGTERM) == 0
