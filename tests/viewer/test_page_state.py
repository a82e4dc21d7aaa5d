"""What the page shows of a session, without a browser."""

from dataclasses import replace

import pytest

from grasp3d import SurfaceLabels
from grasp3d.viewer.collection import collection_of
from grasp3d.viewer.page import page_state
from grasp3d.viewer.panel_text import panel_text
from grasp3d.viewer.session import Session
from tests.helpers import viewing
from tests.helpers.viewing import ready_session, wait_until_idle


@pytest.fixture(scope="module")
def labels() -> SurfaceLabels:
    return viewing.box()


def test_the_page_shows_what_a_click_does(labels: SurfaceLabels) -> None:
    session = ready_session(labels)

    def hint() -> str:
        wait_until_idle(session)
        return panel_text(session).hint

    assert "see the best grasp" in hint()
    session.change(click="fix")
    assert hint() == "Click the surface to fix a finger there."
    session.click(0)
    assert hint().startswith("1 finger fixed: the colours are for")
    assert hint().endswith("to move the last one there.")
    session.change(click="inspect")
    assert "see the best grasp" in hint()
    session.change(click="fix", fingers=3)
    assert hint().endswith("to fix a finger there.")
    session.click(1)
    assert hint().startswith("2 fingers fixed")
    assert hint().endswith("to move the last one there.")
    session.close()


def test_fractions_are_not_shown_while_grasps_are_searched(labels: SurfaceLabels) -> None:
    session = ready_session(labels)
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
        assert keys & {"n", "p", "q"} == available
        session.close()
