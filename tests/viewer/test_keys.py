"""Keys of the viewer."""

from collections.abc import Callable

import pytest

from grasp3d import (
    GraspModel,
    Load,
    Sampling,
    SurfaceLabels,
    Table,
    label_surface,
    load_mesh,
)
from grasp3d.errors import SettingError
from grasp3d.settings import DEGREE
from grasp3d.viewer.collection import ViewState, collection_of
from grasp3d.viewer.controls import ACTIONS, handle_key
from grasp3d.viewer.session import Session
from tests.helpers import shapes
from tests.helpers.held_grasps import JAWS
from tests.helpers.solids import box_mesh
from tests.helpers.viewing import ready_session, wait_until_idle


@pytest.fixture(scope="module")
def labels() -> SurfaceLabels:
    mesh = box_mesh((0.1, 0.2, 0.3), max_edge=0.1)
    return label_surface(mesh, GraspModel(), sampling=Sampling(rays=8))


@pytest.fixture
def session(labels: SurfaceLabels) -> Session:
    return ready_session(collection_of(labels))


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


def test_keys_of_the_window_do_not_change_the_session(session: Session) -> None:
    own = {key for key, action in ACTIONS.items() if action is None}
    before = session.state
    assert own == {"s", "g", "r", "+", "-", "h", "q"}
    assert not any(handle_key(session, key) for key in [*own, "F1"])
    assert session.state == before


def test_a_key_beyond_a_limit_gives_a_message(session: Session) -> None:
    session.change(sensor_resolution=179.0 * DEGREE)
    assert handle_key(session, "Up")
    assert "sensor resolution must" in session.message
    with pytest.raises(SettingError):
        session.change(sensor_resolution=181.0 * DEGREE)
    session.close()
