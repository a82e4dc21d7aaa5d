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
from grasp3d.viewer.scene.text_layout import middle_cut, shortened, text_width, wrapped
from grasp3d.viewer.session.collection import collection_of
from grasp3d.viewer.session.history import History
from grasp3d.viewer.session.keys import KEYS, handle_key
from grasp3d.viewer.session.panel_text import panel_text
from grasp3d.viewer.session.session import Session
from grasp3d.viewer.session.state import Section
from grasp3d.viewer.window.desktop import MAX_PANEL, NARROWEST, PANEL, WIDEST
from grasp3d.viewer.window.help_overlay import help_image
from grasp3d.viewer.window.panel import Content, panel_content
from grasp3d.viewer.window.panel_widget import PanelWidget, row_width
from grasp3d.viewer.window.rows import (
    ButtonRow,
    FractionRow,
    Gap,
    HitArea,
    ProgressRow,
    RampRow,
    Row,
    SliderRow,
    TextRow,
    ValueRow,
)
from grasp3d.viewer.window.sliders import Ranges, sliders_of

SIZES = [(800, 520), (900, 600), (1000, 1000), (1280, 800), (1920, 1200)]
WORDS = st.text(st.characters(codec="utf-8", exclude_categories=["C", "Z"]), min_size=1)


@pytest.fixture(scope="module")
def labels() -> SurfaceLabels:
    mesh = box_mesh((0.1, 0.2, 0.3), max_edge=0.1)
    return label_surface(mesh, GraspModel(), sampling=Sampling(rays=8), threads=1)


@pytest.fixture
def session(labels: SurfaceLabels) -> Session:
    made = Session(collection_of(labels))
    while made.subject is None:
        made.poll()
    return made


def panel_width(width: int) -> float:
    return round(min(WIDEST, max(NARROWEST, PANEL * width), MAX_PANEL * width))


def content(session: Session, width: float, **options: Any) -> Content:
    text = replace(panel_text(session), notes=("The mesh has 2 holes. " * 9, "It is small."))
    text = replace(text, message="saved: /somewhere/with/a/long/name/" + "x" * 200)
    text = replace(text, working=("searching grasps", 0.314))
    press = options.pop("press", lambda key: handle_key(session, key))
    return panel_content(session, text, Ranges(), row_width(width), press=press, **options)


def laid_out(session: Session, size: tuple[int, int], **options: Any) -> PanelWidget:
    widget = PanelWidget(vtkRenderer())
    width = panel_width(size[0])
    assert widget.show(content(session, width, **options), width, size[1], 1.0)
    return widget


def area_of(widget: PanelWidget, name: str) -> HitArea:
    return next(one for one in widget.hit_areas if one.name == name)


def middle(one: HitArea) -> tuple[float, float]:
    left, top, right, bottom = one.box
    return 0.5 * (left + right), 0.5 * (top + bottom)


@given(st.lists(WORDS, max_size=30), st.floats(20.0, 400.0))
def test_wrapped_lines_fit_and_are_complete(words: list[str], width: float) -> None:
    text = " ".join(words)
    lines = wrapped(text, width, max_lines=len(text) + 1)
    assert "".join(lines).replace(" ", "") == "".join(text.split())
    widest = max((text_width(letter) for letter in text), default=0.0)
    assert all(text_width(line) <= max(width, widest) for line in lines)


def test_long_texts_end_in_an_ellipsis() -> None:
    lines = wrapped("one two three four five six seven", 60.0, max_lines=2)
    assert len(lines) == 2
    assert lines[1].endswith("…")
    assert text_width(lines[1]) <= 60.0
    assert shortened("short", 100.0) == "short"


@given(WORDS, st.floats(20.0, 400.0))
def test_long_names_keep_both_ends(name: str, width: float) -> None:
    short = middle_cut(name, width)
    assert short == name or text_width(short) <= width
    begin, _, end = short.partition("…")
    assert short == name or (name.startswith(begin) and name.endswith(end))
    long = "a very long name of an object that nobody reads.glb (2 of 5)"
    assert middle_cut(long, 200.0).endswith("(2 of 5)")


@pytest.mark.slow
@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("crowded", [False, True])
def test_areas_do_not_overlap_and_all_are_reached_by_scrolling(
    session: Session, size: tuple[int, int], crowded: bool
) -> None:
    if crowded:
        session.change(compare=40.0 * DEGREE, section=Section())
        session.click(3)
    widget, width = laid_out(session, size), panel_width(size[0])
    seen: set[str] = set()
    widget.turn_wheel(100.0, 5.0, 99)
    for _ in range(20):
        widget.turn_wheel(100.0, 5.0, -1)
        widget.show(content(session, width), width, size[1], 1.0)
        boxes = [one.box for one in widget.hit_areas]
        for number, (left, top, right, bottom) in enumerate(boxes):
            assert 0.0 <= left < right <= width
            assert 0.0 <= top < bottom <= size[1]
            for other in boxes[:number]:
                apart = right <= other[0] or other[2] <= left
                assert apart or bottom <= other[1] or other[3] <= top, (boxes[number], other)
        seen |= {one.name for one in widget.hit_areas}
    whole = content(session, width)
    assert seen - {"scroll"} == {
        area.name for row in whole.upper for area in row.hit_areas((18.0, 0.0, 300.0, row.height))
    }
    needed = sum(row.height for part in whole.fitted(size[1]) for row in part) + 24.0 > size[1]
    assert ("scroll" in seen) == needed


def scrolled(session: Session, by: int) -> PanelWidget:
    """A low panel, scrolled down by steps of the wheel."""
    widget = laid_out(session, (800, 520))
    assert widget.turn_wheel(100.0, 5.0, -by)
    assert widget.show(content(session, 300.0), 300.0, 520.0, 1.0)
    return widget


def test_the_scroll_bar_is_dragged(session: Session) -> None:
    widget = laid_out(session, (800, 520))
    before = middle(area_of(widget, "friction"))[1]
    x = middle(area_of(widget, "scroll"))[0]
    widget.press(x, 10.0)
    assert widget.move(x, 10.0 + 60.0)
    widget.release(x, 10.0 + 60.0)
    widget.show(content(session, 300.0), 300.0, 520.0, 1.0)
    assert middle(area_of(widget, "friction"))[1] < before - 60.0
    assert not widget.turn_wheel(100.0, 5.0, 99) or widget.mouse_state[2] == 0.0


def test_a_click_scrolls_to_the_numbers_of_the_vertex(session: Session) -> None:
    widget = laid_out(session, (800, 520))
    session.click(3)
    widget.show(content(session, 300.0), 300.0, 520.0, 1.0)
    assert isinstance(widget.mouse_state[2], float)
    assert widget.mouse_state[2] > 100.0
    widget.turn_wheel(100.0, 5.0, 99)
    widget.show(content(session, 300.0), 300.0, 520.0, 1.0)
    assert widget.mouse_state[2] == 0.0  # only once


@pytest.mark.parametrize("size", [(800, 520), (1280, 800)])
@pytest.mark.parametrize("compare", [None, 40.0 * DEGREE])
def test_no_row_moves_while_a_slider_is_dragged(
    session: Session, size: tuple[int, int], compare: float | None
) -> None:
    session.change(compare=compare)
    session.click(3)
    width = panel_width(size[0])
    widget = PanelWidget(vtkRenderer())

    def tops(**changes: Any) -> dict[str, float]:
        text = replace(panel_text(session), **changes)
        press = lambda key: handle_key(session, key)  # noqa: E731
        shown = panel_content(session, text, Ranges(), row_width(width), press=press)
        widget.show(shown, width, size[1], 1.0)
        return {one.name: one.box[1] for one in widget.hit_areas}

    tops()
    widget.turn_wheel(100.0, 5.0, 99)
    widget.turn_wheel(100.0, 5.0, -1)
    before = tops(message="saved: a.ply", working=None)
    widget.press(*middle(area_of(widget, "sensor_resolution")))
    for degrees in (0.0, 88.8, 5.0, 60.0):
        session.change(sensor_resolution=degrees * DEGREE)
        after = tops(working=("searching grasps", 0.5))
        common = before.keys() & after.keys()
        assert "sensor_resolution" in common
        assert {key: after[key] for key in common} == {key: before[key] for key in common}
    session.close()


def test_the_panel_shows_the_current_choices(session: Session) -> None:
    session.change(paint="max_resolution", section=Section("y"), fingers=2)
    rows: list[Row] = [*content(session, 380.0).upper]
    active = {
        button.name
        for row in rows
        if isinstance(row, ButtonRow)
        for button in row.buttons
        if button.active
    }
    assert active == {"fingers-2", "key-3", "click-inspect", "section-y"}
    ramp = next(row for row in rows if isinstance(row, RampRow))
    assert ramp.high == f"{2.0 * math.degrees(math.atan(0.5)):.3g}°"
    assert "section" in {row.name for row in rows if isinstance(row, SliderRow)}
    session.click(3)
    rows = [*content(session, 380.0).upper]
    found = session.inspection
    assert found is not None
    assert [(r.name, r.value) for r in rows if isinstance(r, ValueRow)] == list(found.numbers)
    assert found.reason in {row.text for row in rows if isinstance(row, TextRow)}


def rows_of(session: Session) -> list[Row]:
    text, press = panel_text(session), lambda key: handle_key(session, key)
    rows = panel_content(session, text, Ranges(), 344.0, press=press)
    return [*rows.upper, *rows.lower]


@pytest.mark.slow
@pytest.mark.parametrize("compare", [None, 40.0 * DEGREE])
def test_rows_of_fractions_stay_in_place_during_a_search(
    session: Session, compare: float | None
) -> None:
    session.change(compare=compare)
    while session.working is not None:
        session.poll()
    columns = 1 if compare is None else 2

    def tops() -> dict[str, float]:
        found, top = {}, 0.0
        for row in rows_of(session):
            if isinstance(row, FractionRow | SliderRow):
                found[row.text] = top
            top += row.height
        return found

    before = tops()
    session.change(fingers=3)
    rows = rows_of(session)
    assert [row.percents for row in rows if isinstance(row, FractionRow)] == [("…",) * columns] * 3
    assert [row.text for row in rows if isinstance(row, ProgressRow)] == ["searching grasps"]
    assert [name for name, top in tops().items() if before.get(name) != top] == ["largest spread"]
    session.click(3)
    texts = [row.text for row in rows_of(session) if isinstance(row, TextRow)]
    assert "searching grasps … Then the grasp of the clicked vertex is shown." in texts
    session.change(click="fix", fixed=((0.0, 0.0, 0.15),), fingers=2, vertex=None)
    texts = [row.text for row in rows_of(session) if isinstance(row, TextRow)]
    assert any(
        "One finger is fixed; the labels for the next one are not known" in text for text in texts
    )
    assert not any("the colours are for" in text for text in texts)
    session.close()


def test_a_failed_search_is_reported_in_place_of_fractions(
    session: Session, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("grasp3d.settings.costs.PER_VERTEX", (0.0, 1.0))
    session.change(fingers=3)
    session.click(3)
    while session.working is not None:
        session.poll()
    rows = rows_of(session)
    assert [row.percents for row in rows if isinstance(row, FractionRow)] == [("–",)] * 3
    texts = [row.text for row in rows if isinstance(row, TextRow)]
    assert "The grasp at this vertex is not known for the current settings." in texts
    assert session.message in texts


def test_messages_and_progress_are_always_visible(session: Session) -> None:
    session.change(friction=2.0)  # a wider search
    session.show_message("saved: a.ply")
    text, press = panel_text(session), lambda key: handle_key(session, key)
    rows = panel_content(session, text, Ranges(), 344.0, press=press).lower
    assert [type(row) for row in rows] == [Gap, TextRow, ProgressRow]
    session.close()


@pytest.mark.parametrize("paint", ["critical_angle", "max_resolution", "epsilon", "epsilon_min"])
def test_colours_without_a_resolution_are_not_compared(session: Session, paint: Any) -> None:
    session.change(compare=40.0 * DEGREE)
    assert session.other_model is not None
    session.change(paint=paint)
    assert session.other_model is None
    assert len(next(row for row in rows_of(session) if isinstance(row, FractionRow)).percents) == 1
    before = session.state
    assert handle_key(session, "c")
    assert session.message.endswith("two resolutions are compared in the colours S, M, U")
    assert session.state == before
    buttons = [one for row in rows_of(session) if isinstance(row, ButtonRow) for one in row.buttons]
    assert [one.muted for one in buttons if one.name == "key-c"] == [True]
    session.change(paint="label")
    assert session.other_model is not None
    assert session.state.compare == pytest.approx(40.0 * DEGREE)
    session.close()


def test_the_legend_has_a_note_for_epsilon_and_the_meaning_of_grey(session: Session) -> None:
    session.change(paint="epsilon")
    rows = rows_of(session)
    strip = next(row for row in rows if isinstance(row, RampRow))
    assert strip.grey == "not computed yet"
    assert any("the same β*" in row.text for row in rows if isinstance(row, TextRow))
    session.change(paint="critical_angle")
    strip = next(row for row in rows_of(session) if isinstance(row, RampRow))
    assert (strip.low, strip.grey) == ("0°", "")
    session.close()


@pytest.mark.parametrize("name", ["friction", "sensor_resolution", "compare", "section"])
@pytest.mark.parametrize("position", [0.0, 0.25, 1.0])
def test_sliders_have_the_position_that_was_set(
    session: Session, name: str, position: float
) -> None:
    session.change(compare=40.0 * DEGREE, section=Section("z"))

    def slider() -> Any:
        return next(one for one in sliders_of(session, Ranges()) if one.name == name)

    value = slider().value_at(position)
    slider().set(position)
    assert slider().position == pytest.approx(position, abs=0.005)
    assert slider().value == value


def test_ranges_of_sliders_include_the_current_values(session: Session) -> None:
    ranges = Ranges()
    session.change(friction=3.0, sensor_resolution=120.0 * DEGREE)
    friction, resolution, opening = sliders_of(session, ranges)
    assert (friction.position, friction.value) == (1.0, "3.00")
    assert resolution.value == "120.0°"
    assert resolution.position < 1.0
    assert (opening.position, opening.value) == (1.0, "no limit")
    session.change(friction=0.5, sensor_resolution=0.1234567)
    friction, resolution, _ = sliders_of(session, ranges)
    assert friction.position < 0.2
    assert resolution.value == f"{math.degrees(0.1234567):.4g}°"


def test_a_slider_that_starts_a_search_acts_when_it_is_released(session: Session) -> None:
    widget = laid_out(session, (1280, 800))
    left, right = area_of(widget, "opening").track or (0.0, 0.0)
    y = middle(area_of(widget, "opening"))[1]
    widget.press(left + 0.9 * (right - left), y)
    assert widget.move(left + 0.5 * (right - left), y + 300.0)
    assert widget.dragged == ("opening", pytest.approx(0.5))
    assert math.isinf(session.state.max_opening)
    tracks = [
        row
        for row in content(session, 380.0, dragged=widget.dragged).upper
        if isinstance(row, SliderRow) and row.name == "opening"
    ]
    assert tracks[0].value != "no limit"
    widget.release(0.5 * (left + right), y)
    assert widget.dragged is None
    size = session.subject.mesh.size if session.subject else 0.0
    assert session.state.max_opening == pytest.approx(0.51 * size, rel=0.01)
    session.close()


def test_a_slider_is_set_to_where_it_is_released(session: Session) -> None:
    widget = laid_out(session, (1280, 800))
    left, right = area_of(widget, "friction").track or (0.0, 0.0)
    widget.press(left, middle(area_of(widget, "friction"))[1])
    widget.release(right + 50.0, -100.0)
    assert session.state.model.friction == 1.5
    session.close()


def test_a_button_acts_if_it_is_pressed_and_released(session: Session) -> None:
    pressed: list[str] = []
    widget = laid_out(session, (1280, 800), press=pressed.append)
    here, there = middle(area_of(widget, "key-2")), middle(area_of(widget, "key-3"))
    for start, end in ((here, there), (here, (-50.0, 0.0)), ((1.0, 1.0), here)):
        widget.press(*start)
        widget.release(*end)
    assert pressed == []
    widget.press(*here)
    widget.release(*here)
    assert pressed == ["2"]


def test_every_button_has_an_action(session: Session) -> None:
    session.change(section=Section())
    session.click(3)
    session.change(fixed=((0.0, 0.0, 0.0),))
    whole = content(session, 380.0)
    for row in whole.upper:
        for one in row.hit_areas((18.0, 0.0, 362.0, row.height)):
            assert one.name in whole.actions or one.name in whole.sliders
    session.close()


def test_a_button_under_the_mouse_is_hovered(session: Session) -> None:
    widget = laid_out(session, (1280, 800))
    here = middle(area_of(widget, "key-2"))
    assert widget.move(*here)
    assert not widget.move(here[0] + 1.0, here[1])
    assert widget.hovering
    assert widget.leave()
    assert not widget.show(content(session, 380.0), 380.0, 800.0, 1.0)


def test_the_wheel_moves_a_slider(session: Session) -> None:
    widget = laid_out(session, (1280, 800))
    widget.turn_wheel(*middle(area_of(widget, "friction")), 2)
    assert session.state.model.friction == pytest.approx(0.5 + 0.02 * 1.49, abs=0.006)
    before = session.state
    widget.turn_wheel(*middle(area_of(widget, "opening")), -2)
    widget.turn_wheel(1.0, 1.0, 2)
    assert session.state == before
    low = scrolled(session, 3)
    low.turn_wheel(*middle(area_of(low, "opening")), 2)
    assert session.state == before  # the wheel scrolls where not everything is visible


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
    own = {key for key, known in KEYS.items() if known.action is None}
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


@pytest.mark.slow
@pytest.mark.parametrize("size", [(320.0, 240.0), *SIZES])
def test_the_help_fits_into_the_window(size: tuple[float, float]) -> None:
    height, width, _ = help_image(*size, 1.0).shape
    assert width < size[0]
    assert height < size[1]
    assert help_image(*size, 2.0).shape[:2] == (2 * height, 2 * width)
