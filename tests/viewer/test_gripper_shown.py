"""A gripper, and forces under a load, in a real window."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import grasp3d
from tests.helpers.windows import Window, needs_screen

ROOT = str(Path(grasp3d.__file__).parents[1])
WITH_GRIPPER = """
from grasp3d.viewer.session import inspection
from tests.helpers.held_grasps import held_box, neighbours_grasps
inspection.alternatives_at = neighbours_grasps
labels = held_box()
"""
WITH_LOAD = """
from tests.viewer.test_forces import held
labels = held()
"""


def in_window(labels: str) -> str:
    """A program that shows labels in a window, and writes a line after each rendering."""
    return f"""
import json, sys
sys.path.insert(0, {ROOT!r})
from grasp3d.viewer.session.collection import collection_of
from grasp3d.viewer.session.panel_text import grasp_number, panel_text
from grasp3d.viewer.session.session import Session
from grasp3d.viewer.view_settings import ViewSettings
from grasp3d.viewer.window.desktop import show_window
{labels}
session = Session(collection_of(labels), ViewSettings(width=1000, height=700))
lines = open(sys.argv[1], "w", encoding="utf-8")
def watch():
    text = panel_text(session)
    state, seen, ramp = session.state, session.inspection, text.ramp
    print(json.dumps(dict(
        fractions=dict((one.letter, one.fraction) for one in text.fractions),
        vertex=state.vertex, paint=state.paint, gripper=state.show_gripper,
        table=state.show_table, grasp=seen and grasp_number(seen), working=session.working,
        message=session.message, ramp=ramp.text + ramp.end if ramp else "",
        reason=seen.reason if seen else "", numbers=dict(seen.numbers) if seen else dict(),
    )), file=lines, flush=True)
show_window(session, title="a window to test", watch=watch)
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
    with Window.open(in_window(WITH_GRIPPER), tmp_path) as window:
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
        window.key("j", "t")
        window.until(lambda state: not (state["gripper"] or state["table"]), "nothing beside")
        assert greys(window.picture()) < 0.5 * shown
        window.key("6")  # in whose colours faces that are not reached are grey
        window.until(lambda state: state["paint"] == "approach_margin", "colours")


@needs_screen
@pytest.mark.slow
def test_a_window_shows_payloads(tmp_path: Path) -> None:
    with Window.open(in_window(WITH_LOAD), tmp_path) as window:
        window.click(*middle_of_object(window.picture()))
        state = window.until(lambda state: state["vertex"] is not None, "a vertex")
        assert "grip force" in state["numbers"]
        assert "20 N" in state["numbers"]["payload"] + state["reason"]
        window.key("8")
        window.until(lambda state: state["ramp"].endswith(" kg"), "colours of payloads")
        window.key("7")
        state = window.until(lambda state: state["paint"] == "grip_force", "colours of forces")
        assert state["ramp"].startswith("grip force of each finger for 0.5 kg")
