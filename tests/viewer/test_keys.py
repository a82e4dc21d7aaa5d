"""Keys of the viewer, and undo."""

from typing import Any

import pytest

from grasp3d import GraspModel, Sampling, SurfaceLabels, label_surface
from grasp3d.errors import SettingError
from grasp3d.mesh.primitives import box_mesh
from grasp3d.settings import DEGREE
from grasp3d.viewer.session.collection import collection_of
from grasp3d.viewer.session.controls import ACTIONS, handle_key
from grasp3d.viewer.session.history import History
from grasp3d.viewer.session.session import Session
from tests.helpers.viewing import ready_session


@pytest.fixture(scope="module")
def labels() -> SurfaceLabels:
    mesh = box_mesh((0.1, 0.2, 0.3), max_edge=0.1)
    return label_surface(mesh, GraspModel(), sampling=Sampling(rays=8))


@pytest.fixture
def session(labels: SurfaceLabels) -> Session:
    return ready_session(collection_of(labels))


@pytest.mark.parametrize("paint", ["critical_angle", "max_resolution", "epsilon", "epsilon_min"])
def test_colours_without_a_resolution_are_not_compared(session: Session, paint: Any) -> None:
    session.change(compare=40.0 * DEGREE)
    assert session.other_model is not None
    session.change(paint=paint)
    assert session.other_model is None
    before = session.state
    assert handle_key(session, "c")
    assert session.message.endswith("two resolutions are compared in the colours S, M, U")
    assert session.state == before
    session.change(paint="label")
    assert session.other_model is not None
    assert session.state.compare == pytest.approx(40.0 * DEGREE)
    session.close()


def test_undo_restores_states_step_by_step(session: Session) -> None:
    history = History(session)
    state = [session.state]
    for key in ("Right", "c", "2", "f"):
        handle_key(session, key)
        history.record()
        history.record()
        state.append(session.state)
    for before in reversed(state[:-1]):
        history.undo()
        assert session.state == before
    history.undo()
    assert session.message == "nothing to undo"


def test_keys_of_the_window_do_not_change_the_session(session: Session) -> None:
    own = {key for key, action in ACTIONS.items() if action is None}
    before = session.state
    assert own == {"s", "g", "r", "+", "-", "z", "h", "q"}
    assert not any(handle_key(session, key) for key in [*own, "w", "F1"])
    assert session.state == before


def test_a_key_beyond_a_limit_gives_a_message(session: Session) -> None:
    session.change(sensor_resolution=179.0 * DEGREE)
    assert handle_key(session, "Up")
    assert "sensor resolution must" in session.message
    with pytest.raises(SettingError):
        session.change(sensor_resolution=181.0 * DEGREE)
    session.close()
