"""Uncertainties on the command line: options and printed reports."""

import json
import math
import re
from pathlib import Path

import pytest

from grasp3d import GraspModel, Sampling, label_surface, load_mesh
from grasp3d.cli.ranges import parse_angles, parse_numbers
from grasp3d.cli.usage import parse
from grasp3d.errors import SettingError
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


def test_ranges_of_angles_and_numbers() -> None:
    assert parse_numbers("it", ("0.1", "0:0.2:0.1")) == pytest.approx((0.0, 0.1, 0.2))
    assert parse_angles("it", ("180",)) == (math.pi,)
    assert parse_angles("it", ("0:0.2:0.1rad", "0.3 RAD")) == (0.0, 0.1, 0.2, 0.3)
    assert parse_angles("it", ("0:30:15deg",)) == parse_angles("it", ("0:30:15",))
    for word in ("0:1rad:0.1", "0deg:1:0.1rad", "rad"):
        with pytest.raises(SettingError, match="it must be an angle"):
            parse_angles("it", (word,))


@pytest.mark.slow
def test_the_report_of_labels_has_the_uncertainties_and_the_mean_budget(tmp_path: Path) -> None:
    source = export(tmp_path / "box.stl", shapes.box((40.0, 60.0, 80.0)))
    text = printed("label", "box.stl", *ERRORS, *COARSE, "--best", "1", cwd=tmp_path)
    lines = text.splitlines()
    assert "friction 0.4 to 0.6, sensor resolution 14°" in lines[0]
    assert "uncertain: friction 0.4 to 0.6; contact locations by 1 mm" in lines
    mesh = load_mesh(source, unit="mm", max_edge=math.inf)
    labels = label_surface(mesh, MODEL, sampling=Sampling(rays=8))
    weights = mesh.vertex_areas / mesh.vertex_areas.sum()
    (budget,) = [line for line in lines if line.startswith("mean budget: friction angle 26.57°")]
    assert "friction 4.76°" in budget
    assert "sensor resolution 7.00° + location" in budget
    mean = math.degrees(float(weights @ labels.margin))
    assert float(budget.rpartition("margin ")[2].rstrip("°")) == pytest.approx(mean, abs=0.006)
    numbers = [float(number) for number in re.findall(r"(-?[\d.]+)°", budget)]
    assert numbers[0] == pytest.approx(sum(numbers[1:]), abs=0.05)
    (margins,) = [line for line in lines if line.startswith("margin, 10/50/90 % of the area: ")]
    assert margins.endswith("(S: above 0)")
    (heading,) = [line for line in lines if line.startswith("grasp  label")]
    assert heading.split()[:6] == ["grasp", "label", "score", "β*", "α*", "margin"]


@pytest.mark.slow
def test_without_further_uncertainties_the_report_has_no_margin(tmp_path: Path) -> None:
    export(tmp_path / "box.stl", shapes.box((40.0, 60.0, 80.0)))
    text = printed("label", "box.stl", *COARSE, "--best", "1", cwd=tmp_path)
    assert not re.search("margin|uncertain|budget", text)


def test_the_report_of_grasps_has_their_margins(tmp_path: Path) -> None:
    export(tmp_path / "box.stl", shapes.box((40.0, 60.0, 80.0)))
    pairs = [[[-20, 0, 0], [20, 0, 0]], [[-20, 0, 0], [0, 30, 0]]]
    (tmp_path / "pairs.json").write_text(json.dumps(pairs), encoding="utf-8")
    text = printed(
        "evaluate", "box.stl", "pairs.json", *ERRORS, "--unit", "mm", "-o", "out.csv", cwd=tmp_path
    )
    turn = math.degrees(math.asin(2.0 / 40.0))
    margin = math.degrees(math.atan(0.4)) - 7.0 - turn
    first, second = (line.split() for line in text.splitlines() if re.match(r" +[12] +■", line))
    assert f"{margin:.1f}°" in first
    assert [cell for cell in second if cell.startswith("-")]
    assert "margin: friction angle to spare, S: above 0" in text
    assert "uncertain: " in text


@pytest.mark.slow
def test_reports_have_millimetres_and_the_meaning_of_safe_labels(tmp_path: Path) -> None:
    export(tmp_path / "box.stl", shapes.box((0.04, 0.06, 0.08)))
    words = ("--unit", "m", "--max-edge", "inf", "--location-error", "1mm")
    text = printed("label", "box.stl", *words, cwd=tmp_path)
    (line,) = [line for line in text.splitlines() if line.startswith("uncertain: ")]
    assert "contact locations by 1 mm" in line
    safe = "safe labels: every S and U is correct, an M may be one of them"
    assert safe in text
    triples = [[[-0.02, 0, 0], [0.02, 0.01, 0], [0.02, -0.01, 0]]]
    (tmp_path / "triples.json").write_text(json.dumps(triples), encoding="utf-8")
    given = ("evaluate", "box.stl", "triples.json", "--unit", "m", "-o", "out.csv")
    for located in ((), ("--location-error", "1mm")):
        text = printed(*given, *located, "--overwrite", cwd=tmp_path)
        assert text.count(safe) == len(located) // 2


def test_a_batch_refuses_a_location_error_that_cannot_be_meant(tmp_path: Path) -> None:
    export(tmp_path / "box.stl", shapes.box((40.0, 60.0, 80.0)))
    words = ("--unit", "mm", "--max-edge", "inf")
    batch = ("batch", "box.stl", "--workers", "0", *words)
    done = grasp3d(*batch, "-o", "out", "--location-error", "500mm", cwd=tmp_path)
    assert done.returncode == 1
    assert "failed: location_error is 500 mm, 4.64 times the size of box.stl" in done.stdout
