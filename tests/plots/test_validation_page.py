"""The report of a validation: one page without any other file."""

import base64
import io
import re
from dataclasses import replace
from functools import cache
from html import escape
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from grasp3d import GraspModel, ParallelGripper, load_mesh, validate_grasps
from grasp3d.errors import OutputError
from grasp3d.grasps.poses import GraspPoses
from grasp3d.plots import validation_page
from grasp3d.plots.validation_page import FILES, page_of, write_report
from grasp3d.plots.validations import draw_disagreement
from grasp3d.validating import Validation, ValidationSettings
from grasp3d.viewer.scene.marks import Marks
from tests.helpers import shapes
from tests.helpers.tried_grasps import poses_on


@cache
def found(held: int | None = None) -> Validation:
    """Eighty grasps of a body with random outcomes, or all with the same."""
    points, faces = shapes.lopsided(2)
    mesh = load_mesh((0.025 * points, faces), unit="m", max_edge=0.02)
    poses = poses_on(mesh, 80, 3, 0.075)
    outcome = np.random.default_rng(0).random(80) < 0.5 if held is None else np.full(80, held)
    tried = GraspPoses(
        poses=poses.poses, outcome=outcome, unit="m", names=[f"<b>{k}</b>" for k in range(80)]
    )
    settings = ValidationSettings(resamples=100, worst=1)
    model, hand = GraspModel(sensor_resolution=0.0), ParallelGripper.preset("franka")
    return validate_grasps(tried, model, mesh=mesh, hand=hand, settings=settings)


def images(page: str) -> list[tuple[str, bytes]]:
    parts = re.findall(r'src="data:image/([\w+]+);base64,([^"]+)"', page)
    return [(kind, base64.b64decode(data)) for kind, data in parts]


@pytest.mark.slow
def test_the_page_needs_nothing_else(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(validation_page, "can_render", lambda: False)
    page = page_of(found())
    assert [kind for kind, _ in images(page)] == ["svg+xml"] * 3
    assert all(data.startswith(b"<?xml") for _, data in images(page))
    rest = re.sub(r"base64,[^\"]+", "", page)
    policy = "default-src 'none'; style-src 'unsafe-inline'; img-src data:; base-uri 'none'"
    assert f'Content-Security-Policy" content="{policy}"' in page
    assert not re.search(r"https?:|<script|src=\"[^d]|url\(", rest)
    for one in found().qualities:
        assert f"{one.roc_auc:.3f}" in page
    assert "There are no pictures of them: they need OpenGL" in page
    kinds = {one.kind for one in found().disagreements}
    assert {"failed", "held"} <= kinds
    assert rest.count('class="card"') == len(found().disagreements) >= len(kinds)
    for reason in found().reasons:
        assert f"<td >{escape(reason.reason.name)}</td>" in page
        assert any(
            cause.reason == reason.reason for one in found().disagreements for cause in one.causes
        )
    for difference in found().differences:
        assert f"<td >{difference.difference:+.3f} " in page
    assert page.count("<details>") == 1
    assert "By object" not in page


@pytest.mark.slow
def test_objects_have_a_table_with_their_mean(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(validation_page, "can_render", lambda: False)
    one, two = (replace(found().by_objects[0], number=k, roc_auc=areas(k)) for k in (0, 1))
    files = tuple(
        replace(found().files[0], object_number=k, object_name=f"{k}.obj") for k in (0, 1)
    )
    page = page_of(replace(found(), by_object=True, by_objects=(one, two), files=files))
    assert (
        "ROC-AUC of the robust score by object: 0.250 (0.obj) to 0.750 (1.obj), mean 0.500" in page
    )
    (row,) = re.findall("<tr><td >mean over objects.*?</tr>", page)
    assert row.count("<td >0.500</td>") == len(found().qualities)
    (row,) = re.findall("<tr><td >all grasps.*?</tr>", page)
    assert f"<td >{found().quality('opening').roc_auc:.3f}</td>" in row


def areas(number: int) -> dict[str, float]:
    return {one.score.name: 0.25 + 0.5 * number for one in found().qualities}


def test_labels_that_outcomes_never_contradict_have_no_cards(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(validation_page, "can_render", lambda: False)
    page = page_of(replace(found(), reasons=(), disagreements=()))
    assert "No grasp that failed is labelled S, and none that held is labelled U." in page
    assert 'class="card"' not in page


def test_equal_outcomes_have_a_page_without_curves(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(validation_page, "can_render", lambda: False)
    page = page_of(found(1))
    assert len(images(page)) == 2
    assert "undefined" in page
    assert '<p class="warning">poses: all 80 grasps held' in page


@pytest.mark.slow
def test_what_is_in_the_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(validation_page, "can_render", lambda: False)
    write_report(tmp_path / "out", found())
    assert {path.name for path in (tmp_path / "out").iterdir()} == set(FILES)
    first = (tmp_path / "out" / "report.html").read_bytes()
    write_report(tmp_path / "out", found())
    assert (tmp_path / "out" / "report.html").read_bytes() == first  # no date, no chance
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError, match="is a file; name a folder"):
        write_report(tmp_path / "file", found())


@pytest.mark.slow
def test_pictures_show_object_gripper_and_contacts(monkeypatch: pytest.MonkeyPatch) -> None:
    from grasp3d.rendering.opengl import can_render

    if not can_render():
        pytest.skip("no OpenGL")
    page = page_of(found())
    pictures = [data for kind, data in images(page) if kind == "jpeg"]
    assert len(pictures) == len(found().disagreements)
    for data in pictures:
        pixels = np.asarray(Image.open(io.BytesIO(data)).convert("RGB")).reshape(-1, 3).astype(int)
        red, _, blue = pixels.T
        assert (red - blue > 25).mean() > 0.01  # the object
        grey = (np.ptp(pixels, axis=1) < 16) & (red < 235)
        assert grey.mean() > 0.03  # the gripper
        assert (blue - red > 100).mean() > 0.003  # its approach
    one = next(one for one in found().disagreements if np.isfinite(one.grasp.jaws.points).all())
    image = draw_disagreement(one)
    assert image.shape == (360, 420, 3)
    monkeypatch.setattr(Marks, "_show_grasp", lambda *_, **__: None)
    assert (draw_disagreement(one) != image).any(axis=2).mean() > 0.001  # the contacts
