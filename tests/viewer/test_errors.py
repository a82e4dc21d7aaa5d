"""Errors of friction, normals and contact locations in the viewer."""

import math
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from grasp3d import GraspModel, Label, Sampling, SurfaceLabels, label_surface, load_mesh, write_ply
from grasp3d.errors import MeshError, SettingError
from grasp3d.settings import DEGREE
from grasp3d.viewer.session import planning
from grasp3d.viewer.session.collection import Collection, collection_of, open_collection
from grasp3d.viewer.session.controls import CONTROLS, handle_key
from grasp3d.viewer.session.inspection import inspect
from grasp3d.viewer.session.panel_text import panel_text
from grasp3d.viewer.session.session import Session
from grasp3d.viewer.subjects.subject import subject_of
from grasp3d.viewer.web.page_state import page_state
from tests.helpers import viewing
from tests.helpers.viewing import read_subject, ready_session, rewritten, wait_until_idle

EACH = "location_error=0.02, normal_error=3; friction=0.3..0.9"
WIDE = Sampling(rays=16, search_angle=60.0 * DEGREE)


@pytest.fixture(autouse=True)
def no_delay(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(planning, "DELAY", 0.0)


@cache
def slab() -> SurfaceLabels:
    """A slab: pinched across its thickness, of 4 mm, or held along its length."""
    box = trimesh.creation.box([0.004, 0.06, 0.08])
    return label_surface(load_mesh(box, unit="m", max_edge=0.02), sampling=WIDE)


@pytest.fixture
def session() -> Session:
    return ready_session(slab())


def fractions(session: Session) -> dict[str, float]:
    return {one.letter: one.fraction for one in panel_text(session).fractions}


# Choices


def test_errors_are_chosen_when_they_are_wanted(session: Session) -> None:
    assert not session.state.show_errors
    handle_key(session, "e")
    assert session.state.show_errors
    assert Session(with_model(GraspModel(friction="0.4..0.6"))).state.show_errors


def with_model(model: GraspModel) -> Collection:
    return collection_of(slab().using(model=model))


def test_friction_stays_above_its_error(session: Session) -> None:
    session.change(friction_error=0.2)
    for _ in range(9):
        handle_key(session, "Left")
    assert session.state.model.friction == pytest.approx(0.21)
    with pytest.raises(SettingError, match="below the friction"):
        session.change(friction=0.1)


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("friction_error", "fast", "friction error must be a number"),
        ("friction_error", 0.7, "below the friction"),
        ("normal_error", 90.0, "normal error must be from 0"),
        ("location_error", -1.0, "location error must be a number"),
        ("location_error", None, "location error must be a number"),
    ],
)
def test_a_page_refuses_impossible_errors(
    session: Session, name: str, value: object, message: str
) -> None:
    before = session.state
    with pytest.raises(SettingError, match=message):
        CONTROLS[name].change(session, value)
    assert session.state == before


def location_row(session: Session) -> dict[str, Any]:
    """The slider of the location error."""
    rows = page_state(session)["controls"]
    return next(row for row in rows if row["field"] == "location_error")


def test_the_page_has_the_errors(session: Session) -> None:
    session.change(show_errors=True)
    for name, value in (("friction_error", 0.1), ("normal_error", 2.0), ("location_error", 1e-3)):
        CONTROLS[name].change(session, value)
        assert page_state(session)[name] == pytest.approx(value)
    model = session.state.model
    assert model.friction_interval == pytest.approx((0.4, 0.6))
    assert model.normal_error == pytest.approx(2.0 * DEGREE)
    assert not location_row(session)["problem"]


# Labels


@given(
    friction_error=st.floats(0.0, 0.2),
    normal_error=st.floats(0.0, 0.2),
    location_error=st.floats(0.0, 2e-3),
)
@settings(max_examples=30, deadline=None)
def test_labels_are_those_of_relabel(
    friction_error: float, normal_error: float, location_error: float
) -> None:
    session = ready_session(slab())
    errors: dict[str, Any] = {
        "friction_error": friction_error,
        "normal_error": normal_error,
        "location_error": location_error,
    }
    # Friction that is no more than was searched for.
    session.change(friction=0.5 - friction_error, sensor_resolution=0.1, **errors)
    session.close()
    labels = slab().relabel(friction=0.5 - friction_error, sensor_resolution=0.1, **errors)
    found = fractions(session)
    for letter, fraction in labels.fractions().items():
        assert found[letter] == pytest.approx(fraction, abs=1e-12)


@cache
def tube() -> SurfaceLabels:
    """A tube whose wall, of 4 mm, can be pinched, or held across its diameter of 80 mm.

    It is a little wider at the top, so that a pinch is the better one where contacts are known.
    """
    mesh = trimesh.creation.annulus(0.036, 0.040, 0.06, sections=48)
    mesh.vertices[:, :2] *= 1.0 + mesh.vertices[:, 2:]
    return label_surface(load_mesh(mesh, unit="m", max_edge=0.02), sampling=WIDE)


@pytest.mark.slow
def test_a_location_error_has_grasps_of_its_own() -> None:
    session = ready_session(tube())
    pinched = 1.5e-3  # turns the line of a pinch by 49 degrees
    session.change(location_error=pinched)
    immediate, text = fractions(session), panel_text(session)
    assert session.working is not None
    assert "searching" in session.working[0]
    assert not text.stale
    assert any("another location error" in note for note in text.notes)
    wait_until_idle(session)
    assert fractions(session)["S"] > immediate["S"] + 0.2
    assert not any("location error" in note for note in panel_text(session).notes)
    searched = label_surface(
        tube().mesh, replace(tube().model, location_error=pinched), sampling=WIDE
    )
    assert fractions(session)["S"] == pytest.approx(searched.fractions()["S"], abs=0.02)
    session.change(location_error=0.0)
    wait_until_idle(session)
    assert fractions(session)["S"] == pytest.approx(tube().fractions()["S"])


def test_three_fingers_are_located_in_the_background() -> None:
    session = ready_session(viewing.three_fingers())
    session.change(location_error=0.01)
    assert session.stale
    with pytest.raises(SettingError, match="labels with these errors are still being searched"):
        session.check_current()
    wait_until_idle(session)
    assert not session.failure
    labels = viewing.three_fingers().relabel(location_error=0.01)
    for letter, fraction in labels.fractions().items():
        assert fractions(session)[letter] == pytest.approx(fraction)


def test_fixed_fingers_have_errors_too(session: Session) -> None:
    session.change(click="fix")
    session.click(3)
    wait_until_idle(session)
    before = fractions(session)["S"]
    handle_key(session, "b")
    seen = session.inspection
    assert seen is not None
    session.change(location_error=5e-3)
    wait_until_idle(session)
    after = session.inspection
    assert after is not None
    assert fractions(session)["S"] <= before
    assert "located β*" in dict(after.numbers)
    assert "located β*" not in dict(seen.numbers)


def test_safe_labels_are_said_to_be_safe_once() -> None:
    """Three fingers and a location error; two fingers have exact labels."""
    note = "labels are safe: every S and U is correct, an M may be one of them"
    three = viewing.three_fingers()
    located = three.using(model=replace(three.model, location_error=1e-4))
    for labels, count in ((located, 1), (three, 0), (slab(), 0)):
        text = panel_text(ready_session(labels))
        assert text.notes.count(note) == count
    session = ready_session(slab().using(model=GraspModel(location_error=1e-4)))
    assert note not in panel_text(session).notes


# Inspection


def test_a_vertex_has_a_margin_and_its_budget() -> None:
    labels = slab().relabel(friction_error=0.1, normal_error=0.02, location_error=1e-4)
    subject, model = subject_of(labels), labels.model
    for vertex in np.flatnonzero(np.isfinite(labels.located_angles[0]))[::40]:
        seen = inspect(subject, int(vertex), model)
        numbers = dict(seen.numbers)
        margin = math.degrees(labels.margin[vertex])
        assert float(numbers["margin"].rstrip("°").replace("−", "-")) == pytest.approx(
            margin, abs=0.06
        )
        assert (seen.code == Label.S) == (margin > 0.0)
        total, parts = seen.budget.split(" = ")
        values = [
            float(part.split()[-1].rstrip("°").replace("−", "-")) for part in parts.split("+")
        ]
        assert float(total.removeprefix("β ").rstrip("°")) == pytest.approx(sum(values), abs=0.4)
        for name in ("β*", "friction", "α/2", "normal error", "location", "margin"):
            assert name in seen.budget
        coarsest = math.degrees(labels.max_resolution[vertex])
        shown = f"{coarsest:.1f}°" if coarsest > 0.0 else "no sensor is fine enough"
        assert numbers["α*"] == shown


def test_explanations_name_the_errors() -> None:
    labels = slab().relabel(friction_error=0.1, normal_error=0.02, location_error=1e-4)
    subject = subject_of(labels)
    vertex = int(np.flatnonzero(labels.label == Label.S)[0])
    reason = inspect(subject, vertex, labels.model).reason
    assert "with the contact points anywhere within their location errors β* is " in reason
    assert "below 21.8° − 11.3° − 1.1° = 9.4°" in reason
    assert reason.endswith(
        "for all true normals within the sensor resolution and their error, all contact points "
        "within theirs and any friction of its interval."
    )
    coarse = slab().relabel(location_error=1.9e-3)
    smooth = coarse.critical_angle == coarse.critical_angle_best
    vertex = int(np.flatnonzero((coarse.label == Label.M) & smooth)[0])
    reason = inspect(subject_of(coarse), vertex, coarse.model).reason
    assert "location errors β* is from " in reason
    plain = inspect(subject_of(slab()), 0, slab().model)
    assert "errors" not in plain.reason
    assert "located β*" not in dict(plain.numbers)
    assert plain.budget.startswith("β 26.6° = β* ")


# Files


@pytest.mark.parametrize(
    "model",
    [
        GraspModel(friction="0.4..0.6", normal_error=0.03),
        GraspModel(location_error=5e-4, friction=(0.4, 0.5)),
    ],
)
def test_a_labelled_file_has_the_errors_and_labels_of_its_model(
    tmp_path: Path, model: GraspModel
) -> None:
    labels = slab().using(model=model)
    write_ply(tmp_path / "slab.ply", labels)
    subject = read_subject(tmp_path / "slab.ply")
    assert subject.labels.model == model
    assert subject.locates(model)
    for stored, computed in zip(subject.angles(model), labels.located_angles, strict=True):
        assert np.allclose(stored, computed, atol=1e-6)
    session = ready_session(open_collection(tmp_path / "slab.ply"))
    assert session.subject is not None
    for letter, fraction in labels.fractions().items():
        assert fractions(session)[letter] == pytest.approx(fraction, abs=1e-9)


def test_other_location_errors_of_a_file_are_searched(tmp_path: Path) -> None:
    write_ply(tmp_path / "tube.ply", tube().relabel(location_error=2e-4))
    session = ready_session(open_collection(tmp_path / "tube.ply"))
    session.change(friction=0.4)
    assert not session.stale
    session.change(location_error=1.5e-3)
    assert session.working == ("searching grasps for this location error", 0.0)
    wait_until_idle(session)
    assert not session.stale
    assert fractions(session)["S"] > 0.2


def test_a_file_of_a_scan_has_location_errors(tmp_path: Path) -> None:
    write_ply(tmp_path / "scan.ply", viewing.scan())
    session = ready_session(open_collection(tmp_path / "scan.ply"))
    session.change(location_error=0.01)
    wait_until_idle(session)
    expected = viewing.scan().relabel(location_error=0.01).fractions()
    assert fractions(session) == pytest.approx(expected)


def test_sampled_hulls_have_no_location_error() -> None:
    session = ready_session(with_model(GraspModel(method="extremes")))
    assert "tests normals only" in session.location_problem
    with pytest.raises(SettingError, match="method extremes tests normals only"):
        session.change(location_error=1e-3)


def test_saved_labels_have_the_chosen_errors(session: Session, tmp_path: Path) -> None:
    errors: dict[str, Any] = {
        "friction_error": 0.1, "normal_error": 0.02, "location_error": 5e-4,
    }  # fmt: skip
    session.change(friction=0.4, **errors)
    wait_until_idle(session)
    session.save(tmp_path / "saved.ply")
    wait_until_idle(session)
    model = read_subject(tmp_path / "saved.ply").labels.model
    assert model == replace(slab().model, friction=0.4, **errors)
    again = ready_session(open_collection(tmp_path / "saved.ply"))
    assert fractions(again) == pytest.approx(fractions(session), abs=1e-9)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            b"comment grasp3d friction_error 0.1",
            b"comment grasp3d friction_error 0.9",
            "friction e",
        ),
        (
            b"comment grasp3d location_error 0.0",
            b"comment grasp3d location_error -0.",
            "location error must",
        ),
        (
            b"property double located_angle_best",
            b"property double lacated_angle_best",
            "located_angl",
        ),
        (b"property double located_angle\n", b"property int located_angle\n", "'located_angle' is"),
    ],
)
def test_damaged_errors_are_refused(tmp_path: Path, old: bytes, new: bytes, message: str) -> None:
    path = tmp_path / "slab.ply"
    write_ply(path, slab().relabel(friction_error=0.1, location_error=5e-4))
    rewritten(path, (old, new))
    with pytest.raises(MeshError, match=message):
        open_collection(path).items[0].open()
