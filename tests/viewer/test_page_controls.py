"""Every function of the viewer on its page, wide and narrow, with real clicks, keys and drags."""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from plyfile import PlyData

from grasp3d import GraspModel, Load, Sampling, Table, label_surface, load_mesh
from grasp3d.settings import DEGREE
from grasp3d.viewer.session.collection import collection_of
from grasp3d.viewer.session.controls import ACTIONS, CONTROLS, KEYS, control_values
from grasp3d.viewer.session.session import Session
from grasp3d.viewer.session.state import ViewState
from grasp3d.viewer.web.page import background_server
from tests.helpers import shapes
from tests.helpers.held_grasps import JAWS
from tests.viewer.test_gripper_shown import greys
from tests.viewer.test_page import LONG, Visitor, browser, coloured

__all__ = ["browser"]  # a fixture

pytestmark = pytest.mark.slow

SIZES = {"wide": (1280, 800), "narrow": (390, 844)}
TARGETS = {"wide": 13.0, "narrow": 22.0}
"""Least width and height of what can be clicked or touched [pixels]."""
DIFFERENT = 0.005
"""Fraction of the pixels that may differ between pictures of the same view."""
SEVERAL = 8
"""A vertex through which several grasps are; through the middle of a side there is only one."""
REACHED = """one => {
  one.scrollIntoView({block: "center", behavior: "instant"});
  const box = one.getBoundingClientRect();
  const hit = document.elementFromPoint(box.x + box.width / 2, box.y + box.height / 2);
  const inside = box.x >= 0 && box.right <= innerWidth && box.y >= 0 && box.bottom <= innerHeight;
  return [one.id, inside && (one === hit || one.contains(hit)), Math.min(box.width, box.height)];
}"""
"""Identifier of an element, whether it can be reached by scrolling, and its smaller side."""
CUT_OFF = """all => all.filter(one => one.scrollWidth > one.clientWidth + 1 && one.clientWidth)
  .map(one => one.id || one.className || one.tagName).filter(one => !one.startsWith("v-ripple"))"""


@dataclass
class Viewed(Visitor):
    """A page, and its session in this process."""

    sessions: list[Session]
    first: Any = None
    """Mask of the object's pixels in the initial view."""

    @property
    def session(self) -> Session:
        return self.sessions[-1]

    @property
    def state(self) -> ViewState:
        return self.session.state

    def waits(self, done: Callable[[ViewState], object]) -> None:
        """Wait for a state, and for the page that shows it."""
        self.until(lambda: bool(done(self.state)) and self.session.working is None)
        names = list(CONTROLS)

        def shown() -> bool:
            values = self.page.evaluate("all => all.map(one => trame.state.get(one))", names)
            return dict(zip(names, values, strict=True)) == control_values(self.session)

        self.until(shown)

    def enter(self, name: str, value: str) -> None:
        self.page.locator(f"#{name}").fill(value)
        self.page.locator(f"#{name}").press("Enter")

    def drag(self, name: str, position: float) -> None:
        """Drag the thumb of a slider to a position, from 0 to 1, in several steps."""
        slider = self.page.locator(f"#{name}")
        slider.scroll_into_view_if_needed()
        box = slider.bounding_box()
        value, end = float(slider.input_value()), float(slider.get_attribute("max"))
        start, y = float(slider.get_attribute("min")), box["y"] + 0.5 * box["height"]

        def x(part: float) -> float:
            return float(box["x"] + 8.0 + part * (box["width"] - 16.0))

        self.page.mouse.move(x((value - start) / (end - start)), y)
        self.page.mouse.down()
        for part in (0.3, 0.7, 1.0):
            now = (value - start) / (end - start)
            self.page.mouse.move(x(now + part * (position - now)), y)
            self.page.wait_for_timeout(200)
        self.page.mouse.up()

    def pixel(self) -> tuple[float, float]:
        """Position of a pixel well inside the object."""
        rows, columns = np.nonzero(coloured(self.picture()))
        middle = int(np.argmin(np.hypot(rows - rows.mean(), columns - columns.mean())))
        left, top, _, _ = self.box("#stage")
        return left + float(columns[middle]), top + float(rows[middle])


@pytest.fixture(scope="module")
def collection() -> Any:
    """A box with a gripper, a table and a load; and a plain box."""
    mesh = load_mesh(shapes.box((0.06, 0.04, 0.08)), unit="m", max_edge=0.02)
    sampling = Sampling(rays=16, search_angle=80.0 * DEGREE)
    held = label_surface(
        mesh, GraspModel(), sampling=sampling, hand=JAWS, table=Table.below(mesh),
        load=Load(mass=0.5, grip_force=20.0),
    )  # fmt: skip
    plain = label_surface(mesh, GraspModel(), sampling=sampling)
    items = (collection_of(held).items[0], replace(collection_of(plain).items[0], name="plain"))
    return replace(collection_of(held), items=items, notes=("a note for the reader",))


@pytest.fixture(scope="module", params=SIZES)
def opened(request: pytest.FixtureRequest, browser: Any, collection: Any) -> Iterator[Viewed]:
    width, height = SIZES[request.param]
    sessions: list[Session] = []

    def start() -> Session:
        sessions.append(Session(collection))
        return sessions[-1]

    server = background_server()
    context = browser.new_context(
        viewport={"width": width, "height": height}, has_touch=request.param == "narrow",
        accept_downloads=True,
    )  # fmt: skip
    context.set_default_timeout(LONG)
    made = Viewed(context.new_page(), [], sessions)
    made.page.on("pageerror", lambda error: made.errors.append(str(error)))
    made.page.goto(server.address + server.add(start))
    made.page.wait_for_selector("#fractions li[data-fraction]")
    made.until(lambda: coloured(made.picture()).mean() > 0.02)
    made.page.wait_for_timeout(300)
    made.first = coloured(made.picture())
    yield made
    context.close()
    assert not made.errors


@pytest.fixture
def seen(opened: Viewed) -> Viewed:
    """The page in its initial state."""
    session = opened.session
    initial = ViewState(session.collection.model, session.collection.sampling.max_distance)
    if session.number:
        opened.page.locator("#object").select_option("0")
        opened.until(lambda: session.number == 0)
    session.change(**{name: getattr(initial, name) for name in initial.__dataclass_fields__})
    opened.waits(lambda state: state == initial)
    opened.page.keyboard.press("r")
    opened.page.wait_for_timeout(100)
    opened.until(lambda: (coloured(opened.picture()) != opened.first).mean() < DIFFERENT)
    return opened


def test_every_control_is_reachable_and_nothing_is_cut_off(seen: Viewed) -> None:
    page, least = seen.page, TARGETS["narrow" if seen.page.viewport_size["width"] < 700 else "wide"]
    seen.session.change(show_errors=True, compare=50.0 * DEGREE, click="fix")
    seen.session.click(3)
    seen.waits(lambda state: state.fixed)
    page.locator("#axis-y").click()
    seen.waits(lambda state: state.section)
    clickable = page.locator("#panel :is(button, a, input, select), .zoom button")

    def boxes() -> list[Any]:
        return list(clickable.evaluate_all(f"all => all.map({REACHED})"))

    assert len(boxes()) > 30
    # A message covers a few of them for a while.
    seen.waits(lambda _: all(reachable for _, reachable, _ in boxes()))
    assert [(name, side) for name, _, side in boxes() if side < least] == []

    assert sorted(page.locator("#panel *:not(option)").evaluate_all(CUT_OFF)) == []
    assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")


KEYS_AND_EFFECTS: dict[str, Callable[[ViewState], object]] = {
    "ArrowRight": lambda state: state.model.friction == 0.55,
    "ArrowLeft": lambda state: state.model.friction == 0.5,
    "ArrowUp": lambda state: state.model.sensor_resolution == pytest.approx(24.6 * DEGREE),
    "ArrowDown": lambda state: state.model.sensor_resolution == pytest.approx(22.6 * DEGREE),
    "e": lambda state: state.show_errors,
    "c": lambda state: state.compare == pytest.approx(40.0 * DEGREE),
    "2": lambda state: state.paint == "critical_angle",
    "3": lambda state: state.paint == "max_resolution",
    "4": lambda state: state.paint == "epsilon",
    "5": lambda state: state.paint == "epsilon_min",
    "6": lambda state: state.paint == "approach_margin",
    "7": lambda state: state.paint == "grip_force",
    "8": lambda state: state.paint == "payload",
    "9": lambda state: state.paint == "margin",
    "1": lambda state: state.paint == "label",
    "x": lambda state: state.section.axis == "x",
    "[": lambda state: state.section.position == 0.45,
    "]": lambda state: state.section.position == 0.5,
    "i": lambda state: state.section.flipped,
    "j": lambda state: not state.show_gripper,
    "t": lambda state: not state.show_table,
    "b": lambda state: state.vertex is not None,
    ".": lambda state: state.alternative == 1,
    ",": lambda state: state.alternative == 0,
    "v": lambda state: state.vertex is not None,
    "f": lambda state: state.click == "fix",
}


def test_keys(seen: Viewed) -> None:
    own = {"u", "n", "p", "s", "g", "r", "+", "-", "z", "h", "q"}  # tested below
    arrows = {f"Arrow{key}" for key in ACTIONS if len(key) > 1}
    assert set(KEYS_AND_EFFECTS) == {key for key in ACTIONS if len(key) == 1} - own | arrows
    for key, done in KEYS_AND_EFFECTS.items():
        if key == ".":
            seen.session.click(SEVERAL, inspect=True)
            seen.waits(lambda state: state.vertex == SEVERAL)
        before = seen.state
        seen.page.keyboard.press(key)
        seen.waits(lambda state, before=before, done=done: state != before and done(state))
    assert seen.page.input_value("#paint") == "label"
    assert seen.page.locator("#compare-number").input_value() == "40"


def test_help_opens_and_closes_with_its_key(seen: Viewed) -> None:
    page = seen.page
    page.keyboard.press("h")
    page.wait_for_selector("#help")
    text = page.locator("#help").inner_text()
    assert [known.text for known in KEYS if known.text not in text] == ["quit"]
    assert "← →" in text
    seen.until(lambda: seen.box("#help")[1] >= 0.0)
    page.keyboard.press("1")
    page.keyboard.press("h")
    page.wait_for_selector("#help", state="hidden")
    page.locator("#help-open").click()
    page.locator("#help-close").click()
    page.wait_for_selector("#help", state="hidden")


def test_sliders_are_dragged_and_a_drag_is_one_step_of_undo(seen: Viewed) -> None:
    page = seen.page
    fractions = seen.fractions()
    seen.drag("friction", 0.08)
    seen.waits(lambda state: state.model.friction < 0.18)
    seen.until(lambda: seen.fractions() != fractions)
    assert float(page.input_value("#friction-number")) == seen.state.model.friction
    page.locator("#undo").click()
    seen.waits(lambda state: state.model.friction == 0.5)
    page.locator("#show-errors").click()
    seen.drag("resolution", 0.1)
    seen.waits(lambda state: state.model.sensor_resolution < 12.0 * DEGREE)
    seen.drag("friction-error", 0.2)
    seen.waits(lambda state: 0.05 < state.model.friction_error < 0.15)
    label = page.locator("label[for=friction]")
    seen.until(lambda: " to 0.6" in label.inner_text() or " to 0.5" in label.inner_text())
    seen.drag("normal-error", 0.2)
    seen.waits(lambda state: 2.0 * DEGREE < state.model.normal_error < 6.0 * DEGREE)
    seen.drag("location-error", 0.2)
    seen.waits(lambda state: state.model.location_error > 0.0)
    page.locator("#comparing").click()
    seen.drag("compare", 0.9)
    seen.waits(lambda state: state.compare > 70.0 * DEGREE)
    seen.until(lambda: set(seen.fractions("other")) == {"S", "M", "U"})
    page.locator("#axis-z").click()
    seen.drag("position", 0.2)
    seen.waits(lambda state: state.section.position < 0.3)
    page.locator("#flipped").click()
    seen.waits(lambda state: state.section.flipped)
    page.locator("#axis-off").click()
    seen.waits(lambda state: state.section is None)


def test_a_limited_opening_is_searched_with_progress(seen: Viewed) -> None:
    page = seen.page
    before = seen.fractions()
    seen.drag("opening-slider", 0.45)
    page.wait_for_selector("#progress")
    assert "searching grasps" in page.locator("#progress").inner_text()
    assert page.locator("#save").get_attribute("aria-disabled") == "true" or (
        "disabled" in page.locator("#save").get_attribute("class")
    )
    seen.waits(lambda state: math.isfinite(state.max_opening))
    page.wait_for_selector("#progress", state="detached")
    seen.until(lambda: seen.fractions()["U"] > before["U"])
    seen.drag("opening-slider", 1.0)
    seen.waits(lambda state: math.isinf(state.max_opening))
    for value, opening in (("0.05", 0.05), ("-1", 0.05)):
        page.wait_for_selector("#progress", state="detached")
        seen.enter("opening", value)
        seen.waits(lambda state, opening=opening: state.max_opening == opening)
    page.wait_for_selector("#message")
    assert "must be a number above 0" in page.locator("#message").inner_text()


def test_choices_by_lists_and_buttons(seen: Viewed) -> None:
    page = seen.page
    paints = {
        "critical_angle": "β*",
        "epsilon": "ε",
        "approach_margin": "not reached",
        "grip_force": "for 0.5 kg",
        "payload": "payload with 20 N",
        "margin": "margin: S above 0°",
    }
    for paint, text in paints.items():
        page.select_option("#paint", paint)
        seen.waits(lambda state, paint=paint: state.paint == paint)
        page.wait_for_selector("#ramp .strip")
        seen.until(lambda text=text: text in page.locator("#ramp").inner_text())
    page.select_option("#paint", "label")
    page.wait_for_selector("#ramp", state="detached")
    before = greys(seen.picture())
    page.locator("#best-next").click()
    seen.until(lambda: greys(seen.picture()) > before)
    shown = greys(seen.picture())
    for name in ("show-gripper", "show-table"):
        page.locator(f"#{name}").click()
    seen.waits(lambda state: not (state.show_gripper or state.show_table))
    seen.until(lambda: greys(seen.picture()) < 0.5 * shown)
    assert "a note for the reader" in page.locator("#notes").inner_text()
    assert "load 0.5 kg" in page.locator("#facts").inner_text()


def test_a_vertex_is_explained_and_grasps_are_stepped_through(seen: Viewed) -> None:
    page, (x, y) = seen.page, seen.pixel()
    assert "Click the surface" in page.locator("#hint").inner_text()
    page.mouse.click(x, y)
    seen.waits(lambda state: state.vertex is not None)
    assert page.locator("#reason").inner_text()[0] in "SMU"
    page.locator("#best-next").click()
    page.wait_for_selector("#message")
    seen.until(lambda: "1 of the" in page.locator("#message").inner_text())
    best = seen.state.vertex
    seen.waits(lambda _: page.locator("#grasp-number").count())
    numbers = page.locator("#numbers").inner_text()
    assert all(name in numbers for name in ("grip force", "payload", "approach margin", "β*"))
    assert "margin" in page.locator("#budget").inner_text()
    page.locator("#best-next").click()
    seen.waits(lambda state: state.vertex != best)
    page.locator("#best-previous").click()
    seen.waits(lambda state: state.vertex == best)
    seen.session.click(SEVERAL, inspect=True)
    seen.waits(lambda state: state.vertex == SEVERAL)
    seen.until(lambda: page.locator("#grasp-number").inner_text().startswith("grasp 1 of"))
    seen.until(lambda: "…" not in page.locator("#grasp-number").inner_text())
    page.locator("#grasp-next").click()
    seen.waits(lambda state: state.alternative == 1)
    seen.until(lambda: page.locator("#grasp-number").inner_text().startswith("grasp 2 of"))
    page.locator("#grasp-previous").click()
    seen.waits(lambda state: state.alternative == 0)
    left, top, _, _ = seen.box("#stage")
    page.mouse.click(left + 3.0, top + 3.0)
    page.wait_for_selector("#numbers", state="detached")


def test_fingers_are_fixed_and_released(seen: Viewed) -> None:
    page, (x, y) = seen.page, seen.pixel()
    page.locator("#click-fix").click()
    page.keyboard.down("Shift")
    page.mouse.click(x, y)
    page.keyboard.up("Shift")
    seen.waits(lambda state: state.vertex is not None and not state.fixed)
    page.mouse.click(x, y)
    seen.waits(lambda state: len(state.fixed) == 1)
    seen.until(lambda: "One finger is fixed" in page.locator("#hint").inner_text())
    assert "Best contact found" in page.locator("#inspection").inner_text()
    page.locator("#release").click()
    seen.waits(lambda state: not state.fixed)
    page.mouse.click(x, y)
    seen.waits(lambda state: len(state.fixed) == 1)
    page.keyboard.press("u")
    seen.waits(lambda state: not state.fixed)
    page.locator("#fingers-3").click()
    seen.until(lambda: "two fingers" in page.locator("#message").inner_text())
    assert seen.state.model.fingers == 2
    page.locator("#object").select_option("1")  # without a gripper
    seen.waits(lambda _: seen.session.number == 1 and seen.session.subject is not None)
    page.locator("#fingers-3").click()
    seen.waits(lambda state: state.model.fingers == 3)
    page.keyboard.press("z")
    seen.waits(lambda state: state.model.fingers == 2)


def test_the_view_turns_zooms_and_is_reset(seen: Viewed) -> None:
    page, (x, y) = seen.page, seen.pixel()
    first = seen.picture()

    def as_before() -> bool:
        return bool(np.abs(seen.picture() - first).mean() < 1.0)

    actions: tuple[Callable[[], None], ...] = (
        lambda: page.locator("#zoom-in").click(),
        lambda: page.locator("#zoom-out").click(),
        lambda: page.keyboard.press("-"),
        lambda: page.keyboard.press("+"),
    )
    for number, act in enumerate(actions):
        act()
        seen.until(as_before if number % 2 else lambda: not as_before())
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + 40.0, y + 10.0, steps=4)
    page.mouse.up()
    seen.until(lambda: not as_before())
    assert seen.state.vertex is None
    page.locator("#reset").click()
    seen.until(as_before)


def test_objects_are_stepped_through(seen: Viewed) -> None:
    page, title = seen.page, seen.page.locator("#title")
    actions: tuple[Callable[[], None], ...] = (
        lambda: page.locator("#next").click(),
        lambda: page.locator("#previous").click(),
        lambda: page.keyboard.press("n"),
        lambda: page.keyboard.press("p"),
        lambda: page.locator("#object").select_option("1"),
    )
    for number, act in enumerate(actions):
        act()
        part = "1 of 2" if number % 2 else "2 of 2"
        seen.until(lambda part=part: part in title.inner_text())
        seen.until(lambda: page.title() == f"{seen.session.name} · grasp3d")
    seen.until(lambda: page.locator("#show").count() == 0)
    seen.waits(lambda _: seen.session.subject is not None)
    title.click()  # keys belong to a list while it has the focus
    page.keyboard.press("j")
    page.wait_for_selector("#message")
    seen.until(lambda: "there is no gripper" in page.locator("#message").inner_text())


def test_files_are_saved_by_buttons_and_keys(seen: Viewed, tmp_path: Path) -> None:
    seen.enter("friction-number", "0.4")
    seen.waits(lambda state: state.model.friction == 0.4)
    actions: dict[str, Callable[[], None]] = {
        "button.ply": lambda: seen.page.locator("#save").click(),
        "key.ply": lambda: seen.page.keyboard.press("s"),
        "button.png": lambda: seen.page.locator("#picture").click(),
        "key.png": lambda: seen.page.keyboard.press("g"),
    }
    for name, act in actions.items():
        with seen.page.expect_download() as begun:
            act()
        begun.value.save_as(tmp_path / name)
    assert seen.session.subject is not None
    expected = seen.session.subject.labels.relabel(friction=0.4)
    for name in ("button.ply", "key.ply"):
        assert np.array_equal(PlyData.read(tmp_path / name)["vertex"]["label"], expected.label)
    width, height = seen.picture().shape[1::-1]
    for name in ("button.png", "key.png"):
        with Image.open(tmp_path / name) as picture:
            assert picture.size == pytest.approx((width, height), abs=1)
    seen.until(lambda: seen.page.locator("#message").inner_text().startswith("saved: "))
