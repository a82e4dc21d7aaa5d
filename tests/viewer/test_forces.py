"""Grip force and payload in the viewer: panel, colours, files, and new searches."""

import math
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from grasp3d import GraspModel, Label, SurfaceLabels, label_surface, load_mesh, write_ply
from grasp3d.describe.explanations import load_sentence
from grasp3d.errors import SettingError
from grasp3d.pictures.colors import MOST, corner_values, ramp_of
from grasp3d.pictures.view_settings import ViewSettings
from grasp3d.quality.grip_forces import Resistance
from grasp3d.quality.loads import Load
from grasp3d.surface import Reason
from grasp3d.surface.load_case import LoadResult
from grasp3d.viewer import session as sessions
from grasp3d.viewer.collection import collection_of, open_collection
from grasp3d.viewer.controls import handle_key, offered_paints
from grasp3d.viewer.panel_text import panel_text
from grasp3d.viewer.session import Session
from tests.helpers import viewing
from tests.helpers.viewing import read_subject, ready_session, wait_until_idle

SOFT = GraspModel(friction=0.5, torsion_radius=0.3)
LOAD = Load(mass=0.5, grip_force=20.0)


@pytest.fixture(autouse=True)
def no_delay(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sessions, "DELAY", 0.0)


@cache
def held() -> SurfaceLabels:
    """A box of 0.5 kg with soft fingers; near its edges no force suffices."""
    box = trimesh.creation.box([8.0, 5.0, 3.0])
    labels = label_surface(load_mesh(box, max_edge="2cm", unit="cm"), SOFT)
    return labels.using(load=LOAD)


@pytest.fixture
def session() -> Session:
    return ready_session(held().using())  # nothing is computed yet


def weakest(labels: SurfaceLabels) -> tuple[int, int]:
    """Vertices with the smallest grip force, and with an infinite one."""
    assert labels.load_result is not None
    force = labels.load_result.grip_force
    return int(np.nanargmin(force)), int(np.flatnonzero(np.isinf(force))[0])


# Panel


@pytest.mark.slow
def test_the_panel_lists_force_and_payload_of_the_clicked_vertex(session: Session) -> None:
    best, _ = weakest(held())
    session.click(best)
    seen, load_result = session.inspection, held().load_result
    assert seen is not None
    assert load_result is not None
    numbers = dict(seen.numbers)
    force, most = load_result.grip_force[best], load_result.grip_force_largest[best]
    assert most > force * 1.01
    assert numbers["force at the nominal normals"] == f"{force:.3g} N"
    assert numbers["force at the worst normals"] == f"{most:.3g} N"
    assert numbers["payload"] == f"{load_result.payload[best]:.3g} kg"
    assert "With 20 N the load of 0.5 kg is held at all normals" in seen.reason
    assert panel_text(session).facts.endswith("; load 0.5 kg, 20 N at hand")


def test_the_panel_says_why_no_force_suffices(session: Session) -> None:
    _, none = weakest(held())
    session.click(none)
    seen = session.inspection
    assert seen is not None
    assert "force at the nominal normals" not in dict(seen.numbers)
    assert "the fingers can only push" in seen.reason


def test_two_hard_fingers_have_their_own_reason() -> None:
    labels = held().using(model=GraspModel(), load=Load(mass=0.5))
    session = ready_session(labels)
    assert labels.load_result is not None
    unresisted = labels.load_result.resistance == Resistance.NO_SUCH_WRENCH
    session.click(int(np.flatnonzero(unresisted & (labels.label == Label.S))[0]))
    seen = session.inspection
    assert seen is not None
    assert not {"force at the worst normals", "payload"} & dict(seen.numbers).keys()
    assert "two hard fingers cannot resist a torque about the line through them" in seen.reason
    assert "give a torsion radius (--torsion-radius) or a gripper" in seen.reason


@pytest.mark.parametrize(
    ("least", "nominal", "largest", "sentence"),
    [
        (5.0, 10.0, 20.0, "held at all normals"),
        (5.0, 10.0, 21.0, "held at some of the normals"),
        (21.0, 25.0, math.inf, "held at none"),
        (5.0, math.inf, math.inf, "No force holds it at the nominal normals: they resist"),
        (math.inf, math.inf, math.inf, "No force holds it: they resist"),
        (math.nan, math.nan, math.nan, ""),
    ],
)
def test_the_sentence_is_that_of_the_label_with_force(
    least: float, nominal: float, largest: float, sentence: str
) -> None:
    case = held().load_case
    assert case is not None
    forces = (np.array([force]) for force in (nominal, least, largest, 1.0))
    load_result = LoadResult(case, *forces, np.array([Resistance.NO_SUCH_WRENCH]), "exact")
    found = load_sentence(load_result, 0)
    assert sentence in found
    assert bool(found) == bool(sentence)
    unknown = replace(
        load_result, case=replace(case, mass=None, available=None), payload=np.array([math.nan])
    )
    assert not (math.isfinite(nominal) and load_sentence(unknown, 0))


def test_without_a_load_nothing_is_added() -> None:
    session = ready_session(viewing.labels())
    session.click(40)
    assert session.inspection is not None
    assert "payload" not in dict(session.inspection.numbers)
    assert not {"grip_force", "payload"} & offered_paints(session).keys()
    assert "load" not in panel_text(session).facts
    for key in ("7", "8"):
        state = session.state
        assert handle_key(session, key)
        assert "there is no load" in session.message
        assert session.state == state


def test_payload_needs_a_force_at_hand() -> None:
    session = ready_session(held().using(load=Load(mass=0.5)))
    with pytest.raises(SettingError, match="force at hand is not known"):
        session.change(paint="payload")
    session.change(paint="grip_force")
    assert "grip_force" in offered_paints(session)
    assert "payload" not in offered_paints(session)


# Colours


@pytest.mark.slow
@pytest.mark.parametrize("paint", ["grip_force", "payload"])
def test_colours_are_computed_and_follow_the_values(session: Session, paint: str) -> None:
    session.change(paint=paint)
    before = ramp_of(viewing.uncomputed(session), session.state.paint)
    assert before is not None
    assert before.grey == "not computed yet"
    wait_until_idle(session)
    subject, load_result = session.subject, held().load_result
    assert subject is not None
    assert load_result is not None
    values = load_result.grip_force if paint == "grip_force" else load_result.payload
    ramp = ramp_of(subject, session.state.paint)
    assert ramp is not None
    known = np.isfinite(values)
    area = subject.weights[known & (values <= ramp.maximum)].sum() / subject.weights[known].sum()
    assert area >= MOST
    assert ramp.exceeded == (values[known].max() > ramp.maximum)
    assert ramp.end.endswith(" N" if paint == "grip_force" else " kg")
    assert ramp.end.startswith("≥") == ramp.exceeded
    drawn = corner_values(subject, session.state.paint)
    corners = subject.mesh.corner_normals.vertices
    expected = np.where(known, values, np.nan)[corners]
    assert np.array_equal(drawn, expected, equal_nan=True)
    assert ("no force suffices" in ramp.grey) == bool(np.isinf(values).any())


@pytest.mark.slow
def test_forces_are_computed_again_for_another_friction(session: Session) -> None:
    session.change(paint="grip_force")
    wait_until_idle(session)
    session.change(friction=0.4)
    ramp = ramp_of(viewing.uncomputed(session), "grip_force")
    assert ramp is not None
    assert ramp.grey == "not computed yet"
    wait_until_idle(session)
    ramp = panel_text(session).ramp
    assert ramp is not None
    assert "computed" not in ramp.grey
    subject = session.subject
    assert subject is not None
    relabelled = held().relabel(friction=0.4).load_result
    assert relabelled is not None
    assert np.array_equal(subject.labels.grip_force, relabelled.grip_force, equal_nan=True)


@pytest.mark.slow
def test_with_fixed_fingers_there_are_no_forces(session: Session) -> None:
    session.change(paint="payload")
    session.change(click="fix")
    session.click(30)
    wait_until_idle(session)
    ramp = panel_text(session).ramp
    assert ramp is not None
    assert ramp.text == "payload of the contacts: with fixed fingers no grip forces are computed"
    with pytest.raises(SettingError, match="with fixed fingers"):
        session.change(paint="grip_force")
    session.change(fixed=())
    wait_until_idle(session)
    assert session.offers("grip_force")


@pytest.mark.slow
def test_a_new_search_keeps_the_load(session: Session) -> None:
    session.change(fingers=3)
    wait_until_idle(session)
    subject = session.subject
    assert subject is not None
    assert subject.labels.load == LOAD
    assert subject.labels.model.fingers == 3


# Files


@pytest.mark.slow
def test_a_labelled_file_has_its_forces(tmp_path: Path) -> None:
    path = tmp_path / "held.ply"
    write_ply(path, held())
    subject = read_subject(path)
    load_result = held().load_result
    assert subject.labels.computed("load_result") is not None
    assert load_result is not None
    assert subject.labels.load == LOAD
    assert subject.labels.load_case == held().load_case
    for name in ("grip_force", "grip_force_least", "grip_force_largest", "payload", "resistance"):
        stored, computed = getattr(subject.labels.load_result, name), getattr(load_result, name)
        assert np.array_equal(stored, computed, equal_nan=name != "resistance")
    session = Session(open_collection(path), ViewSettings(paint="payload"))
    wait_until_idle(session)
    assert session.subject is not None
    session.change(friction=0.4)
    wait_until_idle(session)
    assert not session.failure
    assert session.subject.labels.computed("load_result") is not None
    assert session.subject.model.friction == 0.4


PULL = "wrench 0,0,-5,0,0,0"


def pulled(task: Any = PULL, force: float | None = 20.0) -> SurfaceLabels:
    """Labels for a task of a given wrench, which does not depend on the mass."""
    return held().using(load=Load(task=task, grip_force=force))


@pytest.mark.slow
@pytest.mark.parametrize("force", [None, 20.0])
def test_a_task_of_wrenches_mentions_no_mass(tmp_path: Path, force: float | None) -> None:
    path = tmp_path / "pulled.ply"
    write_ply(path, pulled(force=force))
    case = read_subject(path).labels.load_case
    assert case is not None
    assert case == pulled(force=force).load_case
    assert (case.by_mass, case.available) == (False, force)
    for collection in (collection_of(pulled(force=force)), open_collection(path)):
        session = Session(collection, ViewSettings(paint="grip_force"))
        wait_until_idle(session)
        session.click(int(np.flatnonzero(held().reason == Reason.FOUND)[0]))
        wait_until_idle(session)
        text = panel_text(session)
        assert text.ramp is not None
        assert text.ramp.text.startswith("grip force of each contact for given wrenches")
        assert session.inspection is not None
        numbers = [value for _, value in session.inspection.numbers]
        shown = " ".join([text.facts, session.inspection.reason, *numbers])
        assert "kg" not in shown
        assert "given wrenches" in text.facts
        assert not session.offers("payload")
        assert force is None or "With 20 N the load is" in shown or "No force holds it" in shown
