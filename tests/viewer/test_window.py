"""The desktop window, under a real X server with real events."""

import os
import subprocess
import urllib.request
from collections.abc import Iterator
from contextlib import AbstractContextManager
from pathlib import Path

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

pytestmark = [pytest.mark.slow, needs_screen]

WIDTH, HEIGHT, SCENE = 1000, 700, 680
"""Size of the window, and a width that only the scene has [pixels]."""
TRACK = 268.0
"""Length of a slider's track [pixels], to a few of them."""
CONE = 60.0 * DEGREE
"""Wide enough for all tested settings, so that there is no second search."""
SCRIPT = """
import json, sys
from grasp3d import GraspModel, Sampling, label_surface, load_mesh
from grasp3d.viewer.session.collection import collection_of
from grasp3d.viewer.session.panel_text import panel_text
from grasp3d.viewer.window.desktop import show_window
from grasp3d.viewer.session.session import Session
from grasp3d.viewer.view_settings import ViewSettings
sampling = Sampling(rays=8, search_angle={cone})
labels = label_surface(load_mesh({mesh!r}), GraspModel(), sampling=sampling)
session = Session(collection_of(labels), ViewSettings(width={width}, height={height}))
lines = open(sys.argv[1], "w", encoding="utf-8")
def watch():
    state, text = session.state, panel_text(session)
    print(json.dumps(dict(
        fractions=dict((one.letter, one.fraction) for one in text.fractions),
        other=dict((one.letter, one.fraction) for one in text.other_fractions),
        friction=state.model.friction, resolution=state.model.sensor_resolution,
        paint=state.paint, compare=state.compare, click=state.click, vertex=state.vertex,
        fixed=state.fixed, section=state.section and state.section.axis,
        message=session.message, working=session.working,
    )), file=lines, flush=True)
show_window(session, title="a window to test", watch=watch)
print("closed")
"""


@pytest.fixture(scope="module")
def labels() -> SurfaceLabels:
    mesh = load_mesh(LIBRARY / "spray.glb")
    sampling = Sampling(rays=8, search_angle=CONE)
    return label_surface(mesh, GraspModel(), sampling=sampling)


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
    while made.state["section"]:
        before = made.state["section"]
        made.key("x")
        made.until(lambda state, axis=before: state["section"] != axis, "another section")
    for key, wrong in (
        ("c", made.state["compare"] is not None), ("f", made.state["click"] == "fix"), ("1", True),
        ("u", True), ("r", True),
    ):  # fmt: skip
        if wrong:
            made.key(key)
    made.click(3, 3)
    made.until(
        lambda state: (
            (state["vertex"], state["compare"], state["section"], state["fixed"])
            == (None, None, None, [])
            and state["working"] is None
        ),
        "the initial state",
    )
    return made


def pixel_of_object(picture: Image8) -> tuple[int, int]:
    """Position of a pixel well inside the object, x and y."""
    painted = np.ptp(picture.astype(int), axis=2) > 60
    painted[:, SCENE:] = painted[650:] = False  # the legend is below the object
    rows = np.flatnonzero(painted.sum(axis=1) > 40)
    y = int(rows[len(rows) // 2])
    columns = np.flatnonzero(painted[y])
    return int(np.median(columns)), y


def seen_fractions(picture: Image8) -> dict[str, float]:
    """Fractions of the scene's coloured pixels by the label with the nearest hue."""
    scene = picture[:650, :SCENE].reshape(-1, 3).astype(float)
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


def changed(one: Image8, other: Image8, columns: slice = slice(SCENE)) -> float:
    return float((one[:, columns] != other[:, columns]).any(axis=2).mean())


def test_sliders_change_colours_and_fractions(window: Window, labels: SurfaceLabels) -> None:
    assert agrees(window.state["fractions"], labels, 0.5, 22.6 * DEGREE)
    before = window.picture()
    window.slide(0, -0.2 * TRACK)
    state = window.until(lambda state: state["friction"] < 0.22, "friction")
    assert state["friction"] == pytest.approx(0.5 - 0.2 * 1.49, abs=0.03)
    assert agrees(state["fractions"], labels, state["friction"], state["resolution"])
    drawn = seen_fractions(window.picture())
    assert drawn["S"] == pytest.approx(state["fractions"]["S"], abs=0.2)
    assert seen_fractions(before)["S"] > drawn["S"] + 0.2
    window.slide(1, -0.3 * TRACK)
    state = window.until(lambda state: state["resolution"] == 0.0, "resolution")
    assert agrees(state["fractions"], labels, state["friction"], 0.0)
    window.key("z", "z")  # a drag is one step
    window.until(
        lambda state: (state["friction"], state["resolution"]) == (0.5, 22.6 * DEGREE), "as before"
    )
    x, y = window.thumbs()[1]
    window.click(x + 0.5 * TRACK, y)
    state = window.until(lambda state: state["resolution"] > 50.0 * DEGREE, "a coarser sensor")
    assert state["resolution"] == pytest.approx(67.6 * DEGREE, abs=2.0 * DEGREE)
    assert window.state["vertex"] is None
    window.key("z")


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
    window.until(lambda state: state["vertex"] is not None, "an inspected vertex")
    panel = slice(SCENE + 30, None)
    wait_for(lambda: changed(before, window.picture(), panel) > 0.02, "the reason in the panel")
    window.click(3, 3)
    window.until(lambda state: state["vertex"] is None, "nothing")


def test_the_mouse_on_the_panel_does_not_turn_the_object(window: Window) -> None:
    before = window.picture()
    window.drag((900, 400), (800, 500))
    window.do("mousemove", 900, 400, "click", "--repeat", 3, 5)
    window.do("sleep", 1)  # until the window has seen all of it
    wait_for(lambda: changed(before, window.picture()) < 0.001, "the same view")


def test_keys_choose_what_is_shown(window: Window, labels: SurfaceLabels) -> None:
    window.key("2")
    window.until(lambda state: state["paint"] == "critical_angle", "colours")
    window.key("x", "x")
    window.until(lambda state: state["section"] == "y", "a section")
    window.key("c")
    window.until(lambda state: "does not depend" in state["message"], "a refusal")
    window.key("1", "c")
    state = window.until(lambda state: state["compare"], "two resolutions")
    assert agrees(state["fractions"], labels, state["friction"], state["resolution"])
    assert agrees(state["other"], labels, state["friction"], state["compare"])
    window.key("z")
    window.until(lambda state: state["compare"] is None, "undone")
    window.key("b")
    first = window.until(lambda state: state["message"].startswith("1 of the 20 best"), "the best")
    window.key("b", "b", "v")
    second = window.until(lambda state: state["message"].startswith("2 of the 20"), "the second")
    assert first["vertex"] != second["vertex"]


def test_fingers_are_fixed_and_released(window: Window) -> None:
    x, y = pixel_of_object(window.picture())
    window.key("f")
    window.until(lambda state: state["click"] == "fix", "fixing")
    window.click(x, y, shift=True)
    window.until(lambda state: state["vertex"] is not None, "an inspected vertex")
    assert window.state["fixed"] == []
    window.click(x, y)
    window.until(lambda state: state["fixed"] and state["working"] is None, "a fixed finger")
    window.key("u")
    window.until(lambda state: state["fixed"] == [], "none")


def test_the_key_h_shows_and_hides_the_keys(window: Window) -> None:
    before, panel = window.picture(), slice(SCENE + 30, None)
    window.key("h")
    wait_for(lambda: changed(before, window.picture(), panel) > 0.03, "the keys")
    assert changed(before, window.picture()) < 0.001
    window.key("h")
    wait_for(lambda: changed(before, window.picture(), panel) < 0.001, "no keys")


def test_keys_of_vtk_are_disabled(window: Window) -> None:
    before = window.picture()
    window.key("t", "j", "3", "1", "a", "l", "ctrl+q", "F5", "Escape")
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


def test_the_layout_follows_the_size_of_the_window(window: Window) -> None:
    for width, height in ((1200, 900), (700, 520), (WIDTH, HEIGHT)):
        window.do("windowsize", window.number, width, height)

        def fits(size: tuple[int, int] = (height, width)) -> bool:
            thumbs = window.thumbs()
            inside = all(0.55 * size[1] < x < size[1] and y < 120.0 for x, y in thumbs)
            return window.picture().shape[:2] == size and len(thumbs) == 2 and inside

        wait_for(fits, "another layout")
        assert window.picture()[5:-5, -3].min() > 235  # no text is cut off


def test_the_key_w_opens_the_same_object_in_a_browser(window: Window) -> None:
    window.key("Right", "b")
    before = window.until(lambda state: state["vertex"] is not None, "the best grasp")
    window.key("w")
    asked = window.folder.parent / "browser.txt"
    wait_for(asked.exists, "a browser")
    address = asked.read_text(encoding="utf-8").strip()
    state = window.until(lambda state: "opened in a browser: " in state["message"], "a message")
    assert address in state["message"]
    with urllib.request.urlopen(address) as response:  # noqa: S310
        page = response.read().decode()
    assert response.url.startswith(f"{address.partition('/a/')[0]}/s/")
    assert "<html" in page
    assert (state["friction"], state["vertex"]) == (before["friction"], before["vertex"])
    window.key("z", "Left")


def test_files_are_saved_under_unused_names(window: Window, labels: SurfaceLabels) -> None:
    for name in ("spray_labeled.ply", "spray_labeled_2.ply"):
        window.key("s")
        path = window.folder / name
        window.until(lambda state, p=path: state["message"] == f"saved: {p}", "a file")
        rows = PlyData.read(path)["vertex"].data
        state = window.state
        expected = labels.relabel(friction=state["friction"], sensor_resolution=state["resolution"])
        assert np.array_equal(rows["label"], expected.label)
    window.key("g")
    path = window.folder / "spray_view.png"
    window.until(lambda state: state["message"] == f"saved: {path}", "a picture")
    with Image.open(path) as image:
        assert (image.size[0] < WIDTH, image.size[1]) == (True, HEIGHT)
        drawn = seen_fractions(np.array(image.convert("RGB")))
    assert drawn["S"] == pytest.approx(seen_fractions(window.picture())["S"], abs=0.05)
    window.folder.chmod(0o555)
    if not os.access(window.folder, os.W_OK):
        window.key("g")
        window.until(lambda state: "cannot be written" in state["message"], "a refusal")
    window.folder.chmod(0o755)


def test_the_key_q_closes_the_window(tmp_path: Path) -> None:
    with opened(tmp_path, "cone.off") as window:
        window.key("q")
        assert window.ended() == (0, "closed\n", "")


def test_the_close_button_closes_the_window(tmp_path: Path) -> None:
    with opened(tmp_path, "cone.off") as window:
        window.close()
        assert window.ended() == (0, "closed\n", "")


def test_the_error_without_a_display_names_the_alternatives(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.setenv("WAYLAND_DISPLAY", "wayland-0")
    with pytest.raises(OutputError, match=r"DISPLAY is not set; .* browser .* --screenshot FILE"):
        check_display()
    monkeypatch.setenv("DISPLAY", ":65000")
    with pytest.raises(OutputError, match="no window opens on display :65000"):
        check_display()
    monkeypatch.setattr("sys.platform", "darwin")
    check_display()


def test_a_display_that_does_not_respond_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    def never(process: subprocess.Popen[bytes], timeout: float | None = None) -> int:
        if timeout is None:  # after it was ended
            return wait(process)
        raise subprocess.TimeoutExpired("python", timeout)

    wait = subprocess.Popen.wait
    monkeypatch.setenv("DISPLAY", ":0")
    monkeypatch.setattr(subprocess.Popen, "wait", never)
    with pytest.raises(OutputError, match="no window opens on display :0"):
        check_display()
