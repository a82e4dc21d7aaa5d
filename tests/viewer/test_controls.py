"""Keys, and uncertain friction and contact locations, in the viewer."""

import math
from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import trimesh

from grasp3d import (
    GraspModel,
    Label,
    Load,
    Sampling,
    SurfaceLabels,
    Table,
    label_surface,
    load_mesh,
    write_ply,
)
from grasp3d.errors import SettingError
from grasp3d.pictures.subject import subject_of
from grasp3d.settings import DEGREE
from grasp3d.viewer.collection import ViewState, open_collection
from grasp3d.viewer.controls import ACTIONS, CONTROLS, handle_key, offered_paints
from grasp3d.viewer.inspection import inspect
from grasp3d.viewer.panel_text import panel_text
from tests.helpers import shapes, viewing
from tests.helpers.held_grasps import JAWS
from tests.helpers.viewing import fractions, inspected, ready_session, shown, wait_until_idle

WIDE = Sampling(rays=16, search_angle=60.0 * DEGREE)


@cache
def slab(location_error: float = 0.0) -> SurfaceLabels:
    """A slab: pinched across its thickness, of 4 mm, or held along its length."""
    box = load_mesh(trimesh.creation.box([0.004, 0.06, 0.08]), unit="m", max_edge=0.02)
    return label_surface(box, GraspModel(location_error=location_error), sampling=WIDE)


def test_a_chosen_friction_replaces_the_interval() -> None:
    session = ready_session(slab().using(model=GraspModel(friction=(0.4, 0.6))))
    handle_key(session, "Left")
    assert session.state.model.friction == pytest.approx(0.45)


def test_safe_labels_are_said_to_be_safe_once() -> None:
    note = "labels are safe: every S and U is correct, an M may be one of them"
    three = viewing.three_fingers()
    for labels, count in ((slab(1e-4), 1), (three, 0), (slab(), 0)):
        text = panel_text(ready_session(labels))
        assert text.notes.count(note) == count


def test_a_vertex_has_a_margin() -> None:
    labels = slab(1e-4).relabel(friction=(0.4, 0.6))
    subject = subject_of(labels)
    for vertex in np.flatnonzero(np.isfinite(labels.critical_angle))[::40]:
        seen = inspect(subject, int(vertex))
        numbers, margin = dict(seen.numbers), math.degrees(labels.margin[vertex])
        stated = float(numbers["margin"].rstrip("°").replace("−", "-"))
        assert stated == pytest.approx(margin, abs=0.06)
        assert (seen.code == Label.S) == (margin > 0.0)
        assert numbers["α*"] == f"{math.degrees(labels.max_resolution[vertex]):.1f}°"


def reason_of(labels: SurfaceLabels, label: Label) -> str:
    """What is said of a vertex with a label, and with one normal."""
    smooth = labels.mesh.contact_normals.counts == 1
    vertex = int(np.flatnonzero((labels.label == label) & smooth)[0])
    return inspect(subject_of(labels), vertex).reason


def test_explanations_name_the_errors() -> None:
    reason = reason_of(slab(1e-4).relabel(friction=(0.4, 0.6)), Label.S)
    assert "for the worst of the contact points within their location errors β* is " in reason
    assert "below 21.8° − 11.3° = 10.5°" in reason
    assert reason.endswith(
        "all contact points within their errors and any friction of its interval."
    )
    reason = reason_of(slab(1.9e-3), Label.M)
    assert "for the best of the contact points within their location errors; surely" in reason
    assert "errors" not in reason_of(slab(), Label.S)


@pytest.mark.parametrize("location_error", [0.0, 5e-4])
def test_a_labelled_file_has_the_errors_and_labels_of_its_model(
    tmp_path: Path, location_error: float
) -> None:
    labels = slab(location_error).relabel(friction=(0.4, 0.5))
    write_ply(tmp_path / "slab.ply", labels)
    session = ready_session(open_collection(tmp_path / "slab.ply"))
    found = shown(session).labels
    assert found.model == labels.model
    for name in ("critical_angle", "critical_angle_best"):
        assert np.allclose(getattr(found, name), getattr(labels, name), atol=1e-6)
    assert fractions(session) == pytest.approx(labels.fractions(), abs=1e-9)


OF_GRIPPER = {"j": "show_gripper", "t": "show_table", "6": "approach_margin"}
OF_LOAD = {"7": "grip_force", "8": "payload"}


@pytest.mark.parametrize(("what", "keys"), [("gripper", OF_GRIPPER), ("load", OF_LOAD)])
def test_of_a_gripper_or_load_that_there_is_not_nothing_is_offered(
    what: str, keys: dict[str, str]
) -> None:
    session = ready_session(viewing.labels())
    session.click(40)
    assert not {"approach margin", "payload"} & dict(inspected(session).numbers).keys()
    assert what not in panel_text(session).facts
    for key, name in keys.items():
        state = session.state
        assert name not in offered_paints(session)
        assert name not in CONTROLS or not CONTROLS[name].shown(session)
        assert handle_key(session, key)
        assert f"there is no {what}" in session.message
        assert session.state == state


KEYS_AND_EFFECTS: dict[str, Callable[[ViewState], object]] = {
    "Right": lambda state: state.model.friction == 0.55,
    "Left": lambda state: state.model.friction == 0.5,
    "Up": lambda state: state.model.sensor_resolution == pytest.approx(24.6 * DEGREE),
    "Down": lambda state: state.model.sensor_resolution == pytest.approx(22.6 * DEGREE),
    "2": lambda state: state.paint == "critical_angle",
    "3": lambda state: state.paint == "max_resolution",
    "4": lambda state: state.paint == "epsilon",
    "5": lambda state: state.paint == "epsilon_min",
    "6": lambda state: state.paint == "approach_margin",
    "7": lambda state: state.paint == "grip_force",
    "8": lambda state: state.paint == "payload",
    "9": lambda state: state.paint == "margin",
    "1": lambda state: state.paint == "label",
    "x": lambda state: state.section is not None and state.section.axis == "x",
    "[": lambda state: state.section is not None and state.section.position == 0.45,
    "]": lambda state: state.section is not None and state.section.position == 0.5,
    "i": lambda state: state.section is not None and state.section.flipped,
    "j": lambda state: not state.show_gripper,
    "t": lambda state: not state.show_table,
    "b": lambda state: state.grasp is not None,
    "v": lambda state: state.grasp is not None,
    "f": lambda state: state.click == "fix",
}


def test_each_key_changes_its_choice() -> None:
    mesh = load_mesh(shapes.box((0.06, 0.04, 0.08)), unit="m", max_edge=0.02)
    held = label_surface(
        mesh, GraspModel(), sampling=Sampling(rays=16, search_angle=80.0 * DEGREE), hand=JAWS,
        table=Table.below(mesh), load=Load(mass=0.5, grip_force=20.0),
    )  # fmt: skip
    session = ready_session(held)
    others = {"u", "n", "p"}
    assert set(KEYS_AND_EFFECTS) == {key for key, action in ACTIONS.items() if action} - others
    for key, done in KEYS_AND_EFFECTS.items():
        before = session.state
        assert handle_key(session, key)
        wait_until_idle(session)
        assert session.state != before
        assert done(session.state), key
    session.change(fixed=((0.03, 0.0, 0.0),))
    handle_key(session, "u")
    assert session.state.fixed == ()
    session.close()


def test_a_key_beyond_a_limit_gives_a_message_and_other_keys_change_nothing() -> None:
    session = ready_session(viewing.box())
    before = session.state
    assert not any(handle_key(session, key) for key in ("s", "g", "r", "+", "-", "h", "q", "F1"))
    assert session.state == before
    session.change(sensor_resolution=179.0 * DEGREE)
    assert handle_key(session, "Up")
    assert "sensor resolution must" in session.message
    with pytest.raises(SettingError):
        session.change(sensor_resolution=181.0 * DEGREE)
    session.close()
