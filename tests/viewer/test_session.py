"""A session: choices, searches, scans and saving, and the worker that does its jobs."""

import math
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from grasp3d import GraspError, GraspModel, Label, Sampling, label_surface, scan_surface
from grasp3d.errors import MeshError, OutputError, SettingError
from grasp3d.pictures.colors import UNSEARCHED, ramp_of
from grasp3d.pictures.subject import Subject, subject_of
from grasp3d.pictures.view_settings import ViewSettings
from grasp3d.surface.vertex_fields import SearchReport
from grasp3d.system.context import report_progress
from grasp3d.viewer import session as sessions
from grasp3d.viewer.collection import Collection, Item, collection_of, open_collection
from grasp3d.viewer.page import page_state
from grasp3d.viewer.panel_text import panel_text
from grasp3d.viewer.session import Job, Session, Worker
from tests.helpers import viewing
from tests.helpers.viewing import (
    fractions,
    has_begun,
    inspected,
    read_subject,
    ready_session,
    shown,
    wait_until_idle,
)


def changed(session: Session, **choices: object) -> Session:
    """The session after a choice, and all that it makes necessary."""
    session.change(**choices)
    wait_until_idle(session)
    return session


def test_a_session_begins_with_its_settings() -> None:
    session = Session(collection_of(viewing.labels()), ViewSettings(paint="critical_angle"))
    assert (session.working is None, session.subject, fractions(session)) == (False, None, {})
    wait_until_idle(session)
    assert session.model == viewing.labels().model
    assert session.state.paint == "critical_angle"
    assert session.name == panel_text(session).title == viewing.labels().mesh.report.source


def test_sliders_change_the_labels_without_a_search() -> None:
    session = ready_session(viewing.labels())
    before, subject = session.revision, shown(session)
    session.change(friction=0.6, sensor_resolution=0.2)
    assert (session.revision, session.working) == (before + 1, None)
    assert shown(session).labels.contacts is subject.labels.contacts
    expected = viewing.labels().relabel(friction=0.6, sensor_resolution=0.2).fractions()
    assert fractions(session) == pytest.approx(expected)
    session.change(friction=0.6)
    assert session.revision == before + 1
    assert not session.poll()


@pytest.mark.parametrize(
    ("choice", "message"),
    [
        ({"friction": -1.0}, "friction must be"),
        ({"sensor_resolution": 4.0}, "below 180 degrees"),
        ({"fingers": 6}, "fingers must be from 2 to 5"),
        ({"paint": "red"}, "no paint is called 'red'"),
        ({"fixed": ((0.0, 0.0, math.nan),)}, "three finite coordinates"),
        ({"fixed": ((0.0, 0.0, 0.0),) * 2}, "of 2 fingers at most 1 can be fixed; got 2"),
        ({"colour": 1}, "has no setting 'colour'"),
    ],
)
def test_invalid_choices_change_nothing(choice: dict[str, object], message: str) -> None:
    session = ready_session(viewing.labels())
    state, revision = session.state, session.revision
    with pytest.raises(SettingError, match=message):
        session.change(**choice)
    assert (session.state, session.revision) == (state, revision)


def test_a_vertex_is_inspected_until_a_click_beside_the_object() -> None:
    session = ready_session(viewing.labels())
    session.click(40)
    assert inspected(session).vertex == 40
    assert session.inspection is session.inspection
    session.change(friction=0.7)
    assert inspected(session).model.friction == 0.7
    session.click(None)
    assert session.inspection is None
    with pytest.raises(SettingError, match="there is no vertex"):
        session.click(10**6)


def test_more_friction_than_searched_starts_a_wider_search_that_changes_no_known_grasp() -> None:
    known = viewing.labels()
    session = ready_session(known)
    cone, before = shown(session).cone, fractions(session)
    session.change(friction=2.0)
    text = panel_text(session)
    assert has_begun(session, "searching grasps")
    assert text.fractions[-1].text == "not searched"
    assert any("grey vertices need a wider search" in note for note in text.notes)
    with pytest.raises(GraspError, match="are not searched yet"):
        session.save(Path("a.ply"))
    wait_until_idle(session)
    found = shown(session).labels
    assert shown(session).cone == math.pi / 2 > cone
    wide = replace(known.sampling or Sampling(), search_angle=math.pi / 2)
    expected = label_surface(known.mesh, session.model, sampling=wide).critical_angle
    kept = known.critical_angle <= cone
    assert np.array_equal(
        found.critical_angle,
        np.where(kept, known.critical_angle, np.minimum(known.critical_angle, expected)),
    )
    assert np.array_equal(found.partners[kept], known.partners[kept])
    assert np.array_equal(found.opening[kept], known.opening[kept])
    session.change(friction=known.model.friction)
    assert session.working is None  # the widest search covers every model
    assert fractions(session) == before


def test_a_newer_choice_replaces_a_running_search() -> None:
    session = ready_session(viewing.box())
    session.change(fingers=3)
    assert session.model.fingers == 2  # of the surface that is still displayed
    changed(session, fingers=4)
    assert shown(session).labels.model.fingers == session.model.fingers == 4
    session.change(fingers=3)
    session.change(fingers=4)
    assert session.working is None


def test_a_failed_job_is_reported_and_not_repeated() -> None:
    labels, tries = viewing.three_fingers(), list[int]()

    def fail() -> Subject:
        tries.append(1)
        raise MeshError("the mesh is too large")

    items = Item("a", fail), Item("b", lambda: subject_of(labels))
    session = ready_session(Collection(items, labels.model, Sampling(candidates=8)))
    with pytest.raises(SettingError, match="nothing to save yet"):
        session.save(Path("a.ply"))
    session.click(3)
    changed(session, paint="critical_angle")
    assert (session.message, session.subject) == ("the mesh is too large", None)
    assert len(tries) == 1
    session.step(1)
    wait_until_idle(session)
    assert (shown(session).name, session.message) == (labels.mesh.report.source, "")
    session.step(-1)
    wait_until_idle(session)
    assert len(tries) == 2


@pytest.mark.parametrize(
    ("choice", "missing"),
    [
        ({"fingers": 3}, "grasps for 3 fingers"),
        ({"fingers": 3, "fixed": ((0.5, 0.0, 0.0),) * 2}, "labels for 2 fixed fingers"),
    ],
)
def test_old_grasps_are_not_shown_while_new_ones_are_searched(
    choice: dict[str, object], missing: str, tmp_path: Path
) -> None:
    session = ready_session(viewing.box())
    session.click(4)
    assert not session.stale
    session.change(**choice)
    assert session.stale
    assert (panel_text(session).stale, fractions(session), session.inspection) == (True, {}, None)
    with pytest.raises(SettingError, match=f"the {missing} are still being searched; save when"):
        session.save(tmp_path / "a.ply")
    session.click(9, inspect=True)
    assert session.inspection is None
    wait_until_idle(session)
    assert (panel_text(session).stale, len(fractions(session))) == (False, 3)
    assert inspected(session).vertex == 9


def test_the_surface_stays_stale_if_the_search_fails_which_another_friction_tries_again(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    tried: list[float] = []

    def fail(_: Subject, model: GraspModel, __: Sampling) -> Subject:
        tried.append(model.nominal_friction)
        raise SettingError("too little memory")

    monkeypatch.setattr(sessions, "search_grasps", fail)
    session = ready_session(viewing.box())
    for friction in (0.5, 0.6):
        changed(session, fingers=3, friction=friction)
        assert session.failure == "too little memory"
    assert tried == [0.5, 0.6]
    assert (session.stale, fractions(session)) == (True, {})
    with pytest.raises(SettingError, match="are no grasps for 3 fingers; change the settings"):
        session.save(tmp_path / "a.ply")
    session.change(fingers=2)
    assert not session.stale


def test_the_last_searches_are_cached() -> None:
    session = ready_session(viewing.box())
    first = session.subject
    second = changed(session, fingers=3).subject
    session.change(fingers=2)
    assert (session.working, session.subject, session.stale) == (None, first, False)
    changed(session, fingers=4).change(fingers=3)
    assert (session.working, session.subject) == (None, second)
    changed(session, fingers=5).change(fingers=2)
    # Three others were searched since, but it was opened.
    assert (session.working, session.subject) == (None, first)
    session.change(fingers=4)
    assert session.working is not None
    session.close()


def test_a_click_fixes_a_finger_and_another_moves_it() -> None:
    labels = viewing.labels()
    session = ready_session(labels)
    session.change(click="fix")
    session.click(30)
    assert has_begun(session, "scanning")
    wait_until_idle(session)
    expected = scan_surface(labels.mesh, labels.model, fixed=labels.mesh.vertices[30])
    assert shown(session).labels.mode == "scan"
    assert np.array_equal(shown(session).labels.critical_angle, expected.critical_angle)
    assert "1 finger fixed" in panel_text(session).facts
    session.click(31)
    wait_until_idle(session)
    assert len(session.state.fixed) == 1
    session.click(60, inspect=True)
    assert inspected(session).points[1] == pytest.approx(labels.mesh.vertices[31])
    assert shown(changed(session, fixed=())).labels.mode == "label"


def test_two_of_three_fingers_are_fixed_one_after_the_other() -> None:
    session = ready_session(viewing.three_fingers())
    session.change(click="fix")
    for vertex, fingers in ((3, 2), (20, 3)):
        session.click(vertex)
        wait_until_idle(session)
        assert session.model.fingers == fingers
        lacks = any("fix 1 more finger: these are" in note for note in panel_text(session).notes)
        assert lacks == (fingers == 2)
    assert "2 fingers fixed" in panel_text(session).facts
    changed(session, fingers=2)
    assert len(session.state.fixed) == 1
    assert (shown(session).labels.mode, session.model.fingers) == ("scan", 2)


def test_epsilon_is_computed_when_it_is_shown_for_the_grasps_that_are_shown() -> None:
    labels = viewing.box()
    session = ready_session(labels.using(model=labels.model))
    session.change(paint="epsilon_min")
    assert has_begun(session, "computing ε")
    wait_until_idle(session)
    session.change(friction=0.45)
    ramp = ramp_of(viewing.uncomputed(session), "epsilon_min")
    assert ramp is not None
    assert (ramp.text, ramp.grey) == ("ε_min: smallest over all tilts", "not computed yet")
    changed(session, fingers=3).change(fingers=2)
    wait_until_idle(session)
    found, expected = shown(session).labels, labels.relabel(friction=0.45)
    assert found.computed("epsilon_range") is not None
    assert found.epsilon_min == pytest.approx(expected.epsilon_min, nan_ok=True)
    session.change(click="fix")
    session.click(9)
    wait_until_idle(session)
    assert shown(session).labels.mode == "scan"
    assert shown(session).labels.computed("epsilon_range") is not None


def test_the_displayed_labels_are_saved_in_the_background(tmp_path: Path) -> None:
    session = ready_session(viewing.labels())
    session.change(friction=0.6, sensor_resolution=0.2)
    session.save(tmp_path / "a.ply")
    assert has_begun(session, "saving a.ply")
    changed(session, paint="critical_angle")
    assert session.message == f"saved: {tmp_path / 'a.ply'}"
    again = ready_session(open_collection(tmp_path / "a.ply"))
    assert fractions(again) == pytest.approx(fractions(session), abs=1e-6)
    assert read_subject(tmp_path / "a.ply").labels.model == session.model
    session.save(tmp_path / "none" / "a.ply")
    wait_until_idle(session)
    assert "none" in session.message
    assert not session.message.startswith("saved")
    with pytest.raises(OutputError, match="unsupported format"):
        session.save(tmp_path / "a.txt")


def test_the_object_can_be_changed_during_a_job() -> None:
    one, two = subject_of(viewing.labels(), "one"), subject_of(viewing.box(), "two")
    go_on = threading.Event()

    def slow() -> Subject:
        while not go_on.is_set():
            report_progress(0.5)
            time.sleep(0.001)
        return two

    items = Item("one", lambda: one), Item("two", slow)
    session = ready_session(Collection(items, one.labels.model, Sampling()))
    session.click(3)
    session.step(1)
    assert panel_text(session).title == "two (2 of 2)"
    assert (session.subject, session.inspection) == (None, None)
    session.step(1)
    wait_until_idle(session)
    assert shown(session).name == "one"
    go_on.set()
    session.step(-1)
    wait_until_idle(session)
    assert shown(session).name == "two"
    revision = session.revision
    session.step(2)
    assert session.revision == revision
    session.close()
    assert session.working is None


@pytest.mark.parametrize(
    ("model", "rule"),
    [
        (GraspModel(), "β*: S below 15.3°, U from 37.9° on"),
        (GraspModel(sensor_resolution=1.2), "β*: no S, U from 60.9° on"),
        (GraspModel(friction=2.0, sensor_resolution=1.2, fingers=3), "β*: S below 29.1°, no U"),
    ],
)
def test_the_rule_has_the_limits_of_s_and_u(model: GraspModel, rule: str) -> None:
    labels = viewing.box() if model.fingers == 2 else viewing.three_fingers()
    session = Session(collection_of(labels.using(model=model)))
    assert panel_text(session).rule == rule
    session.close()


def test_texts_of_an_object() -> None:
    session = ready_session(viewing.labels())
    text, mesh = panel_text(session), viewing.labels().mesh
    size = f"size {1000.0 * mesh.size:.3g} mm"
    assert text.facts == f"{size}, {len(mesh.vertices):,} vertices, closed"
    assert [one.letter for one in text.fractions] == ["S", "M", "U"]
    assert sum(one.fraction for one in text.fractions) == pytest.approx(1.0)
    assert [one.color for one in text.fractions] == ["#009E73", "#F0E442", "#D55E00"]
    assert (text.ramp, session.working, session.message) == (None, None, "")
    unknown = replace(viewing.box().mesh.report, unit=None, warnings=("mind the gap",))
    other = panel_text(ready_session(viewing.with_report(viewing.box(), unknown)))
    assert "(unit not stated)" in other.facts
    assert other.notes == ("mind the gap",)


def test_the_page_shows_what_a_click_does_and_no_old_fractions() -> None:
    session = changed(ready_session(viewing.box()), click="fix")
    assert panel_text(session).hint == "Click the surface to fix a finger there."
    session.click(0)
    wait_until_idle(session)
    assert panel_text(session).hint.startswith("1 finger fixed: the colours are for")
    changed(session, fixed=(), click="inspect")
    assert "see the best grasp" in panel_text(session).hint
    session.change(fingers=3)
    state = page_state(session)
    assert [row["letter"] for row in state["rows"]] == ["S", "M", "U"]
    assert ({row["percent"] for row in state["rows"]}, state["stale"]) == ({"…"}, True)
    assert panel_text(session).hint.endswith("…")
    wait_until_idle(session)
    assert sum(row["fraction"] for row in page_state(session)["rows"]) == pytest.approx(1.0)
    session.close()


def test_the_unsearched_part_has_an_area_fraction() -> None:
    labels = viewing.labels().using(model=GraspModel(friction=0.05))
    subject = viewing.with_values(subject_of(labels), search=SearchReport(0.1))
    subject = replace(subject, searched=0.1)
    items = (Item("a", lambda: subject),)
    session = Session(Collection(items, GraspModel(), Sampling(max_opening=0.003)))
    until(session.poll)
    parts = panel_text(session).fractions
    assert (parts[-1].color, len(parts) - 1) == ("#9AA0A6", UNSEARCHED)
    assert sum(one.fraction for one in parts) == pytest.approx(1.0)
    assert (parts[2].letter, parts[2].fraction) == (Label.U.name, 0.0)
    session.close()


@pytest.fixture
def worker() -> Iterator[Worker[int]]:
    before = threading.active_count()
    worker: Worker[int] = Worker()
    yield worker
    worker.request(None)
    until(lambda: threading.active_count() <= before)


def until(done: Callable[[], object]) -> None:
    end = time.monotonic() + viewing.TIMEOUT
    while not done():
        assert time.monotonic() < end
        time.sleep(0.001)


def taken(worker: Worker[int]) -> tuple[int | None, str | None]:
    """Result and error of the job that ends next."""
    found = []

    def finished() -> bool:
        found.append(worker.take_finished())
        return found[-1] is not None

    until(finished)
    return found[-1].result, found[-1].error


def endless(begun: threading.Event) -> Callable[[], int]:
    def work() -> int:
        while True:
            report_progress(0.25)
            begun.set()
            time.sleep(0.001)

    return work


def test_a_newer_job_replaces_the_older_one(worker: Worker[int]) -> None:
    begun, never = threading.Event(), threading.Event()
    worker.request(Job("a", "endless", endless(begun)))
    assert begun.wait(60)
    assert worker.fraction == 0.25
    worker.request(Job("b", "held", endless(never), delay=3600.0))
    worker.request(Job("c", "quick", lambda: 7))
    assert worker.job is not None
    assert (worker.job.key, worker.fraction) == ("c", 0.0)
    assert taken(worker) == (7, None)
    assert (worker.job, worker.take_finished()) == (None, None)
    assert not never.is_set()


def test_a_job_with_the_same_key_is_not_restarted(worker: Worker[int]) -> None:
    count, go_on = list[int](), threading.Event()

    def work() -> int:
        count.append(1)
        assert go_on.wait(60)
        return 1

    for _ in range(3):
        worker.request(Job("a", "once", work))
    go_on.set()
    assert taken(worker) == (1, None)
    assert len(count) == 1


def test_a_cancelled_job_has_no_result(worker: Worker[int]) -> None:
    go_on, ended = threading.Event(), threading.Event()

    def stubborn() -> int:
        assert go_on.wait(60)
        ended.set()
        return 1

    worker.request(Job("a", "stubborn", stubborn))
    worker.request(None)
    assert worker.job is None
    go_on.set()
    assert ended.wait(60)
    worker.request(Job("b", "quick", lambda: 2))
    assert taken(worker) == (2, None)
    assert worker.take_finished() is None


@pytest.mark.parametrize(
    ("error", "message"),
    [
        (MeshError("no surface"), "no surface"),
        (MemoryError(), "working: memory is too small; use a coarser mesh"),
        (ZeroDivisionError("oh"), "unexpected ZeroDivisionError: oh; please report this mesh"),
    ],
)
def test_errors_are_reported(worker: Worker[int], error: Exception, message: str) -> None:
    def fail() -> int:
        raise error

    worker.request(Job("a", "working", fail))
    assert taken(worker) == (None, message)
