"""The report of a validation: one page without any other file."""

import base64
import io
import re
from functools import cache
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
    return validate_grasps(
        tried, GraspModel(), mesh=mesh, hand=ParallelGripper.preset("franka"), settings=settings
    )


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
    assert rest.count('class="card"') == len(found().disagreements) == len(kinds)


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
def test_pictures_show_object_gripper_and_contacts() -> None:
    from grasp3d.plots.rendering import can_render

    if not can_render():
        pytest.skip("no OpenGL")
    page = page_of(found())
    pictures = [data for kind, data in images(page) if kind == "jpeg"]
    assert len(pictures) == len(found().disagreements)
    for one, data in zip(found().disagreements, pictures, strict=True):
        pixels = np.asarray(Image.open(io.BytesIO(data)).convert("RGB")).reshape(-1, 3).astype(int)
        red, _, blue = pixels.T
        assert (red - blue > 25).mean() > 0.01  # the object
        grey = (np.ptp(pixels, axis=1) < 16) & (red < 235)
        assert grey.mean() > 0.03  # the gripper
        closed = np.isfinite(one.points).all()
        assert ((pixels.max(axis=1) < 60).mean() > 0.002) == closed  # the contacts
    one = found().disagreements[0]
    assert draw_disagreement(one).shape == (360, 420, 3)
