"""What the page shows of a session, without a browser."""

from dataclasses import replace

import pytest

from grasp3d import SurfaceLabels
from grasp3d.viewer.session.collection import collection_of
from grasp3d.viewer.session.panel_text import panel_text
from grasp3d.viewer.session.session import Session
from grasp3d.viewer.web.page_state import page_state
from tests.helpers import viewing
from tests.helpers.viewing import wait_until_idle


@pytest.fixture(scope="module")
def labels() -> SurfaceLabels:
    return viewing.box()


def test_the_page_shows_what_a_click_does(labels: SurfaceLabels) -> None:
    session = Session(collection_of(labels))
    wait_until_idle(session)
    assert "see the best grasp" in panel_text(session).hint
    session.change(click="fix")
    assert panel_text(session).hint == "Click the surface to fix a finger there."
    session.click(0)
    wait_until_idle(session)
    assert panel_text(session).hint.startswith("One finger is fixed")
    assert panel_text(session).hint.endswith("A click moves it.")
    session.change(click="inspect")
    assert panel_text(session).hint.endswith("A click shows the best grasp there.")
    session.change(click="fix", fingers=3)
    wait_until_idle(session)
    assert panel_text(session).hint.endswith("A click fixes another one.")
    session.click(1)
    wait_until_idle(session)
    assert panel_text(session).hint.startswith("2 fingers are fixed")
    assert panel_text(session).hint.endswith("A click moves the last one.")
    session.close()


def test_fractions_are_not_shown_while_grasps_are_searched(labels: SurfaceLabels) -> None:
    session = Session(collection_of(labels))
    wait_until_idle(session)
    assert [row["letter"] for row in page_state(session)["rows"]] == ["S", "M", "U"]
    session.change(fingers=3)
    state = page_state(session)
    assert [row["letter"] for row in state["rows"]] == ["S", "M", "U"]
    assert {row["percent"] for row in state["rows"]} == {"…"}
    assert state["stale"]
    assert panel_text(session).hint.endswith("…")
    wait_until_idle(session)
    assert sum(row["fraction"] for row in page_state(session)["rows"]) == pytest.approx(1.0)
    session.close()


def test_help_has_only_available_keys(labels: SurfaceLabels) -> None:
    collection = collection_of(labels)
    two = replace(collection, items=collection.items * 2)
    for viewed, available in ((collection, set()), (two, {"n", "p"})):
        session = Session(viewed)
        keys = {key for item in page_state(session)["keys"] for key in item["keys"]}
        assert keys & {"n", "p", "q", "w"} == available
        session.close()
