"""Uncertain friction and contact locations in the viewer."""

import math
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from grasp3d import GraspModel, Label, Sampling, SurfaceLabels, label_surface, load_mesh, write_ply
from grasp3d.pictures.subject import subject_of
from grasp3d.settings import DEGREE
from grasp3d.viewer import session as sessions
from grasp3d.viewer.collection import open_collection
from grasp3d.viewer.controls import handle_key
from grasp3d.viewer.inspection import inspect
from grasp3d.viewer.panel_text import panel_text
from grasp3d.viewer.session import Session
from tests.helpers import viewing
from tests.helpers.viewing import read_subject, ready_session

WIDE = Sampling(rays=16, search_angle=60.0 * DEGREE)


@pytest.fixture(autouse=True)
def no_delay(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sessions, "DELAY", 0.0)


@cache
def slab(location_error: float = 0.0) -> SurfaceLabels:
    """A slab: pinched across its thickness, of 4 mm, or held along its length."""
    box = load_mesh(trimesh.creation.box([0.004, 0.06, 0.08]), unit="m", max_edge=0.02)
    return label_surface(box, GraspModel(location_error=location_error), sampling=WIDE)


@pytest.fixture
def session() -> Session:
    return ready_session(slab())


def fractions(session: Session) -> dict[str, float]:
    return {one.letter: one.fraction for one in panel_text(session).fractions}


# Choices


def test_a_chosen_friction_replaces_the_interval() -> None:
    session = ready_session(slab().using(model=GraspModel(friction=(0.4, 0.6))))
    handle_key(session, "Left")
    assert session.state.model.friction == pytest.approx(0.45)


# Labels


@given(resolution=st.floats(0.0, 0.4), location_error=st.sampled_from([0.0, 1e-4, 5e-4]))
@settings(max_examples=30, deadline=None)
def test_labels_are_those_of_relabel(resolution: float, location_error: float) -> None:
    labels = slab(location_error)
    session = ready_session(labels)
    session.change(sensor_resolution=resolution)
    session.close()
    found = fractions(session)
    for letter, fraction in labels.relabel(sensor_resolution=resolution).fractions().items():
        assert found[letter] == pytest.approx(fraction, abs=1e-12)


def test_safe_labels_are_said_to_be_safe_once() -> None:
    note = "labels are safe: every S and U is correct, an M may be one of them"
    three = viewing.three_fingers()
    for labels, count in ((slab(1e-4), 1), (three, 0), (slab(), 0)):
        text = panel_text(ready_session(labels))
        assert text.notes.count(note) == count


# Inspection


def test_a_vertex_has_a_margin() -> None:
    labels = slab(1e-4).relabel(friction=(0.4, 0.6))
    subject, model = subject_of(labels), labels.model
    for vertex in np.flatnonzero(np.isfinite(labels.critical_angle))[::40]:
        seen = inspect(subject.at(model), int(vertex))
        numbers = dict(seen.numbers)
        margin = math.degrees(labels.margin[vertex])
        assert float(numbers["margin"].rstrip("°").replace("−", "-")) == pytest.approx(
            margin, abs=0.06
        )
        assert (seen.code == Label.S) == (margin > 0.0)
        coarsest = math.degrees(labels.max_resolution[vertex])
        assert numbers["α*"] == f"{coarsest:.1f}°"


def test_explanations_name_the_errors() -> None:
    labels = slab(1e-4).relabel(friction=(0.4, 0.6))
    subject = subject_of(labels)
    smooth = labels.mesh.contact_normals.counts == 1
    vertex = int(np.flatnonzero((labels.label == Label.S) & smooth)[0])
    reason = inspect(subject.at(labels.model), vertex).reason
    assert "for the worst of the contact points within their location errors β* is " in reason
    assert "below 21.8° − 11.3° = 10.5°" in reason
    assert reason.endswith(
        "for all true normals within the sensor resolution, all contact points within their "
        "errors and any friction of its interval."
    )
    coarse = slab(1.9e-3)
    vertex = int(np.flatnonzero((coarse.label == Label.M) & smooth)[0])
    reason = inspect(subject_of(coarse), vertex).reason
    assert "for the best of the contact points within their location errors; surely" in reason
    plain = inspect(subject_of(slab()).at(slab().model), 0)
    assert "errors" not in plain.reason


# Files


@pytest.mark.parametrize("location_error", [0.0, 5e-4])
def test_a_labelled_file_has_the_errors_and_labels_of_its_model(
    tmp_path: Path, location_error: float
) -> None:
    labels = slab(location_error).relabel(friction=(0.4, 0.5))
    write_ply(tmp_path / "slab.ply", labels)
    subject = read_subject(tmp_path / "slab.ply")
    assert subject.labels.model == labels.model
    for name in ("critical_angle", "critical_angle_best"):
        stored, computed = (getattr(one, name) for one in (subject.labels, labels))
        assert np.allclose(stored, computed, atol=1e-6)
    session = ready_session(open_collection(tmp_path / "slab.ply"))
    assert session.subject is not None
    for letter, fraction in labels.fractions().items():
        assert fractions(session)[letter] == pytest.approx(fraction, abs=1e-9)
