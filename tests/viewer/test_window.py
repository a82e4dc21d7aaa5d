"""The desktop window, under a real X server with real events."""

import os
import subprocess
from collections.abc import Iterator
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from plyfile import PlyData

from grasp3d import GraspModel, Label, Sampling, SurfaceLabels, label_surface, load_mesh
from grasp3d.errors import OutputError
from grasp3d.settings import DEGREE
from grasp3d.stability.label import COLORS
from grasp3d.viewer.window.display import check_display
from tests.helpers.shapes import LIBRARY
from tests.helpers.windows import Image8, Window, needs_screen, wait_for

pytestmark = needs_screen

WIDTH, HEIGHT = 1000, 700
CONE = 60.0 * DEGREE
"""Wide enough for all tested settings, so that there is no second search."""
SCRIPT = """
import json, sys
from grasp3d import GraspModel, Sampling, label_surface, load_mesh
from grasp3d.viewer.session.collection import collection_of
from grasp3d.viewer.window.desktop import show_window
from grasp3d.viewer.session.session import Session
from grasp3d.viewer.view_settings import ViewSettings
from grasp3d.viewer.window.sliders import Ranges, sliders_of
sampling = Sampling(rays=8, search_angle={cone})
labels = label_surface(load_mesh({mesh!r}), GraspModel(), sampling=sampling, threads=1)
session = Session(collection_of(labels), ViewSettings(width={width}, height={height}))
lines = open(sys.argv[1], "w", encoding="utf-8")
def watch(text, areas):
    state = session.state
    print(json.dumps(dict(
        fractions=dict((one.letter, one.fraction) for one in text.fractions),
        other=dict((one.letter, one.fraction) for one in text.other_fractions),
        friction=state.model.friction, resolution=state.model.sensor_resolution,
        paint=state.paint, compare=state.compare, click=state.click, vertex=state.vertex,
        fixed=state.fixed, section=state.section and state.section.axis,
        message=text.message, working=text.working,
        areas=dict((one.name, (one.box, one.track)) for one in areas),
        positions=dict((one.name, one.position) for one in sliders_of(session, Ranges())),
    )), file=lines, flush=True)
show_window(session, title="a window to test", watch=watch)
print("closed")
"""


@pytest.fixture(scope="module")
def labels() -> SurfaceLabels:
    mesh = load_mesh(LIBRARY / "spray.glb")
    sampling = Sampling(rays=8, search_angle=CONE)
    return label_surface(mesh, GraspModel(), sampling=sampling, threads=1)


def opened(folder: Path, name: str = "spray.glb") -> AbstractContextManager[Window]:
    mesh = str(LIBRARY / name)
    return Window.open(SCRIPT.format(mesh=mesh, width=WIDTH, height=HEIGHT, cone=CONE), folder)


@pytest.fixture(scope="module")
def opened_window(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Window]:
    with opened(tmp_path_factory.mktemp("window")) as made:
        yield made


@pytest.fixture
def window(opened_window: Window) -> Window:
    """The window in its initial state."""
    made = opened_window
    if made.state["section"]:
        made.press("section-off")
    for key, wrong in (
        ("c", made.state["compare"] is not None), ("f", made.state["click"] == "fix"), ("1", True),
        ("u", True), ("r", True), ("e", "normal_error" in made.state["areas"]),
    ):  # fmt: skip
        if wrong:
            made.key(key)
    made.click(3, 3)
    made.until(
        lambda state: (
            (state["vertex"], state["compare"], state["section"], state["fixed"])
            == (None, None, None, [])
            and state["working"] is None
            and "normal_error" not in state["areas"]
        ),
        "the initial state",
    )
    return made


def pixel_of_object(picture: Image8) -> tuple[int, int]:
    """Position of a pixel well inside the object, x and y."""
    painted = np.ptp(picture.astype(int), axis=2) > 60
    painted[:, 700:] = False
    rows = np.flatnonzero(painted.sum(axis=1) > 40)
    y = int(rows[len(rows) // 2])
    columns = np.flatnonzero(painted[y])
    return int(np.median(columns)), y


def seen_fractions(picture: Image8) -> dict[str, float]:
    """Fractions of the scene's coloured pixels by the label with the nearest hue."""
    scene = picture[:, :690].reshape(-1, 3).astype(float)
    scene = scene[np.ptp(scene, axis=1) > 60.0]
    hues = np.array([COLORS[label] for label in Label], dtype=float)
    hues /= np.linalg.norm(hues, axis=1)[:, None]
    nearest = np.argmax(scene @ hues.T, axis=1)
    return {label.name: float((nearest == label).mean()) for label in Label}


def agrees(
    fractions: dict[str, float], labels: SurfaceLabels, friction: float, alpha: float
) -> bool:
    expected = labels.relabel(friction=friction, sensor_resolution=alpha)
    return fractions == pytest.approx(expected.fractions(), abs=1e-9)


def changed(one: Image8, other: Image8) -> float:
    return float((one[:, :690] != other[:, :690]).any(axis=2).mean())


@pytest.mark.slow
def test_sliders_change_colours_and_fractions(window: Window, labels: SurfaceLabels) -> None:
    assert agrees(window.state["fractions"], labels, 0.5, 22.6 * DEGREE)
    before = window.picture()
    window.slide("friction", 0.13)
    state = window.until(lambda state: state["friction"] < 0.22, "friction")
    assert state["friction"] == pytest.approx(0.01 + 0.13 * 1.49, abs=0.011)
    assert agrees(state["fractions"], labels, state["friction"], state["resolution"])
    drawn = seen_fractions(window.picture())
    assert drawn["S"] == pytest.approx(state["fractions"]["S"], abs=0.2)
    assert seen_fractions(before)["S"] > drawn["S"] + 0.2
    window.slide("sensor_resolution", -0.03)
    state = window.until(lambda state: state["resolution"] == 0.0, "resolution")
    assert agrees(state["fractions"], labels, state["friction"], 0.0)
    window.slide("sensor_resolution", 22.6 / 90.0)
    window.slide("friction", 0.49 / 1.49)
    state = window.until(lambda state: abs(state["friction"] - 0.5) < 0.011, "friction as before")
    assert state["resolution"] == pytest.approx(22.6 * DEGREE, abs=0.4 * DEGREE)
    assert window.state["vertex"] is None


@pytest.mark.slow
def test_a_click_inspects_and_a_drag_does_not(window: Window) -> None:
    before = window.picture()
    x, y = pixel_of_object(before)
    for way in ([(x, y), (x + 60, y + 30)], [(x, y), (x + 60, y), (x, y)], [(3, 3), (x, y)]):
        window.drag(*way)
    wait_for(lambda: changed(before, window.picture()) > 0.02, "a rotated object")
    assert window.state["vertex"] is None
    window.key("r")
    wait_for(lambda: changed(before, window.picture()) < 0.001, "the view as before")
    window.click(x, y)
    state = window.until(lambda state: state["vertex"] is not None, "an inspected vertex")
    window.click(x + 2, y, shift=True)
    assert state["click"] == "inspect"
    window.click(3, 3)
    window.until(lambda state: state["vertex"] is None, "nothing")


@pytest.mark.slow
def test_buttons_of_the_panel(window: Window, labels: SurfaceLabels) -> None:
    window.press("key-2")
    window.until(lambda state: state["paint"] == "critical_angle", "colours")
    window.press("section-y")
    window.until(lambda state: state["section"] == "y", "a section")
    window.press("key-c")
    window.until(lambda state: "does not depend" in state["message"], "a refusal")
    window.press("key-1")
    window.press("key-c")
    state = window.until(lambda state: state["compare"], "two resolutions")
    assert agrees(state["fractions"], labels, state["friction"], state["resolution"])
    assert agrees(state["other"], labels, state["friction"], state["compare"])
    window.slide("compare", 0.2)
    state = window.until(lambda state: state["compare"] < 0.35, "a finer one")
    assert agrees(state["other"], labels, state["friction"], state["compare"])
    window.press("key-z")
    window.until(lambda state: state["compare"] == pytest.approx(40.0 * DEGREE), "undone")


def test_fingers_are_fixed_and_released(window: Window) -> None:
    x, y = pixel_of_object(window.picture())
    window.press("click-fix")
    window.until(lambda state: state["click"] == "fix", "fixing")
    window.click(x, y, shift=True)
    window.until(lambda state: state["vertex"] is not None, "an inspected vertex")
    assert window.state["fixed"] == []
    window.click(x, y)
    window.until(lambda state: state["fixed"] and state["working"] is None, "a fixed finger")
    window.press("key-u")
    window.until(lambda state: state["fixed"] == [], "none")


def test_the_help_is_in_front_of_the_scene(window: Window) -> None:
    before = window.picture()
    for close in (lambda: window.key("h"), lambda: window.click(350, 350)):
        window.key("h")
        wait_for(lambda: changed(before, window.picture()) > 0.2, "the help")
        close()
        wait_for(lambda: changed(before, window.picture()) < 0.001, "no help")
    assert window.state["vertex"] is None


def test_keys_of_vtk_are_disabled(window: Window) -> None:
    before = window.picture()
    window.key("w", "b", "v", "t", "j", "3", "1", "a", "l", "shift+w", "ctrl+q", "F5")
    window.key("2")
    window.until(lambda state: state["paint"] == "critical_angle", "another key")
    window.key("1")
    wait_for(lambda: changed(before, window.picture()) < 0.001, "the picture as before")
    window.key("plus")
    wait_for(lambda: changed(before, window.picture()) > 0.01, "a larger object")
    state = window.state
    next_job = (state["friction"] + 0.05, state["resolution"] + 2.0 * DEGREE)
    window.key("Right", "Up")
    window.until(
        lambda state: (state["friction"], state["resolution"]) == pytest.approx(next_job), "more"
    )
    window.key("Left", "Down")


def test_the_sliders_of_errors_move_the_borders(window: Window) -> None:
    before = window.state["fractions"]["S"]
    window.key("e")
    state = window.until(lambda state: "normal_error" in state["areas"], "more sliders")
    box, (start, end) = state["areas"]["normal_error"]
    window.click(int(start + 0.5 * (end - start)), int(0.5 * (box[1] + box[3])))
    window.until(lambda state: state["fractions"]["S"] < before - 0.02, "fewer S")
    window.key("z")
    window.until(lambda state: state["fractions"]["S"] == before, "the same S")
    window.key("e")
    window.until(lambda state: "normal_error" not in state["areas"], "fewer sliders")


def test_the_layout_follows_the_size_of_the_window(window: Window) -> None:
    def fits(state: dict[str, Any], width: int, height: int) -> bool:
        boxes = [box for box, _ in state["areas"].values()]
        right, bottom = max(box[2] for box in boxes), max(box[3] for box in boxes)
        return width - 40 < right <= width and bottom <= height

    for width, height in ((1200, 900), (900, 600), (WIDTH, HEIGHT)):
        window.do("windowsize", window.number, width, height)
        window.until(lambda state, w=width, h=height: fits(state, w, h), "another layout")


def test_a_low_window_is_scrolled(window: Window) -> None:
    window.key("x", "c")
    window.until(lambda state: state["section"] and state["compare"], "more rows")
    window.do("windowsize", window.number, 800, 520)
    state = window.until(lambda state: "scroll" in state["areas"], "a scroll bar")
    assert "friction" in state["areas"]
    assert "key-s" not in state["areas"]
    window.do("mousemove", "--window", window.number, 700, 200)
    window.do("click", "--repeat", 12, 5)
    window.until(lambda state: "key-s" in state["areas"], "the last buttons")
    window.do("click", "--repeat", 12, 4)
    window.until(lambda state: "key-s" not in state["areas"], "the first rows")
    window.key("c", "z", "z")
    window.do("windowsize", window.number, WIDTH, HEIGHT)
    window.until(lambda state: "scroll" not in state["areas"], "all rows")


@pytest.mark.slow
def test_files_are_saved_under_unused_names(window: Window, labels: SurfaceLabels) -> None:
    for name in ("spray_labeled.ply", "spray_labeled_2.ply"):
        window.key("s")
        path = window.folder / name
        window.until(lambda state, p=path: state["message"] == f"saved: {p}", "a file")
        rows = PlyData.read(path)["vertex"].data
        state = window.state
        expected = labels.relabel(friction=state["friction"], sensor_resolution=state["resolution"])
        assert np.array_equal(rows["label"], expected.label)
    window.press("key-g")
    path = window.folder / "spray_view.png"
    window.until(lambda state: state["message"] == f"saved: {path}", "a picture")
    with Image.open(path) as image:
        assert image.size == (WIDTH - 300, HEIGHT)
        drawn = seen_fractions(np.array(image.convert("RGB")))
    assert drawn["S"] == pytest.approx(seen_fractions(window.picture())["S"], abs=0.05)
    window.folder.chmod(0o555)
    if not os.access(window.folder, os.W_OK):
        window.key("g")
        window.until(lambda state: "cannot be written" in state["message"], "a refusal")
    window.folder.chmod(0o755)


@pytest.mark.slow
def test_the_key_q_closes_the_window(tmp_path: Path) -> None:
    with opened(tmp_path, "cone.off") as window:
        window.key("q")
        assert window.ended() == (0, "closed\n", "")


@pytest.mark.slow
def test_the_close_button_closes_the_window(tmp_path: Path) -> None:
    with opened(tmp_path, "cone.off") as window:
        window.close()
        assert window.ended() == (0, "closed\n", "")


@pytest.mark.slow
def test_the_error_without_a_display_names_the_alternatives(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.setenv("WAYLAND_DISPLAY", "wayland-0")
    with pytest.raises(OutputError, match="DISPLAY is not set; use --web"):
        check_display()
    monkeypatch.setenv("DISPLAY", ":65000")
    with pytest.raises(OutputError, match="no window opens on display :65000"):
        check_display()
    monkeypatch.setattr("sys.platform", "darwin")
    check_display()


def test_a_display_that_does_not_respond_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    def never(*_: object, **options: Any) -> None:
        raise subprocess.TimeoutExpired("python", options["timeout"])

    monkeypatch.setenv("DISPLAY", ":0")
    monkeypatch.setattr(subprocess, "run", never)
    with pytest.raises(OutputError, match="no window opens on display :0"):
        check_display()
