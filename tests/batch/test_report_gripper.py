"""The gripper on the report's object page."""

import io
import json
import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from grasp3d.batch.batch_settings import BatchSettings
from grasp3d.batch.report import object_script, write_report
from grasp3d.batch.report.objects import drawn_openings, gripper_data
from grasp3d.batch.row import Row
from grasp3d.batch.storage.folder import Folder
from grasp3d.hand.shapes import hand_triangles
from grasp3d.hand.triangles import Part
from tests.batch.test_report_page import BROWSER, OPTIONS
from tests.helpers import viewing
from tests.helpers.held_grasps import JAWS, best_grasps_of, held_box, with_reach
from tests.helpers.reports import decoded

ROUND = replace(JAWS, name="round", pad_width=0.0, pad_height=0.0, tip_radius=0.01)


@pytest.mark.parametrize("hand", [JAWS, ROUND])
@pytest.mark.parametrize("opening", [0.0, 0.03, 0.08])
def test_the_page_moves_the_fingers_as_python_draws_them(hand: Any, opening: float) -> None:
    data = gripper_data(with_reach(held_box(), hand))
    assert data is not None
    vertices = np.array(data["vertices"]).reshape(-1, 3)
    vertices[:, 0] += opening * np.array(data["shifts"])
    expected = hand_triangles(hand, opening)
    assert np.allclose(vertices, expected.vertices, atol=1e-6)
    assert np.array_equal(np.array(data["faces"]).reshape(-1, 3), expected.faces)
    assert data["parts"] == [Part(part).name.lower() for part in expected.parts]
    assert data["name"] == hand.name
    assert data["fingers"] == hand.finger_length
    plate = np.array(data["table"]["vertices"]).reshape(-1, 3)
    assert plate[:, 2].max() == pytest.approx(-0.04, abs=1e-3)


def test_the_script_has_the_pose_of_each_best_grasp() -> None:
    labels = held_box()
    grasps = best_grasps_of(labels, 3)
    header = decoded(object_script(labels, "box", (*grasps, replace(grasps[0], pose=()))))[0]
    for stored, grasp in zip(header["grasps"], grasps, strict=False):
        assert stored["pose"] == list(grasp.pose or ())
        assert stored["drawn_opening"] == pytest.approx(grasp.opening)
        assert stored["approach_margin"] == grasp.approach_margin
    assert header["grasps"][3]["pose"] == []
    assert header["grasps"][3]["drawn_opening"] is None
    assert ["margin", "f4"] in [array[:2] for array in header["arrays"]]


def test_without_a_gripper_the_script_has_none() -> None:
    header = decoded(object_script(viewing.labels(), "cone", ()))[0]
    assert header["gripper"] is None
    assert "margin" not in [array[0] for array in header["arrays"]]


def test_openings_of_round_tips_and_of_grasps_from_inside() -> None:
    (grasp,) = best_grasps_of(held_box(), 1)
    along = np.subtract(grasp.points[1], grasp.points[0])
    along /= np.linalg.norm(along)
    outward = (tuple(-along), tuple(along))
    external, internal = replace(grasp, normals=outward), replace(grasp, normals=outward[::-1])
    flat, balls = held_box(), with_reach(held_box(), ROUND)
    opening = grasp.opening
    assert drawn_openings([external, internal], flat) == pytest.approx(
        [opening, max(0.0, opening - 2.0 * JAWS.finger_thickness)]
    )
    assert drawn_openings([external, internal], balls) == pytest.approx(
        [opening, max(0.0, opening - 4.0 * ROUND.tip_radius)]
    )


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("library")
    made = Folder(str(path))
    labels = held_box()
    grasps = best_grasps_of(labels, 2)
    row = Row("box.stl", view="report/objects/box.js", vertices=len(labels.mesh.vertices))
    made.write(row.view, object_script(labels, row.mesh, grasps))
    write_report(made, [replace(row, grasps=grasps)], BatchSettings())
    return path


@pytest.fixture
def page(folder: Path) -> Iterator[Any]:
    playwright = pytest.importorskip("playwright.sync_api", reason="needs playwright")
    if BROWSER is None:
        pytest.skip("needs Chromium")
    faults: list[str] = []
    with playwright.sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=BROWSER, args=OPTIONS)
        opened = browser.new_page(viewport={"width": 980, "height": 600})
        opened.on("pageerror", lambda error: faults.append(str(error)))
        opened.goto(f"{(folder / 'report' / 'object.html').as_uri()}#box")
        opened.wait_for_selector("html[data-ready]")
        yield opened
        browser.close()
    assert not faults


def picture(page: Any) -> NDArray[np.float64]:
    shot = page.locator("canvas").screenshot()
    return np.asarray(Image.open(io.BytesIO(shot)).convert("RGB"), dtype=float)


def greys(image: NDArray[np.float64]) -> float:
    """Fraction of grey pixels that are not the background: gripper and table."""
    return float(((np.ptp(image, axis=2) < 20.0) & (image.mean(axis=2) < 225.0)).mean())


@pytest.mark.slow
def test_a_best_grasp_shows_the_gripper_within_the_picture(page: Any) -> None:
    before = picture(page)
    page.click("#grasps button:nth-child(1)")
    after = picture(page)
    assert greys(after) > greys(before) + 0.03
    edge = np.concatenate([after[:3].reshape(-1, 3), after[-3:].reshape(-1, 3)])
    assert (edge.mean(axis=1) > 225.0).mean() > 0.9
    assert "approach ±" in page.locator("#grasps button").first.inner_text()
    assert "gripper jaws and a table" in page.locator("#facts").inner_text()
    page.select_option("#paint", "margin")
    assert "not reached" in page.locator("#ramp").inner_text()
    largest = math.degrees(np.nanmax(held_box().reach.approach_margin))  # type: ignore[union-attr]
    assert f"{largest:.3g}°" in page.locator("#ramp").inner_text()


def test_gripper_data_is_small() -> None:
    assert len(json.dumps(gripper_data(held_box()))) < 40_000
