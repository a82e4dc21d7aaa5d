"""The panel beside the scene, without a window."""

import math
from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from vtkmodules.vtkRenderingCore import vtkRenderer

from grasp3d import GraspModel, Sampling, SurfaceLabels, label_surface
from grasp3d.errors import SettingError
from grasp3d.mesh.primitives import box_mesh
from grasp3d.settings import DEGREE
from grasp3d.viewer.session.album import album_of
from grasp3d.viewer.session.history import History
from grasp3d.viewer.session.keys import KEYS, press
from grasp3d.viewer.session.session import Session
from grasp3d.viewer.session.state import Section
from grasp3d.viewer.session.telling import tell
from grasp3d.viewer.window.board import Board, row_width
from grasp3d.viewer.window.canvas import middle_cut, shortened, width_of, wrapped
from grasp3d.viewer.window.desktop import MOST, NARROWEST, PANEL, WIDEST
from grasp3d.viewer.window.helping import help_card
from grasp3d.viewer.window.panel import ALWAYS, Content, content_of
from grasp3d.viewer.window.rows import (
    Choices,
    Gap,
    Pair,
    RampStrip,
    Row,
    ShareLine,
    Spot,
    Track,
    Words,
    WorkBar,
)
from grasp3d.viewer.window.sliders import Ranges, sliders_of

SIZES = [(900, 600), (1000, 1000), (1280, 800), (1920, 1200)]
WORDS = st.text(st.characters(codec="utf-8", exclude_categories=["C", "Z"]), min_size=1)


@pytest.fixture(scope="module")
def labels() -> SurfaceLabels:
    mesh = box_mesh((0.1, 0.2, 0.3), max_edge=0.1)
    return label_surface(mesh, GraspModel(), sampling=Sampling(rays=8), threads=1)


@pytest.fixture
def session(labels: SurfaceLabels) -> Session:
    made = Session(album_of(labels))
    while made.subject is None:
        made.poll()
    return made


def panel_width(width: int) -> float:
    return round(min(WIDEST, max(NARROWEST, PANEL * width), MOST * width))


def content(session: Session, width: float, **options: Any) -> Content:
    told = replace(tell(session), notes=("The mesh has 2 holes. " * 9, "It is small."))
    told = replace(told, message="saved: /somewhere/with/a/long/name/" + "x" * 200)
    told = replace(told, working=("searching grasps", 0.314))
    answer = options.pop("press", lambda key: press(session, key))
    return content_of(session, told, Ranges(), row_width(width), press=answer, **options)


def laid_out(session: Session, size: tuple[int, int], **options: Any) -> Board:
    board = Board(vtkRenderer())
    width = panel_width(size[0])
    assert board.show(content(session, width, **options), width, size[1], 1.0)
    return board


def spot(board: Board, name: str) -> Spot:
    return next(one for one in board.spots if one.name == name)


def middle(one: Spot) -> tuple[float, float]:
    left, top, right, bottom = one.box
    return 0.5 * (left + right), 0.5 * (top + bottom)


@given(st.lists(WORDS, max_size=30), st.floats(20.0, 400.0))
def test_wrapped_lines_fit_and_lose_nothing(words: list[str], width: float) -> None:
    text = " ".join(words)
    lines = wrapped(text, width)
    assert "".join(lines).replace(" ", "") == "".join(text.split())
    widest = max((width_of(letter) for letter in text), default=0.0)
    assert all(width_of(line) <= max(width, widest) for line in lines)


def test_long_texts_end_in_dots() -> None:
    lines = wrapped("one two three four five six seven", 60.0, most=2)
    assert len(lines) == 2
    assert lines[1].endswith("…")
    assert width_of(lines[1]) <= 60.0
    assert shortened("short", 100.0) == "short"


@given(WORDS, st.floats(20.0, 400.0))
def test_of_long_names_both_ends_stay(name: str, width: float) -> None:
    short = middle_cut(name, width)
    assert short == name or width_of(short) <= width
    begin, _, end = short.partition("…")
    assert short == name or (name.startswith(begin) and name.endswith(end))
    long = "a very long name of an object that nobody reads.glb (2 of 5)"
    assert middle_cut(long, 200.0).endswith("(2 of 5)")


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("crowded", [False, True])
def test_nothing_overlaps_or_is_cut_off(
    session: Session, size: tuple[int, int], crowded: bool
) -> None:
    if crowded:
        session.change(compare=40.0 * DEGREE, section=Section(), paint="critical_angle")
        session.tap(3)
    board = laid_out(session, size)
    boxes = [one.box for one in board.spots]
    width = panel_width(size[0])
    for number, (left, top, right, bottom) in enumerate(boxes):
        assert 0.0 <= left < right <= width
        assert 0.0 <= top < bottom <= size[1]
        for other in boxes[:number]:
            apart = right <= other[0] or other[2] <= left or bottom <= other[1] or other[3] <= top
            assert apart, (boxes[number], other)
    fitted = content(session, width).fitted(size[1] - 24.0)
    assert sum(row.height for rows in fitted for row in rows) <= size[1] - 24.0
    assert {one.name for one in board.spots} >= {"friction", "sensor_resolution", "key-2"}


def test_the_lightest_rows_fall_away_first(session: Session) -> None:
    session.change(paint="critical_angle")
    session.tap(3)
    whole = content(session, 380.0)

    def weights(room: float) -> list[int]:
        return [row.weight for part in whole.fitted(room) for row in part]

    everything = sorted(weights(5000.0))
    for room in range(0, 1000, 20):
        kept = weights(float(room))
        assert sorted(kept) == everything[len(everything) - len(kept) :]
    assert set(weights(0.0)) == {ALWAYS}


def test_what_is_chosen_is_told(session: Session) -> None:
    session.change(paint="max_resolution", section=Section("y"), fingers=2)
    rows: list[Row] = [*content(session, 380.0).upper]
    active = {
        button.name
        for row in rows
        if isinstance(row, Choices)
        for button in row.buttons
        if button.active
    }
    assert active == {"fingers-2", "key-3", "click-inspect", "section-y"}
    ramp = next(row for row in rows if isinstance(row, RampStrip))
    assert ramp.high == f"{2.0 * math.degrees(math.atan(0.5)):.3g}°"
    assert "section" in {row.name for row in rows if isinstance(row, Track)}
    session.tap(3)
    rows = [*content(session, 380.0).upper]
    found = session.inspected
    assert found is not None
    assert [(r.name, r.value) for r in rows if isinstance(r, Pair)] == list(found.numbers)
    assert found.reason in {row.text for row in rows if isinstance(row, Words)}


def rows_of(session: Session) -> list[Row]:
    told = tell(session)
    made = content_of(session, told, Ranges(), 344.0, press=lambda key: press(session, key))
    return [*made.upper, *made.lower]


@pytest.mark.parametrize("compare", [None, 40.0 * DEGREE])
def test_shares_keep_their_place_while_they_are_searched(
    session: Session, compare: float | None
) -> None:
    session.change(compare=compare)
    while session.working is not None:
        session.poll()
    columns = 1 if compare is None else 2

    def tops() -> dict[str, float]:
        found, top = {}, 0.0
        for row in rows_of(session):
            if isinstance(row, ShareLine | Track):
                found[row.words] = top
            top += row.height
        return found

    before = tops()
    session.change(fingers=3)
    rows = rows_of(session)
    assert [row.shares for row in rows if isinstance(row, ShareLine)] == [("…",) * columns] * 3
    assert [row.words for row in rows if isinstance(row, WorkBar)] == ["searching grasps"]
    assert [name for name, top in tops().items() if before.get(name) != top] == [
        "reach of the hand"
    ]
    session.tap(3)
    said = [row.text for row in rows_of(session) if isinstance(row, Words)]
    assert "searching grasps … Then the grasp of the clicked place is shown." in said
    session.change(click="fix", fixed=((0.0, 0.0, 0.15),), fingers=2, vertex=None)
    said = [row.text for row in rows_of(session) if isinstance(row, Words)]
    assert any("One finger is fixed; how good each place is" in text for text in said)
    assert not any("colours tell" in text for text in said)
    session.close()


def test_what_cannot_be_searched_is_told_in_place_of_shares(
    session: Session, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("grasp3d.costs.PER_VERTEX", (0.0, 1.0))
    session.change(fingers=3)
    session.tap(3)
    while session.working is not None:
        session.poll()
    rows = rows_of(session)
    assert [row.shares for row in rows if isinstance(row, ShareLine)] == [("–",)] * 3
    said = [row.text for row in rows if isinstance(row, Words)]
    assert "The grasp here is not known for what is chosen." in said
    assert session.message in said


def test_what_is_said_stands_right_under_the_buttons(session: Session) -> None:
    session.change(friction=2.0)  # a wider search
    session.tell("saved: a.ply")
    rows = rows_of(session)
    last = max(at for at, row in enumerate(rows) if isinstance(row, Choices))
    after = [type(row) for row in rows[last + 1 : last + 4]]
    assert after == [Gap, Words, WorkBar]
    session.close()


def test_epsilon_is_noted_to_change_and_grey_is_explained_where_it_is(session: Session) -> None:
    session.change(paint="epsilon")
    rows = rows_of(session)
    strip = next(row for row in rows if isinstance(row, RampStrip))
    assert strip.grey == "not measured yet"
    assert any("alike in β*" in row.text for row in rows if isinstance(row, Words))
    session.change(paint="critical_angle")
    strip = next(row for row in rows_of(session) if isinstance(row, RampStrip))
    assert (strip.low, strip.grey) == ("0°", "")
    session.close()


@pytest.mark.parametrize("name", ["friction", "sensor_resolution", "compare", "section"])
@pytest.mark.parametrize("share", [0.0, 0.25, 1.0])
def test_sliders_stand_where_they_are_put(session: Session, name: str, share: float) -> None:
    session.change(compare=40.0 * DEGREE, section=Section("z"))

    def slider() -> Any:
        return next(one for one in sliders_of(session, Ranges()) if one.name == name)

    said = slider().said(share)
    slider().set(share)
    assert slider().share == pytest.approx(share, abs=0.005)
    assert slider().value == said


def test_sliders_reach_what_is_asked_for(session: Session) -> None:
    ranges = Ranges()
    session.change(friction=3.0, sensor_resolution=120.0 * DEGREE)
    friction, resolution, opening = sliders_of(session, ranges)
    assert (friction.share, friction.value) == (1.0, "3.00")
    assert resolution.value == "120.0°"
    assert resolution.share < 1.0
    assert (opening.share, opening.value) == (1.0, "no limit")
    session.change(friction=0.5, sensor_resolution=0.1234567)
    friction, resolution, _ = sliders_of(session, ranges)
    assert friction.share < 0.2
    assert resolution.value == f"{math.degrees(0.1234567):.4g}°"


def test_a_search_slider_acts_when_it_is_released(session: Session) -> None:
    board = laid_out(session, (1280, 800))
    left, right = spot(board, "opening").track or (0.0, 0.0)
    y = middle(spot(board, "opening"))[1]
    board.press(left + 0.9 * (right - left), y)
    assert board.move(left + 0.5 * (right - left), y + 300.0)
    assert board.dragged == ("opening", pytest.approx(0.5))
    assert math.isinf(session.shown.max_opening)
    tracks = [
        row
        for row in content(session, 380.0, dragged=board.dragged).upper
        if isinstance(row, Track) and row.name == "opening"
    ]
    assert tracks[0].value != "no limit"
    board.release(0.5 * (left + right), y)
    assert board.dragged is None
    size = session.subject.size if session.subject else 0.0
    assert session.shown.max_opening == pytest.approx(0.51 * size, rel=0.01)
    session.close()


def test_a_slider_ends_where_it_is_released(session: Session) -> None:
    board = laid_out(session, (1280, 800))
    left, right = spot(board, "friction").track or (0.0, 0.0)
    board.press(left, middle(spot(board, "friction"))[1])
    board.release(right + 50.0, -100.0)
    assert session.shown.model.friction == 1.5
    session.close()


def test_a_button_acts_where_it_is_pressed_and_released(session: Session) -> None:
    pressed: list[str] = []
    board = laid_out(session, (1280, 800), press=pressed.append)
    here, there = middle(spot(board, "key-2")), middle(spot(board, "key-3"))
    for start, end in ((here, there), (here, (-50.0, 0.0)), ((1.0, 1.0), here)):
        board.press(*start)
        board.release(*end)
    assert pressed == []
    board.press(*here)
    board.release(*here)
    assert pressed == ["2"]


def test_every_button_does_something(session: Session) -> None:
    session.change(section=Section())
    session.tap(3)
    session.change(fixed=((0.0, 0.0, 0.0),))
    whole = content(session, 380.0)
    for row in whole.upper:
        for one in row.spots((18.0, 0.0, 362.0, row.height)):
            assert one.name in whole.actions or one.name in whole.sliders
    session.close()


def test_the_mouse_over_a_button_is_seen(session: Session) -> None:
    board = laid_out(session, (1280, 800))
    here = middle(spot(board, "key-2"))
    assert board.move(*here)
    assert not board.move(here[0] + 1.0, here[1])
    assert board.over
    assert board.leave()
    assert not board.show(content(session, 380.0), 380.0, 800.0, 1.0)


def test_the_wheel_moves_a_slider(session: Session) -> None:
    board = laid_out(session, (1280, 800))
    board.turn(*middle(spot(board, "friction")), 2)
    assert session.shown.model.friction == pytest.approx(0.5 + 0.02 * 1.49, abs=0.006)
    before = session.shown
    board.turn(*middle(spot(board, "opening")), -2)
    board.turn(1.0, 1.0, 2)
    assert session.shown == before


def test_undo_goes_back_step_by_step(session: Session) -> None:
    history = History(session)
    shown = [session.shown]
    for key in ("Right", "c", "2", "f"):
        press(session, key)
        history.note()
        history.note()
        shown.append(session.shown)
    for before in reversed(shown[:-1]):
        history.undo()
        assert session.shown == before
    history.undo()
    assert session.message == "nothing to undo"


def test_keys_of_the_window_are_not_the_sessions(session: Session) -> None:
    own = {key for key, known in KEYS.items() if known.do is None}
    before = session.shown
    assert own == {"s", "g", "r", "+", "-", "z", "h", "q"}
    assert not any(press(session, key) for key in [*own, "w", "F1"])
    assert session.shown == before


def test_a_key_that_goes_too_far_is_answered(session: Session) -> None:
    session.change(sensor_resolution=179.0 * DEGREE)
    assert press(session, "Up")
    assert "sensor resolution must" in session.message
    with pytest.raises(SettingError):
        session.change(sensor_resolution=181.0 * DEGREE)
    session.close()


@pytest.mark.parametrize("size", [(320.0, 240.0), *SIZES])
def test_the_help_fits_into_the_window(size: tuple[float, float]) -> None:
    height, width, _ = help_card(*size, 1.0).shape
    assert width < size[0]
    assert height < size[1]
    assert help_card(*size, 2.0).shape[:2] == (2 * height, 2 * width)
