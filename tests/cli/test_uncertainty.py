"""Uncertainties on the command line: options and printed reports."""

import json
import math
from pathlib import Path

import pytest

from grasp3d import GraspModel
from grasp3d.cli.usage import parse
from grasp3d.settings.parsing import plain_values
from tests.helpers import shapes
from tests.helpers.commands import export, printed
from tests.helpers.commands import run_here as grasp3d

COARSE = ("--max-edge", "inf", "--unit", "mm")
ERRORS = (
    "--friction", "0.4..0.6", "--sensor-resolution", "14", "--location-error", "1mm",
)  # fmt: skip
MODEL = GraspModel(
    friction=(0.4, 0.6),
    sensor_resolution=math.radians(14.0),
    location_error="1mm",
)


def parsed(*words: str) -> GraspModel:
    model: GraspModel = parse(GraspModel, list(words))
    return model


def test_the_options_are_the_settings() -> None:
    assert plain_values(parsed(*ERRORS)) == plain_values(MODEL)
    assert plain_values(parsed()) == plain_values(GraspModel())


@pytest.mark.parametrize("words", [(), ERRORS])
def test_reports_have_the_uncertainties(tmp_path: Path, words: tuple[str, ...]) -> None:
    export(tmp_path / "box.stl", shapes.box((40.0, 60.0, 80.0)))
    pairs = [[[-20, 0, 0], [20, 0, 0]], [[-20, 0, 0], [0, 30, 0]]]
    (tmp_path / "pairs.json").write_text(json.dumps(pairs), encoding="utf-8")
    labelled = printed("label", "box.stl", *words, *COARSE, cwd=tmp_path)
    evaluated = ("evaluate", "box.stl", "pairs.json", *words, "--unit", "mm", "-o", "out.csv")
    stated = "μ 0.4 to 0.6, α 14°, locations ± 1 mm"
    for text in (labelled, printed(*evaluated, cwd=tmp_path)):
        assert (stated in text.splitlines()[0]) == bool(words)


def test_a_batch_refuses_a_location_error_that_cannot_be_meant(tmp_path: Path) -> None:
    export(tmp_path / "box.stl", shapes.box((40.0, 60.0, 80.0)))
    words = ("--unit", "mm", "--max-edge", "inf")
    batch = ("batch", "box.stl", "--workers", "0", *words)
    done = grasp3d(*batch, "-o", "out", "--location-error", "500mm", cwd=tmp_path)
    assert done.returncode == 1
    assert "failed: location_error is 500 mm, 4.64 times the size of box.stl" in done.stdout
