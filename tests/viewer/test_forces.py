"""Grip force and payload in the viewer: panel, colours, files, and new searches."""

import math
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import trimesh

from grasp3d import GraspModel, Label, SurfaceLabels, label_surface, load_mesh, write_ply
from grasp3d.describe.explanations import load_sentence
from grasp3d.errors import SettingError
from grasp3d.pictures.colors import MOST, corner_values, ramp_of
from grasp3d.pictures.view_settings import Paint
from grasp3d.quality.grip_forces import Resistance
from grasp3d.quality.loads import Load
from grasp3d.surface import Reason
from grasp3d.surface.load_case import LoadResult
from grasp3d.viewer.collection import collection_of, open_collection
from grasp3d.viewer.controls import offered_paints
from grasp3d.viewer.panel_text import panel_text
from grasp3d.viewer.session import Session
from tests.helpers import viewing
from tests.helpers.viewing import inspected, read_subject, ready_session, shown, wait_until_idle

SOFT = GraspModel(friction=0.5, torsion_radius=0.3)
LOAD = Load(mass=0.5, grip_force=20.0)


@cache
def held() -> SurfaceLabels:
    """A box of 0.5 kg with soft fingers; near its edges no force suffices."""
    box = trimesh.creation.box([8.0, 5.0, 3.0])
    labels = label_surface(load_mesh(box, max_edge="2cm", unit="cm"), SOFT)
    return labels.using(load=LOAD)


@pytest.fixture
def session() -> Session:
    return ready_session(held().using())  # nothing is computed yet


def test_the_panel_lists_force_and_payload_or_why_no_force_suffices(session: Session) -> None:
    result = held().load_result
    best = int(np.nanargmin(result.grip_force))
    session.click(best)
    numbers, reason = dict(inspected(session).numbers), inspected(session).reason
    force, most = result.grip_force[best], result.grip_force_largest[best]
    assert most > force * 1.01
    assert numbers["force at the nominal normals"] == f"{force:.3g} N"
    assert numbers["force at the worst normals"] == f"{most:.3g} N"
    assert numbers["payload"] == f"{result.payload[best]:.3g} kg"
    assert "With 20 N the load of 0.5 kg is held at all normals" in reason
    assert panel_text(session).facts.endswith("; load 0.5 kg, 20 N available")
    session.click(int(np.flatnonzero(np.isinf(result.grip_force))[0]))
    assert "force at the nominal normals" not in dict(inspected(session).numbers)
    assert "the fingers can only push" in inspected(session).reason


def test_two_hard_fingers_have_their_own_reason_and_without_a_force_no_payload() -> None:
    labels = held().using(model=GraspModel(), load=Load(mass=0.5))
    session = ready_session(labels)
    unresisted = labels.load_result.resistance == Resistance.NO_SUCH_WRENCH
    session.click(int(np.flatnonzero(unresisted & (labels.label == Label.S))[0]))
    seen = inspected(session)
    assert not {"force at the worst normals", "payload"} & dict(seen.numbers).keys()
    assert "two hard fingers cannot resist a torque about the line through them" in seen.reason
    assert "give a torsion radius (--torsion-radius) or a gripper" in seen.reason
    with pytest.raises(SettingError, match="available force is not known"):
        session.change(paint="payload")
    assert "grip_force" in offered_paints(session)
    assert "payload" not in offered_paints(session)


@pytest.mark.parametrize(
    ("least", "nominal", "largest", "sentence"),
    [
        (5.0, 10.0, 20.0, "held at all normals"),
        (5.0, 10.0, 21.0, "held only at some of the normals"),
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
    forces = (np.array([force]) for force in (nominal, least, largest, 1.0))
    load_result = LoadResult(case, *forces, np.array([Resistance.NO_SUCH_WRENCH]), "exact")
    found = load_sentence(load_result, 0)
    assert sentence in found
    assert bool(found) == bool(sentence)
    unknown = replace(
        load_result, case=replace(case, mass=None, available=None), payload=np.array([math.nan])
    )
    assert not (math.isfinite(nominal) and load_sentence(unknown, 0))


@pytest.mark.parametrize(("paint", "unit"), [("grip_force", " N"), ("payload", " kg")])
def test_colours_are_computed_and_follow_the_values(
    session: Session, paint: Paint, unit: str
) -> None:
    session.change(paint=paint, friction=0.4)
    assert ramp_of(viewing.uncomputed(session), paint).grey == "not computed yet"
    wait_until_idle(session)
    subject, values = shown(session), getattr(held().relabel(friction=0.4).load_result, paint)
    ramp, known = ramp_of(subject, paint), np.isfinite(values)
    area = subject.weights[known & (values <= ramp.maximum)].sum() / subject.weights[known].sum()
    assert area >= MOST
    assert ramp.exceeded == (values[known].max() > ramp.maximum) == ramp.end.startswith("≥")
    assert ramp.end.endswith(unit)
    expected = np.where(known, values, np.nan)[subject.mesh.corner_normals.vertices]
    assert np.array_equal(corner_values(subject, paint), expected, equal_nan=True)
    assert ("no force suffices" in ramp.grey) == bool(np.isinf(values).any())


def test_with_fixed_fingers_there_are_no_forces_and_a_new_search_keeps_the_load(
    session: Session,
) -> None:
    session.change(paint="payload")
    session.change(click="fix")
    session.click(30)
    wait_until_idle(session)
    title = panel_text(session).ramp.text
    assert title == "payload of the contacts: with fixed fingers no grip forces are computed"
    with pytest.raises(SettingError, match="with fixed fingers"):
        session.change(paint="grip_force")
    session.change(fixed=(), fingers=3)
    wait_until_idle(session)
    assert session.offers("grip_force")
    assert (shown(session).labels.load, shown(session).model.fingers) == (LOAD, 3)


def test_a_labelled_file_has_its_forces(tmp_path: Path) -> None:
    path = tmp_path / "held.ply"
    write_ply(path, held())
    found = read_subject(path).labels
    assert found.computed("load_result") is not None
    assert (found.load, found.load_case) == (LOAD, held().load_case)
    for name in ("grip_force", "grip_force_least", "grip_force_largest", "payload", "resistance"):
        both = getattr(found.load_result, name), getattr(held().load_result, name)
        assert np.array_equal(*both, equal_nan=name != "resistance")
    session = ready_session(open_collection(path))
    session.change(paint="payload", friction=0.4)
    wait_until_idle(session)
    assert not session.failure
    assert shown(session).labels.computed("load_result") is not None


PULL = "wrench 0,0,-5,0,0,0"


@pytest.mark.parametrize("force", [None, 20.0])
def test_a_task_of_wrenches_mentions_no_mass(tmp_path: Path, force: float | None) -> None:
    path, pulled = tmp_path / "pulled.ply", held().using(load=Load(task=PULL, grip_force=force))
    write_ply(path, pulled)
    case = read_subject(path).labels.load_case
    assert case == pulled.load_case
    assert (case.by_mass, case.available) == (False, force)
    for collection in (collection_of(pulled), open_collection(path)):
        session = ready_session(collection)
        session.change(paint="grip_force")
        session.click(int(np.flatnonzero(held().reason == Reason.FOUND)[0]))
        wait_until_idle(session)
        text, seen = panel_text(session), inspected(session)
        assert text.ramp.text.startswith("grip force of each contact for given wrenches")
        said = " ".join([text.facts, seen.reason, *(value for _, value in seen.numbers)])
        assert "kg" not in said
        assert "given wrenches" in text.facts
        assert not session.offers("payload")
        assert force is None or "With 20 N the load is" in said or "No force holds it" in said
