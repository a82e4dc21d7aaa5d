import math
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from grasp3d import GraspError, GraspModel, Label, Sampling, label_surface, scan_surface, write_ply
from grasp3d.errors import MeshError, OutputError, SettingError
from grasp3d.surface import Reason
from grasp3d.system.progress import Progress, ignore
from grasp3d.viewer.session import planning, saving
from grasp3d.viewer.session.album import Album, Exhibit, album_of, open_album
from grasp3d.viewer.session.painting import UNSEARCHED
from grasp3d.viewer.session.searching import measured, mesh_of, prepared
from grasp3d.viewer.session.session import Session
from grasp3d.viewer.session.state import Section, Shown
from grasp3d.viewer.session.telling import tell
from grasp3d.viewer.session.work import Abandoned, Job, Worker
from grasp3d.viewer.subjects.subject import Subject, read_subject, subject_of
from grasp3d.viewer.view_settings import ViewSettings
from tests.helpers import viewing
from tests.helpers.viewing import rest, settled


@pytest.fixture(autouse=True)
def at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Searches begin without waiting for a slider to rest."""
    monkeypatch.setattr(planning, "PAUSE", 0.0)


@pytest.fixture
def file(tmp_path: Path) -> Path:
    write_ply(tmp_path / "cone.ply", viewing.labels())
    return tmp_path / "cone.ply"


# What is chosen


def test_a_session_begins_as_it_is_asked() -> None:
    session = Session(album_of(viewing.labels()), ViewSettings(paint="epsilon", compare=0.1))
    assert session.working is not None
    assert session.subject is None
    assert tell(session).shares == ()
    rest(session)
    assert session.shown.max_opening == 0.3
    assert session.model == viewing.labels().model
    assert session.other_model == replace(session.model, sensor_resolution=0.1)
    assert session.name == viewing.labels().mesh.report.source
    assert tell(session).title == session.name


def test_sliders_change_the_labels_and_nothing_is_searched() -> None:
    session = settled(viewing.labels())
    before, subject = session.revision, session.subject
    session.change(friction=0.6, sensor_resolution=0.2)
    assert session.revision == before + 1
    assert session.working is None
    assert session.subject is subject
    expected = viewing.labels().relabel(friction=0.6, sensor_resolution=0.2).fractions()
    assert {share.letter: share.share for share in tell(session).shares} == pytest.approx(expected)
    session.change(friction=0.6)
    assert session.revision == before + 1
    assert not session.poll()


@pytest.mark.parametrize(
    ("choice", "words"),
    [
        ({"friction": -1.0}, "friction must be"),
        ({"friction": "much"}, "wrong kind"),
        ({"sensor_resolution": 4.0}, "below 180 degrees"),
        ({"fingers": 1}, "fingers must be from 2 to 5"),
        ({"fingers": 6}, "fingers must be from 2 to 5"),
        ({"paint": "red"}, "nothing is painted by 'red'"),
        ({"click": "hit"}, "a click cannot 'hit'"),
        ({"compare": 4.0}, "compared with must be"),
        ({"max_opening": 0.0}, "opening must be above 0"),
        ({"max_opening": math.nan}, "opening must be above 0"),
        ({"fixed": ((0.0, 0.0),)}, "three finite numbers"),
        ({"fixed": ((0.0, 0.0, math.nan),)}, "three finite numbers"),
        ({"fixed": ((0.0, 0.0, 0.0),) * 2}, "of 2 fingers 1 can be fixed; got 2"),
        ({"colour": 1}, "nothing is called 'colour'"),
    ],
)
def test_choices_outside_their_range_change_nothing(choice: dict[str, object], words: str) -> None:
    session = settled(viewing.labels())
    shown, revision = session.shown, session.revision
    with pytest.raises(SettingError, match=words):
        session.change(**choice)
    assert session.shown is shown
    assert session.revision == revision


def test_a_vertex_is_told_of_until_one_clicks_beside() -> None:
    session = settled(viewing.labels())
    session.tap(40)
    seen = session.inspected
    assert seen is not None
    assert seen.vertex == 40
    assert session.inspected is seen
    session.change(friction=0.7)
    assert session.inspected is not None
    assert session.inspected.model.friction == 0.7
    session.tap(None)
    assert session.inspected is None
    with pytest.raises(SettingError, match="there is no vertex"):
        session.tap(10**6)


# Searches


def test_more_friction_than_was_searched_for_is_searched_and_grey_until_then() -> None:
    session = settled(viewing.labels())
    assert session.subject is not None
    cone = session.subject.cone
    session.change(friction=2.0)
    told = tell(session)
    assert told.working is not None
    assert told.working[0] == "searching grasps"
    assert told.shares[-1].words == "not searched"
    assert any("what is grey needs more" in note for note in told.notes)
    rest(session)
    subject = session.subject
    assert subject is not None
    assert subject.cone == math.pi / 2 > cone
    assert len(tell(session).shares) == 3
    wide = replace(viewing.labels().sampling or Sampling(), search_angle=math.pi / 2)
    expected = label_surface(viewing.labels().mesh, session.model, sampling=wide)
    assert np.array_equal(subject.critical_angle, expected.critical_angle)
    session.change(friction=0.3)
    assert session.working is None  # what was searched wide answers all


def test_the_resolution_that_is_compared_with_is_searched_for_too() -> None:
    session = settled(viewing.labels())
    session.change(compare=1.5)
    assert session.working is not None
    rest(session)
    assert len(tell(session).other_shares) == 3


def test_another_opening_is_searched_once() -> None:
    session = settled(viewing.labels())
    session.change(max_opening=0.5)
    rest(session)
    subject = session.subject
    assert subject is not None
    assert subject.sampling is not None
    assert subject.sampling.max_opening == 0.5
    assert np.nanmax(subject.opening) > 0.3
    session.change(friction=0.7)
    assert session.working is None


def test_what_was_searched_wide_stays_wide_at_another_opening() -> None:
    session = settled(viewing.box())
    session.change(friction=3.0)
    rest(session)
    session.change(friction=0.5, max_opening=3.0)
    rest(session)
    assert session.subject is not None
    assert session.subject.cone == math.pi / 2
    session.change(friction=3.0)
    assert session.working is None


def test_other_fingers_are_searched_and_the_limits_of_two_fall_away() -> None:
    session = settled(viewing.box())
    session.change(fingers=3)
    assert session.model.fingers == 2  # as the surface that is shown still has them
    rest(session)
    assert session.message == ""
    assert session.model.fingers == 3
    assert session.subject is not None
    assert session.subject.partners is not None
    assert session.subject.partners.shape[1] == 2
    assert session.working is None
    session.change(fingers=2)
    rest(session)
    assert session.subject.model.fingers == 2


def test_what_is_chosen_meanwhile_wins() -> None:
    session = settled(viewing.labels())
    session.change(max_opening=0.5)
    session.change(max_opening=0.4)
    rest(session)
    assert session.subject is not None
    assert session.subject.sampling is not None
    assert session.subject.sampling.max_opening == 0.4
    session.change(max_opening=0.5)
    session.change(max_opening=0.4)
    assert session.working is None


def test_what_fails_is_told_and_not_tried_again_until_something_else_is_wanted() -> None:
    labels = viewing.hands()
    tries = []

    def fail(_: Progress) -> Subject:
        tries.append(1)
        raise MeshError("the mesh is too large")

    album = Album((Exhibit("a", fail), Exhibit("b", lambda _: subject_of(labels))),
                  labels.model, Sampling(candidates=8))  # fmt: skip
    session = settled(album)
    assert session.message == "the mesh is too large"
    assert session.subject is None
    with pytest.raises(SettingError, match="nothing to save yet"):
        session.save(Path("a.ply"))
    session.tap(3)
    session.change(paint="critical_angle", section=Section("y"))
    rest(session)
    assert session.message == "the mesh is too large"
    assert len(tries) == 1
    session.step(1)
    rest(session)
    assert session.subject is not None
    assert session.message == ""
    session.step(-1)
    rest(session)
    assert len(tries) == 2


def test_a_search_that_needs_too_much_memory_is_refused_and_the_rest_goes_on(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("grasp3d.costs.PER_VERTEX", (0.0, 1.0))
    session = settled(viewing.box())
    session.change(fingers=3)
    rest(session)
    assert "max_memory" in session.message
    assert session.model.fingers == 2
    session.change(friction=0.4)
    assert session.working is None
    assert "max_memory" in session.message
    session.change(fingers=2)
    assert session.message == ""


@pytest.mark.parametrize(
    ("choice", "words"),
    [
        ({"fingers": 3}, "grasps for 3 fingers"),
        ({"max_opening": 0.7}, "grasps for this largest opening"),
        ({"fixed": ((0.5, 0.0, 0.0),)}, "labels for 1 fixed finger"),
        ({"fingers": 3, "fixed": ((0.5, 0.0, 0.0),) * 2}, "labels for 2 fixed fingers"),
    ],
)
def test_nothing_is_told_of_old_grasps_until_the_new_ones_are_there(
    choice: dict[str, object], words: str, tmp_path: Path
) -> None:
    session = settled(viewing.box())
    session.change(compare=0.3)
    rest(session)
    session.tap(4)
    assert not session.stale
    session.change(**choice)
    told = tell(session)
    assert session.stale
    assert told.stale
    assert (told.shares, told.other_shares, told.inspected) == ((), (), None)
    for save in (session.save, session.save_soon):
        with pytest.raises(SettingError, match=f"the {words} are still being searched; save when"):
            save(tmp_path / "a.ply")
    session.tap(9, inspect=True)
    assert session.inspected is None
    rest(session)
    told = tell(session)
    assert not told.stale
    assert len(told.shares) == len(told.other_shares) == 3
    assert told.inspected is not None
    assert told.inspected.vertex == 9
    session.save(tmp_path / "a.ply")
    assert read_subject(tmp_path / "a.ply").model.fingers == session.shown.model.fingers


def test_a_wider_search_leaves_what_is_known() -> None:
    session = settled(viewing.labels())
    session.change(friction=2.0)
    assert session.working is not None
    assert not session.stale
    assert tell(session).shares
    session.close()


def test_what_cannot_be_searched_stays_stale(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr("grasp3d.costs.PER_VERTEX", (0.0, 1.0))
    session = settled(viewing.box())
    session.change(fingers=3)
    rest(session)
    assert session.stale
    assert tell(session).shares == ()
    with pytest.raises(SettingError, match="there are no grasps for 3 fingers; choose something"):
        session.save(tmp_path / "a.ply")
    session.change(fingers=2)
    assert not session.stale


def test_the_last_searches_are_gone_back_to_at_once() -> None:
    session = settled(viewing.box())
    first = session.subject
    session.change(max_opening=0.7)
    rest(session)
    second = session.subject
    session.change(max_opening=math.inf)
    assert (session.working, session.subject, session.stale) == (None, first, False)
    session.change(max_opening=0.6)
    rest(session)
    session.change(max_opening=0.7)
    assert (session.working, session.subject) == (None, second)
    session.change(max_opening=0.5)
    rest(session)
    session.change(max_opening=math.inf)  # three others were searched since it was shown
    assert session.working is not None
    session.change(max_opening=0.6)
    assert session.working is None
    session.close()


def test_epsilon_of_one_opening_is_not_taken_for_another() -> None:
    session = settled(viewing.box())
    session.change(max_opening=0.7)
    rest(session)
    session.change(paint="epsilon")
    assert session.working == ("measuring ε", 0.0)
    session.change(max_opening=math.inf)
    rest(session)
    assert session.subject is not None
    assert session.subject.epsilons is not None
    expected = viewing.box().epsilon
    assert session.subject.epsilons.nominal == pytest.approx(expected, nan_ok=True)
    assert session.subject.sampling == viewing.box().sampling


# Scans


def test_a_click_fixes_a_finger_and_another_moves_it() -> None:
    session = settled(viewing.labels())
    labels = viewing.labels()
    session.change(click="fix")
    session.tap(30)
    assert session.working == ("scanning", 0.0)
    rest(session)
    expected = scan_surface(labels.mesh, labels.model, fixed=labels.mesh.vertices[30])
    assert session.subject is not None
    assert session.subject.mode == "scan"
    assert np.array_equal(session.subject.critical_angle, expected.critical_angle)
    assert "1 finger fixed" in tell(session).facts
    session.tap(31)
    rest(session)
    assert len(session.shown.fixed) == 1
    session.tap(60, inspect=True)
    assert session.inspected is not None
    assert session.inspected.points[1] == pytest.approx(labels.mesh.vertices[31])
    session.change(fixed=())
    rest(session)
    assert session.subject is not None
    assert session.subject.mode == "label"


def test_two_of_three_fingers_are_fixed_one_after_the_other() -> None:
    session = settled(viewing.hands())
    session.change(click="fix")
    session.tap(3)
    rest(session)
    assert session.model.fingers == 2
    assert any("fix 1 more finger: these labels are of 2" in note for note in tell(session).notes)
    session.tap(20)
    rest(session)
    assert session.model.fingers == 3
    assert "2 fingers fixed" in tell(session).facts
    session.change(fingers=2)
    assert len(session.shown.fixed) == 1
    rest(session)
    assert session.subject is not None
    assert (session.subject.mode, session.model.fingers) == ("scan", 2)


def test_epsilon_of_a_scan_is_measured() -> None:
    session = settled(viewing.box())
    session.change(click="fix", paint="epsilon")
    session.tap(9)
    rest(session)
    subject = session.subject
    assert subject is not None
    assert subject.mode == "scan"
    assert subject.epsilons is not None
    assert subject.epsilons.model == session.model


def test_labels_of_a_scan_can_be_looked_at() -> None:
    session = settled(viewing.scan())
    assert session.subject is not None
    assert session.subject.mode == "scan"
    assert "1 finger fixed" in tell(session).facts
    assert {share.words for share in tell(session).shares} >= {"surely unstable"}
    session.change(friction=3.0, sensor_resolution=1.0)
    assert session.working is None


# Epsilon


def test_epsilon_is_measured_when_it_is_painted_and_told_while_it_is_old() -> None:
    labels = viewing.box()
    session = settled(replace(labels))
    session.change(paint="epsilon_min")
    assert session.working == ("measuring ε", 0.0)
    rest(session)
    session.change(friction=0.45)
    told = tell(session)
    assert told.ramp is not None
    assert told.ramp.words == "smallest ε over the tilts, of μ 0.5, α 22.6°; measuring"
    rest(session)
    subject = session.subject
    assert subject is not None
    assert subject.epsilons is not None
    expected = labels.relabel(friction=0.45)
    assert subject.epsilons.minimum == pytest.approx(expected.epsilon_min, nan_ok=True)
    assert np.array_equal(subject.critical_angle, labels.critical_angle)


@pytest.mark.parametrize(
    "model", [GraspModel(edges=6), GraspModel(actuation="per_finger", torsion_radius=0.05)]
)
def test_edges_actuation_and_torsion_are_carried_through(model: GraspModel) -> None:
    labels = replace(viewing.box(), model=model)
    session = settled(labels)
    session.change(paint="epsilon", friction=0.45)
    rest(session)
    assert session.subject is not None
    assert session.subject.epsilons is not None
    expected = labels.relabel(friction=0.45)
    assert session.subject.epsilons.nominal == pytest.approx(expected.epsilon, nan_ok=True)
    assert session.subject.epsilons.minimum == pytest.approx(expected.epsilon_min, nan_ok=True)


# Files


def test_a_click_on_a_lone_file_searches_its_grasps(file: Path) -> None:
    session = settled(open_album(file))
    before = session.subject
    assert before is not None
    session.tap(40)
    assert session.working == ("searching grasps", 0.0)
    seen = session.inspected
    assert seen is not None
    assert len(seen.points) == 1
    rest(session)
    assert session.subject is not None
    held = session.subject.reason == Reason.FOUND
    vertex = int(np.flatnonzero(held & (session.subject.critical_angle < 0.8))[0])
    session.tap(vertex)
    assert session.working is None
    seen = session.inspected
    assert seen is not None
    assert len(seen.points) == 2
    assert session.subject.model == before.model
    assert session.subject.cone == before.cone


def test_a_search_that_disagrees_with_the_file_is_told(file: Path) -> None:
    subject = read_subject(file)
    worse = np.full_like(subject.critical_angle, 0.9)
    other = replace(subject, critical_angle=worse, critical_angle_best=worse)
    album = Album((Exhibit("a", lambda _: other),), subject.model, Sampling(max_opening=0.3))
    session = settled(album)
    session.tap(40)
    rest(session)
    assert "has another label than in the file" in session.message
    session.change(friction=0.7)
    assert session.message == ""
    assert any("than in the file" in note for note in tell(session).notes)


def test_a_search_that_agrees_with_the_file_says_nothing(tmp_path: Path) -> None:
    write_ply(tmp_path / "box.ply", viewing.box())
    session = settled(open_album(tmp_path / "box.ply"))
    session.tap(9)
    rest(session)
    assert session.message == ""
    assert session.subject is not None
    assert session.subject.labels is not None


def _batched() -> Subject:
    """The cone as the files of a batch hold it: with partners, but without its mesh."""
    return replace(subject_of(viewing.labels()), labels=None)


def test_a_file_with_partners_keeps_them_when_epsilon_is_measured() -> None:
    labels = viewing.labels()
    model = replace(labels.model, friction=0.6)
    found = measured(_batched(), model, ignore)
    expected = labels.relabel(friction=0.6)
    assert found.partners is labels.partners
    assert found.critical_angle is labels.critical_angle
    assert found.epsilons is not None
    smooth = labels.mesh.normal_sets.counts == 1  # the normals of creases depend on the division
    held = smooth & np.isfinite(expected.epsilon)
    close = np.abs(found.epsilons.nominal[held] - expected.epsilon[held]) < 0.05
    assert close.mean() > 0.9
    assert np.array_equal(np.isnan(found.epsilons.nominal), np.isnan(expected.epsilon))


def test_a_mesh_of_a_file_keeps_its_vertices() -> None:
    subject = _batched()
    mesh = mesh_of(subject)
    assert np.array_equal(mesh.vertices, subject.vertices)
    assert mesh.options == subject.options
    assert mesh.unit == "cm"
    assert mesh_of(subject_of(viewing.labels())) is viewing.labels().mesh


def test_partners_that_are_off_the_surface_are_refused() -> None:
    subject = _batched()
    assert subject.partners is not None
    with pytest.raises(MeshError, match="not on its surface"):
        prepared(replace(subject, partners=subject.partners + 0.2), ignore)
    with pytest.raises(SettingError, match="does not name the fingers"):
        prepared(replace(subject, partners=None), ignore)


def test_a_click_on_a_batch_needs_no_work_until_another_epsilon_is_wanted() -> None:
    labels = viewing.labels()
    labels.measure(ignore)
    subject = replace(subject_of(labels), labels=None)
    album = Album((Exhibit("a", lambda _: subject),), labels.model, Sampling(max_opening=0.3))
    session = settled(album)
    vertex = int(np.flatnonzero(labels.reason == Reason.FOUND)[0])
    session.tap(vertex)
    assert session.working is None
    seen = session.inspected
    assert seen is not None
    assert len(seen.points) == 2
    assert dict(seen.numbers)["ε"] == f"{labels.epsilon[vertex]:.3g}"
    session.change(friction=0.6)
    assert session.working == ("preparing grasps", 0.0)
    assert session.inspected is not None
    assert dict(session.inspected.numbers)["ε"] == "–"
    rest(session)
    assert session.inspected is not None
    assert dict(session.inspected.numbers)["ε"] != "–"
    assert session.message == ""


def test_a_scanned_file_is_left_as_it_is(tmp_path: Path) -> None:
    write_ply(tmp_path / "scan.ply", viewing.scan())
    session = settled(open_album(tmp_path / "scan.ply"))
    session.tap(40)
    session.change(paint="epsilon", friction=0.9)
    assert session.working is None
    assert tell(session).inspected is not None
    with pytest.raises(SettingError, match="does not name its fixed fingers"):
        session.save(tmp_path / "again.ply")
    session.change(fixed=((0.0, 0.0, 0.0),))
    rest(session)
    assert session.subject is not None
    assert session.subject.labels is not None


# Saving


def _shares(path: Path) -> dict[str, float]:
    session = settled(open_album(path))
    return {share.letter: share.share for share in tell(session).shares}


def test_what_is_saved_is_what_is_shown(tmp_path: Path) -> None:
    session = settled(viewing.labels())
    session.change(friction=0.6, sensor_resolution=0.2)
    session.save(tmp_path / "a.ply")
    assert session.message.endswith("a.ply")
    shown = {share.letter: share.share for share in tell(session).shares}
    assert _shares(tmp_path / "a.ply") == pytest.approx(shown, abs=1e-6)
    assert read_subject(tmp_path / "a.ply").model == session.model
    assert session.subject is not None
    assert session.subject.epsilons is not None
    assert session.subject.epsilons.model == session.model


def test_files_are_saved_in_the_background(tmp_path: Path, file: Path) -> None:
    session = settled(open_album(file))
    session.change(friction=0.6)
    session.save_soon(tmp_path / "a.npz")
    assert session.working == ("saving a.npz", 0.0)
    session.change(paint="critical_angle")
    rest(session)
    assert session.message == f"saved: {tmp_path / 'a.npz'}"
    with np.load(tmp_path / "a.npz") as data:
        assert str(data["setting_friction"]) == "0.6"
    session.save_soon(tmp_path / "none" / "a.ply")
    rest(session)
    assert "none" in session.message
    assert not session.message.startswith("saved")
    with pytest.raises(OutputError, match="no format is called"):
        session.save_soon(tmp_path / "a.txt")


def test_scans_are_saved_with_their_fixed_finger(tmp_path: Path) -> None:
    session = settled(viewing.labels())
    session.change(fixed=(tuple(map(float, viewing.labels().mesh.vertices[30])),))
    rest(session)
    session.save(tmp_path / "scan.ply")
    assert read_subject(tmp_path / "scan.ply").mode == "scan"
    assert session.subject is not None
    assert session.subject.mode == "scan"


def test_beyond_the_search_nothing_is_saved(tmp_path: Path) -> None:
    session = settled(viewing.labels())
    session.change(friction=3.0)
    for save in (session.save, session.save_soon):
        with pytest.raises(GraspError, match="are not searched yet"):
            save(tmp_path / "a.ply")
    session.close()


def test_a_batch_is_saved_with_its_partners(tmp_path: Path) -> None:
    subject, told = _batched(), list[float]()
    assert subject.partners is not None
    found = saving.written(subject, subject.model, tmp_path / "a.npz", told.append)
    assert found.labels is not None
    assert sorted(told) == told
    with np.load(tmp_path / "a.npz") as data:
        assert np.array_equal(data["partners"], subject.partners, equal_nan=True)
        assert np.array_equal(data["grip"], viewing.labels().grip)


# One after the other


def test_objects_come_one_after_the_other_whatever_is_under_way() -> None:
    one, two = subject_of(viewing.labels(), "one"), subject_of(viewing.box(), "two")
    go_on = threading.Event()

    def slow(progress: Progress) -> Subject:
        while not go_on.is_set():
            progress(0.5)
            time.sleep(0.001)
        return two

    album = Album((Exhibit("one", lambda _: one), Exhibit("two", slow)), one.model, Sampling())
    session = Session(album)
    session.change(max_opening=0.3)
    rest(session)
    session.tap(3)
    session.step(1)
    assert tell(session).title == "two (2 of 2)"
    assert (session.subject, session.inspected) == (None, None)
    session.step(1)
    rest(session)
    assert session.subject is not None
    assert session.subject.name == "one"
    go_on.set()
    session.step(-1)
    rest(session)
    assert session.subject is not None
    assert session.subject.name == "two"
    revision = session.revision
    session.step(2)
    assert session.revision == revision
    session.close()
    assert session.working is None


# Telling


@pytest.mark.parametrize(
    ("model", "rule"),
    [
        (GraspModel(), "β*: S below 15.3°, U from 37.9° on"),
        (GraspModel(sensor_resolution=1.2), "β*: no S, U from 60.9° on"),
        (GraspModel(friction=2.0, sensor_resolution=1.2, fingers=3), "β*: S below 29.1°, no U"),
    ],
)
def test_the_rule_tells_from_where_to_where_s_and_u_reach(model: GraspModel, rule: str) -> None:
    labels = viewing.box() if model.fingers == 2 else viewing.hands()
    session = Session(album_of(replace(labels, model=model)))
    assert tell(session).rules == (rule,)
    session.close()


def test_of_two_resolutions_each_has_its_rule() -> None:
    session = settled(viewing.box())
    session.change(compare=math.radians(40.0))
    told = tell(session)
    assert told.rules == (
        "α 22.6°: S below 15.3°, U from 37.9° on", "α 40°: S below 6.6°, U from 46.6° on"
    )  # fmt: skip
    session.close()


def test_all_is_told_of_an_object() -> None:
    session = settled(viewing.labels())
    session.tap(40)
    told = tell(session)
    mesh = viewing.labels().mesh
    assert told.facts == f"size {mesh.size:.3g} cm, {len(mesh.vertices):,} vertices, closed"
    assert [share.letter for share in told.shares] == ["S", "M", "U"]
    assert sum(share.share for share in told.shares) == pytest.approx(1.0)
    assert [share.color for share in told.shares] == ["#009E73", "#F0E442", "#D55E00"]
    assert told.ramp is None
    assert told.inspected is session.inspected
    assert (told.other_shares, told.working, told.message) == ((), None, "")
    session.tell("hello")
    assert tell(session).message == "hello"
    unknown = replace(viewing.box().mesh.report, unit=None, warnings=("mind the gap",))
    labels = replace(viewing.box(), mesh=replace(viewing.box().mesh, report=unknown))
    other = tell(settled(labels))
    assert "(unit not stated)" in other.facts
    assert other.notes == ("mind the gap",)


def test_notes_of_the_album_are_told() -> None:
    album = album_of(viewing.box())
    assert "2 left out" in tell(settled(replace(album, notes=("2 left out",)))).notes


def test_what_is_shown_at_first_is_checked_as_well() -> None:
    with pytest.raises(SettingError):
        Shown(GraspModel(), 1.0, paint="none")  # type: ignore[arg-type]
    with pytest.raises(SettingError, match="a section lies across"):
        Section("w")  # type: ignore[arg-type]


# The worker


@pytest.fixture
def worker() -> Iterator[Worker[int]]:
    before = threading.active_count()
    worker: Worker[int] = Worker()
    yield worker
    worker.want(None)
    _until(lambda: threading.active_count() <= before)


def _until(done: Callable[[], object]) -> None:
    end = time.monotonic() + viewing.PATIENCE
    while not done():
        assert time.monotonic() < end
        time.sleep(0.001)


def _taken(worker: Worker[int]) -> tuple[int | None, str | None]:
    found = []

    def look() -> bool:
        ended = worker.take()
        if ended is not None:
            found.append((ended.result, ended.error))
        return bool(found)

    _until(look)
    return found[0]


def _endless(begun: threading.Event) -> Callable[[Progress], int]:
    def work(progress: Progress) -> int:
        while True:
            progress(0.25)
            begun.set()
            time.sleep(0.001)

    return work


def test_the_newest_work_is_done_and_the_older_one_ends(worker: Worker[int]) -> None:
    begun = threading.Event()
    worker.want(Job("a", "endless", _endless(begun)))
    assert begun.wait(60)
    assert worker.share == 0.25
    worker.want(Job("b", "quick", lambda _: 7))
    assert worker.job is not None
    assert worker.job.key == "b"
    assert worker.share == 0.0
    assert _taken(worker) == (7, None)
    assert worker.job is None
    assert worker.take() is None


def test_work_under_the_same_key_goes_on(worker: Worker[int]) -> None:
    count: list[int] = []
    go_on = threading.Event()

    def work(_: Progress) -> int:
        count.append(1)
        assert go_on.wait(60)
        return 1

    for _ in range(3):
        worker.want(Job("a", "once", work))
    go_on.set()
    assert _taken(worker) == (1, None)
    assert len(count) == 1


def test_work_that_was_given_up_never_delivers(worker: Worker[int]) -> None:
    go_on, ended = threading.Event(), threading.Event()

    def stubborn(_: Progress) -> int:
        assert go_on.wait(60)
        ended.set()
        return 1

    worker.want(Job("a", "stubborn", stubborn))
    worker.want(None)
    assert worker.job is None
    go_on.set()
    assert ended.wait(60)
    worker.want(Job("b", "quick", lambda _: 2))
    assert _taken(worker) == (2, None)
    assert worker.take() is None


def test_work_that_is_held_back_is_not_begun_when_something_newer_comes(
    worker: Worker[int],
) -> None:
    begun = threading.Event()
    worker.want(Job("a", "held", _endless(begun), pause=3600.0))
    worker.want(Job("b", "quick", lambda _: 2))
    assert _taken(worker) == (2, None)
    assert not begun.is_set()


@pytest.mark.parametrize(
    ("error", "words"),
    [
        (MeshError("no surface"), "no surface"),
        (MemoryError(), "working: memory is too small; use a coarser mesh"),
        (ZeroDivisionError("oh"), "unexpected ZeroDivisionError: oh; please report this mesh"),
    ],
)
def test_errors_are_told(worker: Worker[int], error: Exception, words: str) -> None:
    def fail(_: Progress) -> int:
        raise error

    worker.want(Job("a", "working", fail))
    assert _taken(worker) == (None, words)


def test_abandoned_is_no_error_that_a_bug_could_catch() -> None:
    assert not issubclass(Abandoned, Exception)


def test_grey_is_told_with_its_share() -> None:
    subject = replace(subject_of(viewing.labels()), cone=0.1, model=GraspModel(friction=0.05))
    album = Album((Exhibit("a", lambda _: subject),), GraspModel(), Sampling(max_opening=0.3))
    session = Session(album)
    _until(session.poll)
    shares = tell(session).shares
    assert shares[-1].color == "#9AA0A6"
    assert len(shares) - 1 == UNSEARCHED
    assert sum(share.share for share in shares) == pytest.approx(1.0)
    assert shares[2].letter == Label.U.name
    assert shares[2].share == 0.0
    session.close()
