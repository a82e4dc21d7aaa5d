"""The pages in a real browser, opened as files."""

import io
import math
import shutil
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any
from urllib.parse import quote

import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray
from PIL import Image

from grasp3d import (
    GraspModel,
    Label,
    MultifingerSampling,
    Sampling,
    SurfaceLabels,
    label_surface,
    load_mesh,
)
from grasp3d.batch.batch_settings import BatchSettings
from grasp3d.batch.report import object_script, write_report
from grasp3d.batch.row import AreaFractions, Outcome, Row
from grasp3d.batch.storage.folder import Folder
from grasp3d.mesh.primitives import box_mesh, cylinder_mesh
from grasp3d.settings import DEGREE
from grasp3d.stability.label import COLORS
from tests.helpers.reports import put_object, ray_at, row_of, with_critical_angles
from tests.helpers.shapes import LIBRARY

playwright = pytest.importorskip("playwright.sync_api", reason="needs playwright")
BROWSERS = ("chromium", "chromium-browser", "google-chrome")
BROWSER = next(filter(None, map(shutil.which, BROWSERS)), None)
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(BROWSER is None, reason="needs Chromium"),
]

OPTIONS = [
    "--no-sandbox",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--no-first-run",
]
MODEL = GraspModel(friction=0.3, sensor_resolution=20.0 * DEGREE)
HIT = "document.title='hit'"
HOSTILE = f'evil </script><script>{HIT}</script><img src=x onerror="{HIT}">'
STEMS = {"spray": "kitchen 100%/#spray?", "box": "box", "cone": "ä/cone", "cylinder": "cylinder"}


@dataclass
class Report:
    """A report in a folder, and its labels."""

    folder: Path
    labels: dict[str, SurfaceLabels] = field(default_factory=dict)
    rows: list[Row] = field(default_factory=list)

    def address(self, page: str = "index.html") -> str:
        return (
            f"{(self.folder / 'report' / 'index.html').as_uri().removesuffix('index.html')}{page}"
        )


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> Report:
    made = Report(tmp_path_factory.mktemp("library"))
    output = Folder(str(made.folder))
    coarse = Sampling(rays=8)
    meshes = {
        "spray": load_mesh(LIBRARY / "spray.glb"),
        "box": box_mesh((0.1, 0.2, 0.3), max_edge=0.04),
        "cone": load_mesh(LIBRARY / "cone.off"),
    }
    for name, mesh in meshes.items():
        wide = coarse if name == "spray" else replace(coarse, search_angle=60.0 * DEGREE)
        made.labels[name] = label_surface(mesh, MODEL, sampling=wide)
    mesh = cylinder_mesh(0.5, 1.0, max_edge=0.5)
    three = replace(MODEL, fingers=3)
    search = MultifingerSampling(candidates=8, search_angle=90.0 * DEGREE)
    made.labels["cylinder"] = label_surface(mesh, three, sampling=search)
    for name, labels in made.labels.items():
        row = row_of(labels, HOSTILE if name == "cone" else f"{STEMS[name]}.ply", STEMS[name])
        made.rows.append(put_object(output, labels, row))
    made.rows += [
        Row(
            f"bad {HOSTILE}", outcome=Outcome.REFUSED, error=f"{HOSTILE}: has no faces", seconds=0.5
        ),
        Row("late.stl", outcome=Outcome.LOST, error="late.stl: took more than 1 h"),
    ]
    write_report(output, made.rows, BatchSettings(MODEL))
    return made


@pytest.fixture(scope="module")
def driver() -> Iterator[Any]:
    with playwright.sync_playwright() as started:
        yield started.chromium


@pytest.fixture(scope="module")
def browser(driver: Any) -> Iterator[Any]:
    launched = driver.launch(executable_path=BROWSER, args=OPTIONS)
    yield launched
    launched.close()


@pytest.fixture
def page(browser: Any) -> Iterator[Any]:
    """A page that must report no errors, and load only files."""
    context = browser.new_context(viewport={"width": 980, "height": 560})
    opened = context.new_page()
    faults: list[str] = []
    opened.on("console", lambda entry: faults.append(entry.text) if entry.type == "error" else None)
    opened.on("pageerror", lambda error: faults.append(str(error)))
    opened.on("requestfailed", lambda request: faults.append(f"failed: {request.url}"))
    opened.on(
        "request",
        lambda request: (
            None if request.url.startswith(("file:", "data:")) else faults.append(request.url)
        ),
    )
    yield opened
    title = opened.title()
    context.close()
    assert not faults
    assert title != "hit"


def opened(page: Any, address: str) -> Any:
    page.goto(address)
    page.wait_for_selector("html[data-ready]")
    return page


def written(
    page: Any, folder: Path, rows: list[Row], settings: BatchSettings, part: str = "index.html"
) -> Any:
    """A page of a report that is written to a folder first."""
    write_report(Folder(str(folder)), rows, settings)
    return opened(page, Report(folder).address(part))


def check_columns(page: Any) -> None:
    """In a window of 1280 pixels all columns are visible, the last one with its text."""
    holder = page.locator(".tabulator-tableholder")
    assert holder.evaluate("one => one.scrollWidth <= one.clientWidth + 1")
    column = page.locator("[role=columnheader]", has_text="Warnings").bounding_box()
    assert column["width"] >= 120
    assert column["x"] + column["width"] <= 1280 - 24


def opened_object(page: Any, report: Report, name: str) -> Any:
    opened(page, report.address(f"object.html#{quote(STEMS[name])}"))
    page.locator("canvas").wait_for()
    return page


def names(page: Any) -> list[str]:
    return list(page.locator(".tabulator-row .name").all_inner_texts())


def fractions(page: Any) -> dict[str, float]:
    items = page.locator("#fractions li")
    found = items.evaluate_all("all => all.map(one => [one.dataset.label, +one.dataset.fraction])")
    shown = items.locator("output").all_inner_texts()
    assert [f"{100.0 * fraction:.1f} %" for _, fraction in found] == shown
    return dict(found)


def picture(page: Any) -> NDArray[np.float64]:
    """The 3-D view as red, green and blue."""
    shot = page.locator("canvas").screenshot()
    return np.asarray(Image.open(io.BytesIO(shot)).convert("RGB"), dtype=float)


def test_table_sorts_by_numbers_with_rows_without_one_last(page: Any, report: Report) -> None:
    opened(page, report.address())
    assert names(page) == [row.mesh for row in report.rows]
    header = page.get_by_role("button", name="Vertices")
    header.click()
    labelled = [row for row in report.rows if row.vertices is not None]
    falling = sorted(labelled, key=lambda row: -(row.vertices or 0))
    assert names(page)[:4] == [row.mesh for row in falling]
    header.focus()
    page.keyboard.press("Enter")
    assert names(page)[:4] == [row.mesh for row in reversed(falling)]
    assert page.locator("[role=columnheader][aria-sort=ascending]").count() == 1
    assert page.get_by_role("grid", name="Meshes").count() == 1


def test_table_shows_the_values_of_the_rows(page: Any, report: Report) -> None:
    opened(page, report.address())
    row, cells = report.rows[0], page.locator(".tabulator-row").first.locator(".tabulator-cell")
    shown = dict(
        zip(["", "name", "verdict", "fractions", "angle"], cells.all_inner_texts(), strict=False)
    )
    stable, ambiguous, none = (row.stable or 0.0, row.ambiguous or 0.0, row.no_grasp_found or 0.0)
    assert shown["fractions"] == f"S {stable:.0%} · M {ambiguous:.0%} · U {none:.0%}".replace(
        "%", " %"
    )
    assert shown["verdict"] == (row.verdict or "")
    assert shown["angle"] == f"{math.degrees(row.critical_angle_p50 or 0.0):.1f}°"
    assert page.locator(".counts").inner_text().split() == [
        "4", "labelled", "1", "refused", "1", "lost",
    ]  # fmt: skip
    page.wait_for_function("() => [...document.images].every((one) => one.complete)")
    sizes = page.locator("img").evaluate_all("all => all.map(one => one.naturalWidth)")
    assert sizes == [128] * 4


def test_a_telephone_shows_the_whole_verdict(browser: Any, report: Report) -> None:
    context = browser.new_context(viewport={"width": 390, "height": 900})
    page = opened(context.new_page(), report.address())
    table = page.locator(".tabulator-tableholder").bounding_box()
    for name in ("Name", "Verdict"):
        column = page.locator("[role=columnheader]", has_text=name).bounding_box()
        assert column["x"] >= table["x"]
        assert column["x"] + column["width"] <= table["x"] + table["width"]
    context.close()


def test_objects_come_first_and_every_column_is_visible(browser: Any, report: Report) -> None:
    context = browser.new_context(viewport={"width": 1280, "height": 900})
    page = opened(context.new_page(), report.address())
    tops = {
        name: page.locator(name).bounding_box()["y"] for name in ("#table", "#curves", "#lists")
    }
    assert tops["#table"] < min(tops["#curves"], tops["#lists"])
    check_columns(page)
    cut = page.locator(".head").evaluate_all(
        """all => all.filter((one) => {
          const arrow = one.closest(".tabulator-col").querySelector(".tabulator-arrow");
          const [text, mark] = [document.createRange(), arrow?.getBoundingClientRect()];
          text.selectNodeContents(one);
          const rights = [...text.getClientRects()].map((box) => box.right);
          return mark && Math.max(...rights) > mark.left;
        }).map((one) => one.textContent)"""
    )
    assert cut == []
    assert "Opening without limits" in page.locator("#summary").inner_text()
    headings = page.locator("#lists h2").all_inner_texts()
    assert "Less than 80 % of the surface is S with any sensor" in headings
    context.close()


def test_filters_by_name_outcome_and_limits(page: Any, report: Report) -> None:
    opened(page, report.address())
    page.locator("#search").fill("KITCHEN")
    playwright.expect(page.locator("#shown")).to_have_text("1 of 6 meshes")
    assert names(page) == [report.rows[0].mesh]
    page.get_by_role("button", name="Clear").click()
    playwright.expect(page.locator("#shown")).to_have_text("6 meshes")
    page.locator("#outcome").select_option("refused or lost")
    playwright.expect(page.locator("#shown")).to_have_text("2 of 6 meshes")
    assert names(page) == [row.mesh for row in report.rows[4:]]
    page.locator("#outcome").select_option("all")
    playwright.expect(page.locator("#shown")).to_have_text("6 meshes")
    page.get_by_text("Limits", exact=True).click()
    page.get_by_label("S, min [%]").fill("50")
    high = [row.mesh for row in report.rows if row.stable is not None and row.stable >= 0.5]
    assert 0 < len(high) < 4
    playwright.expect(page.locator("#shown")).to_have_text(f"{len(high)} of 6 meshes")
    assert names(page) == high


def test_meshes_without_labels_have_a_reason_and_no_link(page: Any, report: Report) -> None:
    opened(page, report.address())
    failed = page.locator("#lists section").last
    assert f"{HOSTILE}: has no faces" in failed.inner_text()
    assert failed.locator("a").count() == 0
    assert page.locator(".tabulator-row").nth(5).locator("a").count() == 0
    assert page.locator("img[src=x]").count() == 0


def test_print_contains_all_rows_as_text(page: Any, report: Report) -> None:
    opened(page, report.address())
    page.emulate_media(media="print")
    page.evaluate("dispatchEvent(new Event('beforeprint'))")
    printed = page.locator(".tabulator-print-table tbody tr")
    assert [line.split("\t")[0] for line in printed.all_inner_texts()] == [
        row.mesh for row in report.rows
    ]
    assert f"{HOSTILE}: has no faces" in printed.nth(4).inner_text()
    assert page.locator("img[src=x]").count() == 0


def test_curves_are_shown_at_the_selected_friction(page: Any, report: Report) -> None:
    opened(page, report.address())
    assert page.locator("#friction option").all_inner_texts() == ["0.3", "0.5"]
    assert page.locator("#axes").inner_text().split() == ["Friction", "μ", "0.3", "0.5"]
    assert page.locator("#certainty").inner_text() == ""
    assert "no values of M and U" in page.locator("#unsearched").inner_text()
    page.locator("#friction").select_option(label="0.5")
    page.get_by_text("Values of the curves").click()
    cells = page.locator("#values tbody tr").nth(1).locator("td").all_inner_texts()
    every = [one for row in report.rows for one in row.fractions if one.friction == 0.5]
    at = [one for one in every if one.sensor_resolution == pytest.approx(10.0 * DEGREE)]
    median = float(np.median([one.stable for one in at]))
    assert cells[2] == f"{100.0 * median:.1f} %"


def test_each_varying_axis_of_the_grid_has_its_own_list(
    page: Any, report: Report, tmp_path: Path
) -> None:
    """The model is 0.5 +- 0.1 and 1 mm: its curve is shown first; each list changes one value."""
    grid = [
        AreaFractions(mu, alpha, mu - error - 100.0 * location, 0.0, 0.0, error, 0.0, location)
        for mu in (0.5, 0.8)
        for error in (0.0, 0.1)
        for location in (0.0, 0.001)
        for alpha in (0.0, 0.2)
    ]
    model = GraspModel(friction=(0.4, 0.6), location_error=0.001, fingers=3)
    row = replace(report.rows[0], fractions=tuple(grid), unit="m", thumbnail="", view="")
    written(page, tmp_path, [row], BatchSettings(replace(model, location_error="1mm")))
    lists = page.locator("#axes select")
    ids = ["friction", "frictionError", "locationError"]
    assert lists.evaluate_all("all => all.map(one => one.id)") == ids
    assert [lists.nth(k).locator("option").all_inner_texts() for k in range(3)] == [
        ["0.5", "0.8"], ["0", "0.1"], ["0", "1 mm"],
    ]  # fmt: skip
    assert page.locator("#axes label").all_inner_texts()[1].startswith("Friction error")
    page.get_by_text("Values of the curves").click()
    median = page.locator("#values tbody tr").first.locator("td").nth(2)
    assert median.inner_text() == "30.0 %"  # 0.5 - 0.1 - 0.1
    page.locator("#locationError").select_option("0")
    assert median.inner_text() == "40.0 %"
    page.locator("#friction").select_option("0.8")
    assert median.inner_text() == "70.0 %"
    text = "Labels are safe: every S and U is correct, an M may be one of them."
    assert page.locator("#certainty").inner_text() == text


def test_page_without_any_label_opens(page: Any, report: Report, tmp_path: Path) -> None:
    written(page, tmp_path, report.rows[4:], BatchSettings(MODEL))
    assert "No mesh was labelled" in page.locator("#curves").inner_text()
    page.goto(Report(tmp_path).address("object.html"))
    page.wait_for_selector("html[data-ready=failed]")
    assert "no such object" in page.locator("#name").inner_text()


def test_ten_thousand_rows_sort_and_scroll(page: Any, report: Report, tmp_path: Path) -> None:
    rows = [
        replace(report.rows[0], mesh=f"{k}.ply", thumbnail="", vertices=(k * 7919) % 10_007)
        for k in range(10_000)
    ]
    written(page, tmp_path, rows, BatchSettings(MODEL))
    page.get_by_role("button", name="Vertices").click()
    most = max(rows, key=lambda row: row.vertices or 0)
    assert names(page)[0] == most.mesh
    assert page.locator(".tabulator-row").count() < 100
    page.locator(".tabulator-tableholder").evaluate("one => { one.scrollTop = one.scrollHeight; }")
    least = min(rows, key=lambda row: row.vertices or 0)
    page.locator("#table").get_by_text(least.mesh, exact=True).wait_for()


@pytest.mark.parametrize("name", ["spray", "box", "cone", "cylinder"])
def test_fractions_follow_the_sliders(page: Any, report: Report, name: str) -> None:
    opened_object(page, report, name)
    labels = report.labels[name]
    expected = labels.fractions()
    assert fractions(page) == pytest.approx(expected, abs=1e-3)
    for friction, degrees in ((0.25, 10.0), (0.1, 30.0), (0.31, 0.0)):
        page.locator("#friction").fill(str(friction))
        page.locator("#resolution").fill(str(degrees))
        relabelled = labels.relabel(friction=friction, sensor_resolution=degrees * DEGREE)
        assert fractions(page) == pytest.approx(relabelled.fractions(), abs=1e-3)
        assert page.locator("#friction-number").input_value() == str(friction)
    page.get_by_role("button", name="As labelled").click()
    assert fractions(page) == pytest.approx(expected, abs=1e-3)


@pytest.mark.parametrize("per_finger", ["", "normal_error=3; friction=0.3..0.6"])
def test_fractions_follow_the_sliders_of_further_uncertainties(
    page: Any, tmp_path: Path, per_finger: str
) -> None:
    model = GraspModel(
        friction=(0.4, 0.6), normal_error=2.0 * DEGREE, location_error=0.002, per_finger=per_finger
    )
    mesh, wide = load_mesh(LIBRARY / "spray.glb"), Sampling(rays=8, search_angle=60.0 * DEGREE)
    labels, output = label_surface(mesh, model, sampling=wide), Folder(str(tmp_path))
    row = put_object(output, labels, row_of(labels, "spray", "spray"))
    written(page, tmp_path, [row], BatchSettings(model), "object.html#spray")
    assert fractions(page) == pytest.approx(labels.fractions(), abs=1e-3)
    located = page.locator("#located").inner_text()
    assert "within 2 mm, as labelled" in located
    assert ("finger 1: normals ± 3° more" in located) == bool(per_finger)
    assert "S where β* + η is below" in page.locator("#thresholds").inner_text()
    assert page.locator("#frictionError").is_disabled() == bool(per_finger)
    changes: list[tuple[str, float, dict[str, float]]] = [
        ("#normalError", 7.5, {"normal_error": 7.5 * DEGREE}),
        ("#resolution", 10.0, {"sensor_resolution": 10.0 * DEGREE}),
    ]
    if not per_finger:
        changes += [
            ("#frictionError", 0.0, {"friction_error": 0.0}),
            ("#friction", 0.3, {"friction": 0.3}),
        ]
    again = labels
    for slider, value, changed in changes:
        page.locator(slider).fill(str(value))
        again = again.relabel(**changed)
        assert fractions(page) == pytest.approx(again.fractions(), abs=1e-3)
    page.get_by_role("button", name="As labelled").click()
    assert fractions(page) == pytest.approx(labels.fractions(), abs=1e-3)
    frame = page.locator("canvas").bounding_box()
    page.mouse.click(frame["x"] + 0.5 * frame["width"], frame["y"] + 0.5 * frame["height"])
    vertex = int(page.locator("#vertex").get_attribute("data-vertex"))
    text = page.locator("#vertex").inner_text().replace("−", "-")
    assert f"{math.degrees(labels.margin[vertex]):.1f}°" in text
    assert ("of β" in text) == (not per_finger)


def test_uncertain_labels_show_their_margin_in_a_table_that_fits(
    browser: Any, report: Report, tmp_path: Path
) -> None:
    model = replace(MODEL, friction_error=0.1)
    for folder in ("objects", "thumbnails"):
        shutil.copytree(report.folder / "report" / folder, tmp_path / "report" / folder)
    rows = [replace(row, margin_p50=-0.1) for row in report.rows[:4]] + report.rows[4:]
    context = browser.new_context(viewport={"width": 1280, "height": 800})
    page = written(context.new_page(), tmp_path, rows, BatchSettings(model))
    check_columns(page)
    assert page.get_by_role("button", name="Margin median").count() == 1
    assert page.get_by_role("button", name="Vertices").count() == 0
    assert "-5.7°" in page.locator(".tabulator-row").first.inner_text()
    assert "Margin" in page.locator("#legend").inner_text()
    context.close()


def test_three_fingers_are_never_surely_unstable_from_90_degrees_on(
    page: Any, report: Report, tmp_path: Path
) -> None:
    labels, output = report.labels["cylinder"], Folder(str(tmp_path))
    wide = np.full_like(labels.critical_angle, 100.0 * DEGREE)
    unstable = with_critical_angles(labels, wide)
    output.write("report/objects/cylinder.js", object_script(unstable, "cylinder", ()))
    settings = BatchSettings(unstable.model)
    written(page, tmp_path, report.rows[3:4], settings, "object.html#cylinder")
    for friction, degrees, letter in ((0.02, 150.0, "U"), (0.1, 179.0, "M")):
        page.locator("#friction-number").fill(str(friction))
        page.locator("#resolution-number").fill(str(degrees))
        relabelled = unstable.relabel(friction=friction, sensor_resolution=degrees * DEGREE)
        assert relabelled.fractions()[letter] == pytest.approx(1.0)
        assert fractions(page) == pytest.approx(relabelled.fractions(), abs=1e-3)


def test_labels_beyond_the_searched_cone_are_marked(page: Any, report: Report) -> None:
    opened_object(page, report, "spray")
    labels = report.labels["spray"]
    beyond = math.atan(0.3) + 15.0 * DEGREE
    assert beyond > labels.search.cone
    lost = labels.mesh.vertex_areas[labels.critical_angle_best >= beyond].sum()
    assert "–" not in fractions(page)
    page.locator("#resolution").fill("30")
    found = fractions(page)
    assert found["–"] == pytest.approx(lost / labels.mesh.vertex_areas.sum(), abs=1e-3)
    assert found["–"] > 0.005
    assert found["U"] == 0.0
    assert "cannot be distinguished" in page.locator("#unsearched").inner_text()


def test_picture_has_the_colours_of_the_labels(page: Any, report: Report) -> None:
    opened_object(page, report, "spray")
    drawn = picture(page)
    hues = drawn / np.maximum(np.linalg.norm(drawn, axis=2, keepdims=True), 1.0)
    for label in Label:
        colour = np.array(COLORS[label], dtype=float)
        near = np.linalg.norm(hues - colour / np.linalg.norm(colour), axis=2) < 0.05
        assert near.mean() > 2e-3, label.name
    lit = drawn[np.linalg.norm(drawn - COLORS[Label.M], axis=2) < 40.0]
    assert len(lit) > 500  # neither washed out nor dark: colours are turned to linear and back
    page.locator("#paint").select_option("angle")
    assert np.abs(picture(page) - drawn).mean() > 1.0
    assert "grey" in page.locator("#ramp").inner_text()


def first_hit(
    labels: SurfaceLabels, camera: dict[str, list[float]], x: float, y: float
) -> int | None:
    """Vertex nearest to the first intersection of a ray."""
    mesh = trimesh.Trimesh(labels.mesh.vertices, labels.mesh.faces, process=False)
    start, direction = ray_at(camera, x, y)
    points, _, faces = mesh.ray.intersects_location([start], [direction], multiple_hits=False)
    if not len(faces):
        return None
    corners = mesh.faces[faces[0]]
    distances = np.linalg.norm(mesh.vertices[corners] - points[0], axis=1)
    return int(corners[distances.argmin()])


def test_click_picks_the_vertex_nearest_to_the_ray(page: Any, report: Report) -> None:
    opened_object(page, report, "spray")
    labels = report.labels["spray"]
    frame = page.locator("canvas").bounding_box()
    picked = set()
    for x, y in ((0.5, 0.5), (0.48, 0.7), (0.45, 0.3), (0.53, 0.6), (0.02, 0.9)):
        before = page.locator("#vertex").get_attribute("data-vertex")
        camera = page.evaluate("grasp3dCamera()")
        pixel = round(frame["width"] * x), round(frame["height"] * y)
        page.mouse.click(frame["x"] + pixel[0], frame["y"] + pixel[1])
        at = 2.0 * pixel[0] / frame["width"] - 1.0, 1.0 - 2.0 * pixel[1] / frame["height"]
        expected = first_hit(labels, camera, *at)
        shown = page.locator("#vertex").get_attribute("data-vertex")
        assert shown == (before if expected is None else str(expected))
        picked.add(expected)
        if expected is not None:
            text = page.locator("#vertex").inner_text()
            assert text.startswith(Label(labels.label[expected]).name)
            assert f"{math.degrees(labels.critical_angle[expected]):.1f}°" in text or "none" in text
    assert None in picked  # a click beside the surface picks nothing
    assert len(picked) > 3


def test_drag_rotates_and_does_not_pick(page: Any, report: Report) -> None:
    opened_object(page, report, "spray")
    before = picture(page)
    frame = page.locator("canvas").bounding_box()
    x, y = frame["x"] + frame["width"] / 2.0, frame["y"] + frame["height"] / 2.0
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + 90.0, y, steps=3)
    page.mouse.move(x + 8.0, y + 30.0, steps=3)  # still on the surface
    page.mouse.up()
    assert page.locator("#vertex").get_attribute("data-vertex") is None
    turned = picture(page)
    assert np.abs(turned - before).mean() > 2.0
    page.get_by_role("button", name="Reset view").click()
    assert np.abs(picture(page) - before).mean() < 0.5


def test_keys_rotate_the_view(page: Any, report: Report) -> None:
    opened_object(page, report, "box")
    before = picture(page)
    page.locator("canvas").focus()
    page.keyboard.press("ArrowRight")
    turned = picture(page)
    assert np.abs(turned - before).mean() > 1.0
    page.keyboard.press("+")
    assert np.abs(picture(page) - turned).mean() > 1.0


def test_best_grasps_are_listed_and_drawn(page: Any, report: Report) -> None:
    opened_object(page, report, "box")
    buttons = page.locator("#grasps button")
    grasps = report.rows[1].grasps
    assert buttons.count() == len(grasps) > 0
    assert f"β* {math.degrees(grasps[0].critical_angle):.1f}°" in buttons.first.inner_text()
    before = picture(page)
    buttons.first.click()
    assert buttons.first.get_attribute("aria-pressed") == "true"
    dark = [(one.max(axis=2) < 70.0).mean() for one in (before, picture(page))]
    assert dark[1] - dark[0] > 0.0015  # arrows, not only the contacts


def test_previous_and_next_step_through_the_library(page: Any, report: Report) -> None:
    opened(page, report.address())
    page.locator("#table").get_by_role("link", name=report.rows[0].mesh, exact=True).click()
    page.wait_for_selector(f"html[data-ready='{STEMS['spray']}']")
    assert page.get_by_role("button", name="Previous").is_disabled()
    for row in report.rows[1:4]:
        page.get_by_role("button", name="Next").click()
        page.wait_for_function(
            "name => document.querySelector('#name').textContent === name", arg=row.mesh
        )
        page.wait_for_selector("html[data-ready]")
        assert fractions(page)["S"] == pytest.approx(row.stable, abs=1e-3)
    assert page.get_by_role("button", name="Next").is_disabled()
    page.get_by_role("button", name="Previous").click()
    page.wait_for_selector(f"html[data-ready='{STEMS['cone']}']")
    page.get_by_role("link", name="All meshes").click()
    page.wait_for_selector("html[data-ready=yes]")


def test_a_note_distinguishes_sampled_labels_from_exact_ones(
    page: Any, report: Report, tmp_path: Path
) -> None:
    labels, output = report.labels["box"], Folder(str(tmp_path))
    sampled = labels.using(model=replace(MODEL, method="extremes"))
    vars(sampled.grasps)["epsilon_range"] = labels.grasps.epsilon_range  # it takes long
    output.write("report/objects/box.js", object_script(sampled, "box", ()))
    written(page, tmp_path, report.rows[1:2], BatchSettings(sampled.model), "object.html#box")
    assert "thresholds on the exact critical angle" in page.locator("#method").inner_text()
    assert "None stored" in page.locator("#grasps").inner_text()
    assert fractions(page) == pytest.approx(labels.fractions(), abs=1e-3)


def test_a_missing_file_of_an_object_is_reported(
    browser: Any, report: Report, tmp_path: Path
) -> None:
    with browser.new_page() as seen:
        written(seen, tmp_path, report.rows[:1], BatchSettings(MODEL), "object.html")
        assert "missing" in seen.locator("#name").inner_text()


def test_addresses_outside_the_library_load_nothing(page: Any, report: Report) -> None:
    page.goto(report.address("object.html#../../evil"))
    page.wait_for_selector("html[data-ready=failed]")
    assert page.locator("script[src*=evil]").count() == 0


def test_without_webgl_the_values_are_shown(driver: Any, report: Report) -> None:
    without_webgl = driver.launch(
        executable_path=BROWSER, args=["--no-sandbox", "--disable-3d-apis"]
    )
    seen = opened(without_webgl.new_page(), report.address("object.html#box"))
    assert "needs WebGL" in seen.locator("#message").inner_text()
    assert fractions(seen) == pytest.approx(report.labels["box"].fractions(), abs=1e-3)
    without_webgl.close()
