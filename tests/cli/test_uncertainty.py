"""Uncertainties on the command line: options, printed reports, and sweeps over them."""

import json
import math
import re
from pathlib import Path

import numpy as np
import pyarrow.csv as pc
import pytest

from grasp3d import GraspModel, Sampling, SurfaceLabels, label_surface, load_mesh
from grasp3d.batch.sweeping import MAX_SEARCHES, search_at_each
from grasp3d.cli.ranges import parse_angles, parse_lengths, parse_numbers
from grasp3d.cli.usage import parse
from grasp3d.errors import SettingError
from grasp3d.mesh.primitives import box_mesh
from grasp3d.planar import Circle
from grasp3d.settings.lengths import Measure
from grasp3d.settings.parsing import plain_values
from grasp3d.surface.sweeps import sweep
from grasp3d.system.context import report_progress, running, unreported
from tests.helpers import shapes
from tests.helpers.commands import export, printed
from tests.helpers.commands import run_here as grasp3d

COARSE = ("--max-edge", "inf", "--rays", "8", "--unit", "mm")
ERRORS = (
    "--friction", "0.4..0.6", "--sensor-resolution", "10", "--normal-error", "2",
    "--location-error", "1mm",
)  # fmt: skip
MODEL = GraspModel(
    friction=(0.4, 0.6),
    sensor_resolution=math.radians(10.0),
    normal_error=math.radians(2.0),
    location_error="1mm",
)


def parsed(*words: str) -> GraspModel:
    model: GraspModel = parse(GraspModel, list(words))
    return model


def test_the_options_are_the_settings() -> None:
    assert plain_values(parsed(*ERRORS)) == plain_values(MODEL)
    assert plain_values(parsed()) == plain_values(GraspModel())
    assert parsed("--friction", "0.7", "--friction-error", "0.1").friction_interval == (
        pytest.approx(0.6),
        pytest.approx(0.8),
    )
    fingers = "location_error=1mm; friction=0.3..0.4"
    assert parsed("--per-finger", fingers).per_finger == GraspModel(per_finger=fingers).per_finger
    assert parsed("--per-finger", "none").per_finger == ()


def test_ranges_of_lengths_and_numbers() -> None:
    one, two = Measure(1.0, "mm"), Measure(2.0, "mm")
    assert parse_lengths("it", ("0:2:1mm", "0.5mm")) == (0.0, one, two, Measure(0.5, "mm"))
    assert parse_lengths("it", ("0:0.002:0.001",)) == (0.0, 0.001, 0.002)
    assert parse_lengths("it", ("0:0.3:0.1",)) == (0.0, 0.1, 0.2, 0.3)
    longer = Measure(1.0, "cm"), Measure(2.0, "cm")
    assert parse_lengths("it", ("1 MM", "1mm", "1cm:2cm:1cm")) == (one, *longer)
    assert parse_numbers("it", ("0.1", "0:0.2:0.1")) == pytest.approx((0.0, 0.1, 0.2))
    assert parse_angles("it", ("180",)) == (math.pi,)
    assert parse_angles("it", ("0:0.2:0.1rad", "0.3 RAD")) == (0.0, 0.1, 0.2, 0.3)
    assert parse_angles("it", ("0:30:15deg",)) == parse_angles("it", ("0:30:15",))
    for word in ("0:1rad:0.1", "0deg:1:0.1rad", "rad"):
        with pytest.raises(SettingError, match="it must be an angle"):
            parse_angles("it", (word,))
    for word in ("a", "1mm:2", "2:1:1mm", "1mm:2cm:1mm", "1:2:0mm", "mm"):
        with pytest.raises(SettingError, match=r"it must be a length .*, or a range FROM:TO:STEP"):
            parse_lengths("it", (word,))
    with pytest.raises(SettingError, match="more than 10000 values"):
        parse_lengths("location error", ("0:1:1e-5m",))


@pytest.mark.slow
def test_the_report_of_labels_has_the_uncertainties_and_the_mean_budget(tmp_path: Path) -> None:
    source = export(tmp_path / "box.stl", shapes.box((40.0, 60.0, 80.0)))
    text = printed("label", "box.stl", *ERRORS, *COARSE, "--best", "1", cwd=tmp_path)
    lines = text.splitlines()
    assert "friction 0.4 to 0.6, sensor resolution 10°" in lines[0]
    assert (
        "uncertain: friction 0.4 to 0.6; normals by a further 2°; contact locations by 1 mm"
        in lines
    )
    mesh = load_mesh(source, unit="mm", max_edge=math.inf)
    labels = label_surface(mesh, MODEL, sampling=Sampling(rays=8))
    weights = mesh.vertex_areas / mesh.vertex_areas.sum()
    (budget,) = [line for line in lines if line.startswith("mean budget: friction angle 26.57°")]
    assert "friction 4.76°" in budget
    assert "sensor resolution 5.00° + normal error 2.00° + location" in budget
    mean = math.degrees(float(weights @ labels.margin))
    assert float(budget.rpartition("margin ")[2].rstrip("°")) == pytest.approx(mean, abs=0.006)
    numbers = [float(number) for number in re.findall(r"(-?[\d.]+)°", budget)]
    assert numbers[0] == pytest.approx(sum(numbers[1:]), abs=0.05)
    (margins,) = [line for line in lines if line.startswith("margin, 10/50/90 % of the area: ")]
    assert margins.endswith("(S: above 0)")
    (heading,) = [line for line in lines if line.startswith("grasp  label")]
    assert heading.split()[:5] == ["grasp", "label", "β*", "α*", "margin"]


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
def test_a_sweep_over_location_errors(tmp_path: Path) -> None:
    text = printed(
        "sweep", "circle", "sphere", "--location-error", "0:0.2:0.1", "--fraction", "0.1",
        cwd=tmp_path,
    )  # fmt: skip
    assert text.startswith("area fractions of S/M/U [%] by sensor resolution, friction 0.5:")
    assert "location error" in text
    rows = pc.read_csv(tmp_path / "sweep.csv").to_pylist()
    assert len(rows) == 2 * 3 * 62
    assert {row["location_error"] for row in rows} == {0.0, 0.1, 0.2}
    assert {row["friction"] for row in rows} == {0.5}
    assert (tmp_path / "sweep.svg").exists()


@pytest.mark.slow
def test_every_line_of_the_required_resolutions_has_its_name(tmp_path: Path) -> None:
    words = ("--location-error", "0", "0.1", "--fraction", "0.1", "0.2")
    done = grasp3d("sweep", "circle", "square", *words, cwd=tmp_path, columns=80)
    table = done.stdout.split("required resolution")[1].splitlines()[1:7]
    first = [line.split()[0] for line in table]
    assert first == ["location", "(radius", "circle", "0.1", "square", "0.1"]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("words", "fixed", "rows"),
    [
        (("--friction-error", "0.1"), "friction error 0.1", 3 * 62),
        (("--location-error", "0", "0.1", "--friction", "0.3", "0.5"), "resolution 22.6°", 4),
        (
            ("--location-error", "0", "0.1", "--normal-error", "0", "5", "10"),
            "friction 0.5, sensor resolution 22.6°",
            6,
        ),
        (("--normal-error", "0:20:1", "--sensor-resolution", "10"), "resolution 10°", 3 * 21),
    ],
)
def test_defaults_leave_two_axes(
    words: tuple[str, ...], fixed: str, rows: int, tmp_path: Path
) -> None:
    text = printed("sweep", "sphere", *words, cwd=tmp_path)
    assert fixed in text.splitlines()[0]
    assert len(pc.read_csv(tmp_path / "sphere_sweep.csv")) == rows


def test_the_required_resolution_over_two_errors_is_printed(tmp_path: Path) -> None:
    words = ("--location-error", "0", "0.1", "--normal-error", "0", "5", "--friction", "1")
    done = grasp3d("sweep", "circle", *words, "--fraction", "0.2", cwd=tmp_path)
    table = done.stdout.split("20 %, by location error (radius = 1):")[1].splitlines()
    printed = [float(cell.rstrip("°")) for cell in table[2].split()[-2:] + table[3].split()[-2:]]
    swept = sweep(
        Circle(),
        friction=1.0,
        sensor_resolution=0.1,
        normal_error=np.radians([0.0, 5.0]),
        location_error=[0.0, 0.1],
    )
    expected = np.degrees(swept.required_resolution(0.2)).ravel()
    assert printed == pytest.approx(expected.tolist(), abs=0.051)


@pytest.mark.slow
def test_reports_have_millimetres_and_the_meaning_of_safe_labels(tmp_path: Path) -> None:
    export(tmp_path / "box.stl", shapes.box((0.04, 0.06, 0.08)))
    fingers = "location_error=0.5mm; normal_error=2, friction=0.3..0.4"
    words = ("--unit", "m", "--max-edge", "inf", "--rays", "8", "--location-error", "1mm")
    text = printed("label", "box.stl", *words, "--per-finger", fingers, cwd=tmp_path)
    (line,) = [line for line in text.splitlines() if line.startswith("uncertain: ")]
    assert "contact locations by 1 mm" in line
    assert "finger 1: locations ± 0.5 mm more" in line
    assert "finger 2: normals ± 2° more, friction 0.3 to 0.4" in line
    assert "safe labels" not in text  # those of two fingers are exact
    triples = [[[-0.02, 0, 0], [0.02, 0.01, 0], [0.02, -0.01, 0]]]
    (tmp_path / "triples.json").write_text(json.dumps(triples), encoding="utf-8")
    given = ("evaluate", "box.stl", "triples.json", "--unit", "m", "-o", "out.csv")
    safe = "safe labels: every S and U is correct, an M may be one of them"
    for located in ((), ("--location-error", "1mm")):
        text = printed(*given, *located, "--overwrite", cwd=tmp_path)
        assert text.count(safe) == len(located) // 2


def test_a_batch_refuses_a_location_error_that_cannot_be_meant(tmp_path: Path) -> None:
    export(tmp_path / "box.stl", shapes.box((40.0, 60.0, 80.0)))
    words = ("--unit", "mm", "--rays", "8", "--max-edge", "inf")
    batch = ("batch", "box.stl", "--workers", "0", *words)
    for number, option in enumerate(("--location-error", "--grid-location-error")):
        done = grasp3d(*batch, "-o", f"out{number}", option, "500mm", cwd=tmp_path)
        assert done.returncode == 1
        assert "failed: location_error is 500 mm, 4.64 times the size of box.stl" in done.stdout


@pytest.mark.slow
def test_a_sweep_states_the_unit_of_its_values(tmp_path: Path) -> None:
    export(tmp_path / "box.stl", shapes.box((40.0, 60.0, 80.0)))
    words = ("--max-edge", "inf", "--rays", "8", "--friction", "0.5", "--sensor-resolution", "10")
    for unit, heading in (
        ("", "location error (in the mesh's unit)"),
        ("mm", "location error, fr"),
    ):
        given = ("--location-error", "0", f"1{unit}", "--normal-error", "0", "5", "--unit", "mm")
        text = printed("sweep", "box.stl", *words, *given, "--overwrite", cwd=tmp_path)
        assert text.startswith(f"area fractions of S/M/U [%] by {heading}")
        assert ("1 mm" in text) == (unit == "mm")


def test_a_sweep_searches_at_each_location_error() -> None:
    """At each of them every vertex has the best grasp of all searches."""
    mesh = box_mesh((1.0, 2.0, 3.0), max_edge=1.0)
    seen: list[float] = []

    def label(model: GraspModel) -> SurfaceLabels:
        seen.append(model.location_error)
        with unreported():
            labels = label_surface(mesh, model, sampling=Sampling(rays=8))
        for fraction in (0.5, 1.0):
            report_progress(fraction)
        return labels

    few = search_at_each(label, GraspModel(), [0.0, 0.1])
    assert seen == [0.0, 0.1]
    for delta in (0.0, 0.05, 0.1):
        best = few.angle_distribution(location_error=delta)
        for one in few.searches:
            alone = one.angle_distribution(location_error=delta)
            assert (best.worst <= alone.worst).all()
            assert (best.best <= alone.best).all()
    seen.clear()
    values = list(np.linspace(0.0, 0.1, 30))
    steps: list[float] = []
    with running(progress=steps.append):
        search_at_each(label, GraspModel(), values)
    assert len(seen) == MAX_SEARCHES
    assert (seen[0], seen[-1]) == (values[0], values[-1])
    assert steps == pytest.approx(np.arange(1, 11) / 10.0)
