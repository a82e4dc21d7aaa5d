"""Uncertain friction and contact locations in the viewer."""

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
from grasp3d.errors import SettingError
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
from tests.helpers.viewing import read_subject, ready_session, wait_until_idle

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


def with_model(model: GraspModel) -> Collection:
    return collection_of(slab().using(model=model))


def test_a_chosen_friction_replaces_the_interval() -> None:
    session = ready_session(slab().using(model=GraspModel(friction=(0.4, 0.6))))
    handle_key(session, "Left")
    assert session.state.model.friction == pytest.approx(0.45)


def location_row(session: Session) -> dict[str, Any]:
    """The slider of the location error."""
    rows = page_state(session)["controls"]
    return next(row for row in rows if row["field"] == "location_error")


def test_the_page_has_the_location_error(session: Session) -> None:
    CONTROLS["location_error"].change(session, 1e-3)
    assert page_state(session)["location_error"] == pytest.approx(1e-3)
    assert not location_row(session)["problem"]


# Labels


@given(resolution=st.floats(0.0, 0.4), location_error=st.floats(0.0, 2e-3))
@settings(max_examples=30, deadline=None)
def test_labels_are_those_of_relabel(resolution: float, location_error: float) -> None:
    session = ready_session(slab())
    chosen: Any = {"sensor_resolution": resolution, "location_error": location_error}
    session.change(**chosen)
    session.close()
    labels = slab().relabel(**chosen)
    found = fractions(session)
    for letter, fraction in labels.fractions().items():
        assert found[letter] == pytest.approx(fraction, abs=1e-12)


def test_bounds_of_three_fingers_are_computed_in_the_background() -> None:
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
    assert "β* bounds" in dict(after.numbers)
    assert "β* bounds" not in dict(seen.numbers)


def test_safe_labels_are_said_to_be_safe_once() -> None:
    note = "labels are safe: every S and U is correct, an M may be one of them"
    three = viewing.three_fingers()
    uncertain = three.using(model=replace(three.model, location_error=1e-4))
    for labels, count in ((uncertain, 1), (three, 0), (slab(), 0)):
        text = panel_text(ready_session(labels))
        assert text.notes.count(note) == count
    session = ready_session(slab().using(model=GraspModel(location_error=1e-4)))
    assert note in panel_text(session).notes


# Inspection


def test_a_vertex_has_a_margin_and_its_budget() -> None:
    labels = slab().relabel(friction=(0.4, 0.6), location_error=1e-4)
    subject, model = subject_of(labels), labels.model
    for vertex in np.flatnonzero(np.isfinite(labels.critical_angle_bounds[0]))[::40]:
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
        for name in ("β*", "friction", "α/2", "location", "margin"):
            assert name in seen.budget
        coarsest = math.degrees(labels.max_resolution[vertex])
        shown = f"{coarsest:.1f}°" if coarsest > 0.0 else "no sensor is fine enough"
        assert numbers["α*"] == shown


def test_explanations_name_the_errors() -> None:
    labels = slab().relabel(friction=(0.4, 0.6), location_error=1e-4)
    subject = subject_of(labels)
    vertex = int(np.flatnonzero(labels.label == Label.S)[0])
    reason = inspect(subject, vertex, labels.model).reason
    assert "with the contact points anywhere within their location errors β* is " in reason
    assert "below 21.8° − 11.3° = 10.5°" in reason
    assert reason.endswith(
        "for all true normals within the sensor resolution, all contact points within their "
        "errors and any friction of its interval."
    )
    coarse = slab().relabel(location_error=1.9e-3)
    smooth = coarse.critical_angle == coarse.critical_angle_best
    vertex = int(np.flatnonzero((coarse.label == Label.M) & smooth)[0])
    reason = inspect(subject_of(coarse), vertex, coarse.model).reason
    assert "location errors β* is from " in reason
    plain = inspect(subject_of(slab()), 0, slab().model)
    assert "errors" not in plain.reason
    assert "β* bounds" not in dict(plain.numbers)
    assert plain.budget.startswith("β 26.6° = β* ")


# Files


@pytest.mark.parametrize(
    "model",
    [
        GraspModel(friction="0.4..0.6"),
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
    for stored, computed in zip(subject.angles(model), labels.critical_angle_bounds, strict=True):
        assert np.allclose(stored, computed, atol=1e-6)
    session = ready_session(open_collection(tmp_path / "slab.ply"))
    assert session.subject is not None
    for letter, fraction in labels.fractions().items():
        assert fractions(session)[letter] == pytest.approx(fraction, abs=1e-9)


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
