import math
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from grasp3d import (
    GraspError,
    GraspModel,
    Label,
    Sampling,
    label_surface,
    scan_surface,
    write_npz,
    write_ply,
)
from grasp3d.errors import MeshError, OutputError, SettingError
from grasp3d.pictures.colors import UNSEARCHED, ramp_of
from grasp3d.pictures.subject import Subject, subject_of
from grasp3d.pictures.view_settings import ViewSettings
from grasp3d.surface import Reason
from grasp3d.surface.vertex_fields import SearchReport
from grasp3d.system.context import report_progress
from grasp3d.viewer import session as sessions
from grasp3d.viewer.collection import Collection, Item, Section, collection_of, open_collection
from grasp3d.viewer.panel_text import panel_text
from grasp3d.viewer.session import Job, Session, Worker
from tests.helpers import viewing
from tests.helpers.viewing import has_begun, read_subject, ready_session, wait_until_idle


@pytest.fixture(autouse=True)
def at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Searches begin without a delay."""
    monkeypatch.setattr(sessions, "DELAY", 0.0)


@pytest.fixture
def file(tmp_path: Path) -> Path:
    write_ply(tmp_path / "cone.ply", viewing.labels())
    return tmp_path / "cone.ply"


# Choices


def test_a_session_begins_with_its_settings() -> None:
    session = Session(collection_of(viewing.labels()), ViewSettings(paint="critical_angle"))
    assert session.working is not None
    assert session.subject is None
    assert panel_text(session).fractions == ()
    wait_until_idle(session)
    assert session.model == viewing.labels().model
    assert session.state.paint == "critical_angle"
    assert session.name == viewing.labels().mesh.report.source
    assert panel_text(session).title == session.name


def test_sliders_change_the_labels_without_a_search() -> None:
    session = ready_session(viewing.labels())
    before, subject = session.revision, session.subject
    session.change(friction=0.6, sensor_resolution=0.2)
    assert session.revision == before + 1
    assert session.working is None
    assert session.subject is not None
    assert subject is not None
    assert session.subject.labels.contacts is subject.labels.contacts
    expected = viewing.labels().relabel(friction=0.6, sensor_resolution=0.2).fractions()
    assert {one.letter: one.fraction for one in panel_text(session).fractions} == pytest.approx(
        expected
    )
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
    assert session.state is state
    assert session.revision == revision


def test_a_vertex_is_inspected_until_a_click_beside_the_object() -> None:
    session = ready_session(viewing.labels())
    session.click(40)
    seen = session.inspection
    assert seen is not None
    assert seen.vertex == 40
    assert session.inspection is seen
    session.change(friction=0.7)
    assert session.inspection is not None
    assert session.inspection.model.friction == 0.7
    session.click(None)
    assert session.inspection is None
    with pytest.raises(SettingError, match="there is no vertex"):
        session.click(10**6)


# Searches


def test_more_friction_than_searched_starts_a_wider_search() -> None:
    session = ready_session(viewing.labels())
    assert session.subject is not None
    cone = session.subject.cone
    session.change(friction=2.0)
    text = panel_text(session)
    assert session.working is not None
    assert session.working[0] == "searching grasps"
    assert text.fractions[-1].text == "not searched"
    assert any("grey vertices need a wider search" in note for note in text.notes)
    wait_until_idle(session)
    subject = session.subject
    assert subject is not None
    assert subject.cone == math.pi / 2 > cone
    assert len(panel_text(session).fractions) == 3
    wide = replace(viewing.labels().sampling or Sampling(), search_angle=math.pi / 2)
    expected = label_surface(viewing.labels().mesh, session.model, sampling=wide)
    known = viewing.labels().critical_angle
    kept = known <= cone
    assert np.array_equal(subject.labels.critical_angle[kept], known[kept])
    best = np.minimum(known, expected.critical_angle)
    assert np.array_equal(subject.labels.critical_angle[~kept], best[~kept])
    session.change(friction=0.3)
    assert session.working is None  # the widest search covers every model


def test_a_wider_search_does_not_change_known_fractions() -> None:
    session = ready_session(viewing.labels())
    before = {one.letter: one.fraction for one in panel_text(session).fractions}
    session.change(sensor_resolution=1.5)
    wait_until_idle(session)
    assert session.subject is not None
    assert session.subject.cone == math.pi / 2
    session.change(sensor_resolution=viewing.labels().model.sensor_resolution)
    after = {one.letter: one.fraction for one in panel_text(session).fractions}
    assert after == before
    grasps, labels = session.subject.labels, viewing.labels()
    kept = labels.critical_angle <= labels.search.cone
    assert np.array_equal(grasps.partners[kept], labels.partners[kept])
    assert np.array_equal(grasps.opening[kept], labels.opening[kept])
    assert np.array_equal(np.isinf(grasps.critical_angle), grasps.reason != Reason.FOUND)


def test_other_fingers_are_searched_without_the_limits_of_two() -> None:
    session = ready_session(viewing.box())
    session.change(fingers=3)
    assert session.model.fingers == 2  # of the surface that is still displayed
    wait_until_idle(session)
    assert session.message == ""
    assert session.model.fingers == 3
    assert session.subject is not None
    assert session.subject.labels.partners is not None
    assert session.subject.labels.partners.shape[1] == 2
    assert session.working is None
    session.change(fingers=2)
    wait_until_idle(session)
    assert session.subject.labels.model.fingers == 2


def test_a_newer_choice_replaces_a_running_search() -> None:
    session = ready_session(viewing.box())
    session.change(fingers=3)
    session.change(fingers=4)
    wait_until_idle(session)
    assert session.subject is not None
    assert session.subject.labels.model.fingers == 4
    session.change(fingers=3)
    session.change(fingers=4)
    assert session.working is None


def test_a_failed_job_is_reported_and_not_repeated() -> None:
    labels = viewing.three_fingers()
    tries = []

    def fail() -> Subject:
        tries.append(1)
        raise MeshError("the mesh is too large")

    collection = Collection((Item("a", fail), Item("b", lambda: subject_of(labels))),
                  labels.model, Sampling(candidates=8))  # fmt: skip
    session = ready_session(collection)
    assert session.message == "the mesh is too large"
    assert session.subject is None
    with pytest.raises(SettingError, match="nothing to save yet"):
        session.save(Path("a.ply"))
    session.click(3)
    session.change(paint="critical_angle", section=Section("y"))
    wait_until_idle(session)
    assert session.message == "the mesh is too large"
    assert len(tries) == 1
    session.step(1)
    wait_until_idle(session)
    assert session.subject is not None
    assert session.message == ""
    session.step(-1)
    wait_until_idle(session)
    assert len(tries) == 2


@pytest.mark.slow
@pytest.mark.parametrize(
    ("choice", "missing"),
    [
        ({"fingers": 3}, "grasps for 3 fingers"),
        ({"fixed": ((0.5, 0.0, 0.0),)}, "labels for 1 fixed finger"),
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
    text = panel_text(session)
    assert session.stale
    assert text.stale
    assert (text.fractions, session.inspection) == ((), None)
    with pytest.raises(SettingError, match=f"the {missing} are still being searched; save when"):
        session.save(tmp_path / "a.ply")
    session.click(9, inspect=True)
    assert session.inspection is None
    wait_until_idle(session)
    text = panel_text(session)
    assert not text.stale
    assert len(text.fractions) == 3
    assert session.inspection is not None
    assert session.inspection.vertex == 9
    session.save(tmp_path / "a.ply")
    wait_until_idle(session)
    assert read_subject(tmp_path / "a.ply").labels.model.fingers == session.state.model.fingers


def test_the_surface_stays_stale_if_the_search_fails(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr("grasp3d.settings.sampling.PER_VERTEX", (0.0, 1.0))
    session = ready_session(viewing.box())
    session.change(fingers=3)
    wait_until_idle(session)
    assert session.stale
    assert panel_text(session).fractions == ()
    with pytest.raises(
        SettingError, match="there are no grasps for 3 fingers; change the settings"
    ):
        session.save(tmp_path / "a.ply")
    session.change(fingers=2)
    assert not session.stale


def test_the_last_searches_are_cached() -> None:
    session = ready_session(viewing.box())
    first = session.subject
    session.change(fingers=3)
    wait_until_idle(session)
    second = session.subject
    session.change(fingers=2)
    assert (session.working, session.subject, session.stale) == (None, first, False)
    session.change(fingers=4)
    wait_until_idle(session)
    session.change(fingers=3)
    assert (session.working, session.subject) == (None, second)
    session.change(fingers=5)
    wait_until_idle(session)
    session.change(fingers=2)  # three others were searched since, but it was opened
    assert (session.working, session.subject) == (None, first)
    session.change(fingers=4)
    assert session.working is not None
    session.close()


def test_epsilon_of_other_fingers_is_not_used() -> None:
    session = ready_session(viewing.box())
    session.change(fingers=3)
    wait_until_idle(session)
    session.change(paint="epsilon")
    assert has_begun(session, "computing ε")
    session.change(fingers=2)
    wait_until_idle(session)
    assert session.subject is not None
    assert session.subject.labels.computed("epsilon_range") is not None
    expected = viewing.box().epsilon
    assert session.subject.labels.epsilon == pytest.approx(expected, nan_ok=True)
    assert session.subject.labels.sampling == viewing.box().sampling


# Scans


def test_a_click_fixes_a_finger_and_another_moves_it() -> None:
    session = ready_session(viewing.labels())
    labels = viewing.labels()
    session.change(click="fix")
    session.click(30)
    assert has_begun(session, "scanning")
    wait_until_idle(session)
    expected = scan_surface(labels.mesh, labels.model, fixed=labels.mesh.vertices[30])
    assert session.subject is not None
    assert session.subject.labels.mode == "scan"
    assert np.array_equal(session.subject.labels.critical_angle, expected.critical_angle)
    assert "1 finger fixed" in panel_text(session).facts
    session.click(31)
    wait_until_idle(session)
    assert len(session.state.fixed) == 1
    session.click(60, inspect=True)
    assert session.inspection is not None
    assert session.inspection.points[1] == pytest.approx(labels.mesh.vertices[31])
    session.change(fixed=())
    wait_until_idle(session)
    assert session.subject is not None
    assert session.subject.labels.mode == "label"


def test_two_of_three_fingers_are_fixed_one_after_the_other() -> None:
    session = ready_session(viewing.three_fingers())
    session.change(click="fix")
    session.click(3)
    wait_until_idle(session)
    assert session.model.fingers == 2
    assert any(
        "fix 1 more finger: these are labels for 2 fingers" in note
        for note in panel_text(session).notes
    )
    session.click(20)
    wait_until_idle(session)
    assert session.model.fingers == 3
    assert "2 fingers fixed" in panel_text(session).facts
    session.change(fingers=2)
    assert len(session.state.fixed) == 1
    wait_until_idle(session)
    assert session.subject is not None
    assert (session.subject.labels.mode, session.model.fingers) == ("scan", 2)


def test_epsilon_of_a_scan_is_computed() -> None:
    session = ready_session(viewing.box())
    session.change(click="fix", paint="epsilon")
    session.click(9)
    wait_until_idle(session)
    subject = session.subject
    assert subject is not None
    assert subject.labels.mode == "scan"
    assert subject.labels.computed("epsilon_range") is not None
    assert subject.model == session.model


def test_labels_of_a_scan_can_be_viewed() -> None:
    session = ready_session(viewing.scan())
    assert session.subject is not None
    assert session.subject.labels.mode == "scan"
    assert "1 finger fixed" in panel_text(session).facts
    assert {one.text for one in panel_text(session).fractions} >= {"surely unstable"}
    session.change(friction=3.0, sensor_resolution=1.0)
    assert session.working is None


# Epsilon


def test_epsilon_is_computed_when_it_is_shown() -> None:
    labels = viewing.box()
    session = ready_session(labels.using(model=labels.model))
    session.change(paint="epsilon_min")
    assert has_begun(session, "computing ε")
    wait_until_idle(session)
    session.change(friction=0.45)
    ramp = ramp_of(viewing.uncomputed(session), "epsilon_min")
    assert ramp is not None
    assert (ramp.text, ramp.grey) == ("ε_min: smallest over all tilts", "not computed yet")
    wait_until_idle(session)
    subject = session.subject
    assert subject is not None
    assert subject.labels.computed("epsilon_range") is not None
    expected = labels.relabel(friction=0.45)
    assert subject.labels.epsilon_min == pytest.approx(expected.epsilon_min, nan_ok=True)
    assert np.array_equal(subject.labels.critical_angle, labels.critical_angle)


# Files


@pytest.fixture
def batched(tmp_path: Path) -> Subject:
    """The cone as read from a file."""
    write_npz(tmp_path / "cone.npz", viewing.labels())
    return read_subject(tmp_path / "cone.npz")


def test_a_click_on_a_batch_needs_no_job(batched: Subject) -> None:
    labels = viewing.labels()
    collection = Collection(
        (Item("a", lambda: batched),), labels.model, Sampling(max_opening=0.003)
    )
    session = ready_session(collection)
    vertex = int(np.flatnonzero(labels.reason == Reason.FOUND)[0])
    session.click(vertex)
    assert session.working is None
    seen = session.inspection
    assert seen is not None
    assert len(seen.points) == 2
    assert dict(seen.numbers)["ε"] == f"{labels.epsilon[vertex]:.3f}"
    session.change(friction=0.6)
    assert session.working is None
    assert session.inspection is not None
    assert dict(session.inspection.numbers)["ε"] != "–"
    assert session.message == ""


def test_a_scanned_file_is_saved_for_other_settings(tmp_path: Path) -> None:
    write_ply(tmp_path / "scan.ply", viewing.scan())
    session = ready_session(open_collection(tmp_path / "scan.ply"))
    session.change(paint="epsilon", friction=0.9)
    wait_until_idle(session)
    session.save(tmp_path / "again.ply")
    wait_until_idle(session)
    expected = viewing.scan().relabel(friction=0.9)
    assert np.array_equal(read_subject(tmp_path / "again.ply").labels.label, expected.label)


# Saving


def _fractions(path: Path) -> dict[str, float]:
    session = ready_session(open_collection(path))
    return {one.letter: one.fraction for one in panel_text(session).fractions}


def test_the_displayed_labels_are_saved(tmp_path: Path) -> None:
    session = ready_session(viewing.labels())
    session.change(friction=0.6, sensor_resolution=0.2)
    session.save(tmp_path / "a.ply")
    wait_until_idle(session)
    assert session.message.endswith("a.ply")
    displayed = {one.letter: one.fraction for one in panel_text(session).fractions}
    assert _fractions(tmp_path / "a.ply") == pytest.approx(displayed, abs=1e-6)
    assert read_subject(tmp_path / "a.ply").labels.model == session.model
    assert session.subject is not None
    assert session.subject.labels.computed("epsilon_range") is not None


def test_files_are_saved_in_the_background(tmp_path: Path, file: Path) -> None:
    session = ready_session(open_collection(file))
    session.change(friction=0.6)
    session.save(tmp_path / "a.npz")
    assert has_begun(session, "saving a.npz")
    session.change(paint="critical_angle")
    wait_until_idle(session)
    assert session.message == f"saved: {tmp_path / 'a.npz'}"
    with np.load(tmp_path / "a.npz") as data:
        assert str(data["setting_friction"]) == "0.6"
    session.save(tmp_path / "none" / "a.ply")
    wait_until_idle(session)
    assert "none" in session.message
    assert not session.message.startswith("saved")
    with pytest.raises(OutputError, match="unsupported format"):
        session.save(tmp_path / "a.txt")


def test_labels_beyond_the_search_cannot_be_saved(tmp_path: Path) -> None:
    session = ready_session(viewing.labels())
    session.change(friction=3.0)
    with pytest.raises(GraspError, match="are not searched yet"):
        session.save(tmp_path / "a.ply")
    session.close()


# Several objects


def test_the_object_can_be_changed_during_a_job() -> None:
    one, two = subject_of(viewing.labels(), "one"), subject_of(viewing.box(), "two")
    go_on = threading.Event()

    def slow() -> Subject:
        while not go_on.is_set():
            report_progress(0.5)
            time.sleep(0.001)
        return two

    collection = Collection(
        (Item("one", lambda: one), Item("two", slow)), one.labels.model, Sampling()
    )
    session = Session(collection)
    session.change(fingers=3)
    wait_until_idle(session)
    session.click(3)
    session.step(1)
    assert panel_text(session).title == "two (2 of 2)"
    assert (session.subject, session.inspection) == (None, None)
    session.step(1)
    wait_until_idle(session)
    assert session.subject is not None
    assert session.subject.name == "one"
    go_on.set()
    session.step(-1)
    wait_until_idle(session)
    assert session.subject is not None
    assert session.subject.name == "two"
    revision = session.revision
    session.step(2)
    assert session.revision == revision
    session.close()
    assert session.working is None


# Texts


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
    session.click(40)
    text = panel_text(session)
    mesh = viewing.labels().mesh
    assert (
        text.facts == f"size {1000.0 * mesh.size:.3g} mm, {len(mesh.vertices):,} vertices, closed"
    )
    assert [one.letter for one in text.fractions] == ["S", "M", "U"]
    assert sum(one.fraction for one in text.fractions) == pytest.approx(1.0)
    assert [one.color for one in text.fractions] == ["#009E73", "#F0E442", "#D55E00"]
    assert text.ramp is None
    assert (session.working, session.message) == (None, "")
    session.show_message("hello")
    assert session.message == "hello"
    unknown = replace(viewing.box().mesh.report, unit=None, warnings=("mind the gap",))
    labels = viewing.with_report(viewing.box(), unknown)
    other = panel_text(ready_session(labels))
    assert "(unit not stated)" in other.facts
    assert other.notes == ("mind the gap",)


# The worker


@pytest.fixture
def worker() -> Iterator[Worker[int]]:
    before = threading.active_count()
    worker: Worker[int] = Worker()
    yield worker
    worker.request(None)
    _until(lambda: threading.active_count() <= before)


def _until(done: Callable[[], object]) -> None:
    end = time.monotonic() + viewing.TIMEOUT
    while not done():
        assert time.monotonic() < end
        time.sleep(0.001)


def _taken(worker: Worker[int]) -> tuple[int | None, str | None]:
    found = []

    def finished() -> bool:
        job = worker.take_finished()
        if job is not None:
            found.append((job.result, job.error))
        return bool(found)

    _until(finished)
    return found[0]


def _endless(begun: threading.Event) -> Callable[[], int]:
    def work() -> int:
        while True:
            report_progress(0.25)
            begun.set()
            time.sleep(0.001)

    return work


def test_a_newer_job_replaces_the_older_one(worker: Worker[int]) -> None:
    begun = threading.Event()
    worker.request(Job("a", "endless", _endless(begun)))
    assert begun.wait(60)
    assert worker.fraction == 0.25
    worker.request(Job("b", "quick", lambda: 7))
    assert worker.job is not None
    assert worker.job.key == "b"
    assert worker.fraction == 0.0
    assert _taken(worker) == (7, None)
    assert worker.job is None
    assert worker.take_finished() is None


def test_a_job_with_the_same_key_is_not_restarted(worker: Worker[int]) -> None:
    count: list[int] = []
    go_on = threading.Event()

    def work() -> int:
        count.append(1)
        assert go_on.wait(60)
        return 1

    for _ in range(3):
        worker.request(Job("a", "once", work))
    go_on.set()
    assert _taken(worker) == (1, None)
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
    assert _taken(worker) == (2, None)
    assert worker.take_finished() is None


def test_a_delayed_job_does_not_start_if_it_is_replaced(
    worker: Worker[int],
) -> None:
    begun = threading.Event()
    worker.request(Job("a", "held", _endless(begun), delay=3600.0))
    worker.request(Job("b", "quick", lambda: 2))
    assert _taken(worker) == (2, None)
    assert not begun.is_set()


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
    assert _taken(worker) == (None, message)


def test_the_unsearched_part_has_an_area_fraction() -> None:
    labels = viewing.labels().using(model=GraspModel(friction=0.05))
    subject = viewing.with_values(subject_of(labels), search=SearchReport(0.1))
    subject = replace(subject, searched=0.1)
    collection = Collection(
        (Item("a", lambda: subject),), GraspModel(), Sampling(max_opening=0.003)
    )
    session = Session(collection)
    _until(session.poll)
    fractions = panel_text(session).fractions
    assert fractions[-1].color == "#9AA0A6"
    assert len(fractions) - 1 == UNSEARCHED
    assert sum(one.fraction for one in fractions) == pytest.approx(1.0)
    assert fractions[2].letter == Label.U.name
    assert fractions[2].fraction == 0.0
    session.close()


@pytest.mark.slow
def test_what_was_opened_is_kept_whatever_is_scanned() -> None:
    session = ready_session(viewing.labels())
    opened, points = session.subject, viewing.labels().mesh.vertices[[30, 60, 90]]
    for point in points:
        session.change(fixed=(tuple(point.tolist()),))
        wait_until_idle(session)
    session.change(fixed=())
    assert (session.subject, session.stale, session.working) == (opened, False, None)
    session.close()


def test_a_failed_search_is_tried_again_at_another_friction(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    tried: list[float] = []

    def fail(_: Subject, model: GraspModel, __: Sampling) -> Subject:
        tried.append(model.nominal_friction)
        raise SettingError("too little memory")

    monkeypatch.setattr(sessions, "search_grasps", fail)
    session = ready_session(viewing.box())
    for friction in (0.5, 0.6):
        session.change(fingers=3, friction=friction)
        wait_until_idle(session)
        assert session.failure == "too little memory"
    assert tried == [0.5, 0.6]
    session.close()
