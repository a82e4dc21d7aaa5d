"""`grasp3d design`: once in a process of its own, else through the command's own door."""

import io
import math
import os
import re
import subprocess
import sys
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path
from unittest import mock

import pytest

from grasp3d.cli import main
from grasp3d.contact.friction_cones import effective_friction
from grasp3d.contact.sensor import Sensor

COMMAND = Path(sys.executable).with_name("grasp3d")


def design(*arguments: object, columns: int = 80) -> subprocess.CompletedProcess[str]:
    """Run the command in this process; a new one for each would cost a second."""
    out, err, words = io.StringIO(), io.StringIO(), ["design", *map(str, arguments)]
    environment = mock.patch.dict(os.environ, COLUMNS=str(columns))
    with environment, redirect_stdout(out), redirect_stderr(err):
        try:
            code = main(words)
        except SystemExit as ended:  # help, and errors of usage
            code = int(ended.code or 0)
    return subprocess.CompletedProcess(words, code, out.getvalue(), err.getvalue())


def real_design(*arguments: object, columns: int = 80) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [str(COMMAND), "design", *map(str, arguments)],
        check=False,
        capture_output=True,
        text=True,
        env={**os.environ, "COLUMNS": str(columns)},
    )


def told(*arguments: object, columns: int = 80) -> str:
    run = design(*arguments, columns=columns)
    assert (run.returncode, run.stderr) == (0, "")
    return run.stdout


def rows(text: str) -> list[list[str]]:
    """The lines that begin with a number: those of the tables, in their order."""
    return [line.split() for line in text.splitlines() if re.match(r" *\d\S*  ", line)]


def facts(text: str) -> dict[str, str]:
    """What the table of a sensor says, by its left column."""
    pairs = (re.split(r"  +", line.strip(), maxsplit=1) for line in text.splitlines())
    return {pair[0]: pair[1].strip() for pair in pairs if len(pair) == 2}


def test_the_real_command_says_the_same() -> None:
    for words in ((), ("--friction", "0")):
        real, here = real_design(*words), design(*words)
        assert (real.returncode, real.stdout) == (here.returncode, here.stdout)
        assert real.stderr == here.stderr
    assert "--receptive-field" in real_design("--help").stdout


def test_with_nothing_given_it_tells_the_numbers_of_the_paper() -> None:
    text = told()
    assert "fingertip: radius 10 mm, curvature 0.1 per mm" in text
    table = rows(text)
    assert [float(row[0]) for row in table] == [step / 10.0 for step in range(1, 11)]
    assert ["0.5", "9.273", "53.13°", "10", "10"] in table
    assert ["0.2", "3.948", "22.62°", "52", "52"] in table
    for row in table:
        sensor = Sensor.limiting(float(row[0]), 10.0)
        assert float(row[1]) == pytest.approx(sensor.receptive_field, abs=0.006)
        assert row[3:] == [str(sensor.sensors_by_discs), str(sensor.sensors_by_caps)]
    assert "their 50 comes from rounding 3.95 mm" in " ".join(text.split())
    assert "lower bounds" in text
    assert "give --object-size to count them" in text


def test_which_sensor_is_enough_for_some_frictions_on_an_object() -> None:
    text = told("--fingertip-radius", 6, "--friction", 0.3, 0.7, "--object-size", 25)
    expected = [
        Sensor.limiting(friction, 6.0, opening=opening)
        for opening in (math.inf, 25.0)
        for friction in (0.3, 0.7)
    ]
    for row, sensor in zip(rows(text), expected, strict=True):
        assert float(row[1]) == pytest.approx(sensor.receptive_field, rel=1e-3)
        assert row[2] == f"{math.degrees(sensor.resolution):.2f}°"
        assert row[3:] == [str(sensor.sensors_by_discs), str(sensor.sensors_by_caps)]
    assert "two fingers 25 mm apart" in text
    assert "Wan & Howe give" not in text
    assert "--object-size" not in text


def test_which_friction_is_enough_for_a_sensor() -> None:
    text = told("--fingertip-radius", 10, "--receptive-field", 4, "--object-size", 30)
    sensor = Sensor(4.0, 10.0)
    assert facts(text) | {
        "fingertip": "radius 10 mm, curvature 0.1 per mm",
        "receptive field": "4 mm",
        "sensor resolution": f"{math.degrees(0.4):.2f}°",
        "location uncertainty": "± 2 mm",
        "sensors on the hemisphere": "at least 50 (discs), 51 (caps)",
        "friction needed": f"above {math.tan(0.2):.4g}",
        "their line turns by up to": f"{math.degrees(sensor.line_error(30.0)):.2f}°",
        "friction needed with that": f"above {sensor.required_friction_at(30.0):.4g}",
    } == facts(text)
    assert "warning: the location uncertainty, 6.67 % of" in text
    assert "warning" not in told("--receptive-field", 4, "--object-size", 50)
    assert rows(text) == []


def test_the_resolution_may_be_given_in_degrees_instead() -> None:
    given = facts(told("--sensor-resolution", 22.6, "--fingertip-radius", 10))
    assert given["sensor resolution"] == "22.60°"
    assert given["receptive field"] == f"{10.0 * math.radians(22.6):.4g} mm"
    assert given["friction needed"] == f"above {math.tan(math.radians(11.3)):.4g}"
    by_field = told("--receptive-field", 10.0 * math.radians(22.6), "--curvature", 0.1)
    assert facts(by_field) == given


def test_whether_a_sensor_is_enough_for_a_friction_and_what_it_leaves() -> None:
    text = told("--receptive-field", 4, "--friction", 0.2, 0.5, "--object-size", 18)
    sensor, verdicts = Sensor(4.0, 10.0), iter(rows(text))
    for opening in (math.inf, 18.0):
        for friction in (0.2, 0.5):
            row, worst = next(verdicts), sensor.misalignment(opening)
            margin = math.atan(friction) - worst
            assert float(row[0]) == friction
            assert row[1] == ("yes" if margin > 0.0 else "no")
            assert row[2] == f"{math.degrees(margin):.2f}°"
            assert float(row[3]) == pytest.approx(
                float(effective_friction(friction, 2.0 * worst)), rel=1e-3
            )
    assert next(verdicts, None) is None


def test_at_the_bound_itself_a_sensor_is_not_fine_enough() -> None:
    resolution = math.degrees(2.0 * math.atan(0.5))
    text = told("--sensor-resolution", repr(resolution), "--friction", 0.5, 0.51, 0.499999)
    assert [row[1] for row in rows(text)] == ["no", "yes", "no"]
    assert rows(text)[0][2] == rows(text)[2][2] == "0.00°"  # rounded from -0.00005


@pytest.mark.parametrize(
    "tip", [("--flat",), ("--curvature", 0), ("--fingertip-radius", "inf")], ids=str
)
def test_a_flat_fingertip_pays_by_its_location_alone(tip: tuple[object, ...]) -> None:
    sensor = told(*tip, "--receptive-field", 4, "--object-size", 30)
    said = facts(sensor)
    assert (said["fingertip"], said["sensor resolution"]) == ("flat", "0.00°")
    assert (said["friction needed"], said["friction needed with that"]) == (
        "above 0",
        "above 0.1333",
    )
    assert "hemisphere" not in sensor
    limits = told(*tip, "--friction", 0.3, "--object-size", 30)
    assert rows(limits) == [["0.3", "9.000"]]
    assert "normals alone" not in limits


def test_where_no_friction_is_enough_it_says_so() -> None:
    text = told("--receptive-field", 31, "--object-size", 20, "--friction", 5)
    assert facts(text)["friction needed with that"] == "none is enough"
    assert "no friction can bear" in " ".join(text.split())
    assert rows(text)[1][1] == "no"


@pytest.mark.parametrize(("unit", "radius"), [("cm", "1 cm"), ("m", "0.01 m"), ("in", "0.3937 in")])
def test_the_usual_fingertip_is_the_same_in_every_unit(unit: str, radius: str) -> None:
    text = told("--unit", unit, "--friction", 0.2)
    assert f"fingertip: radius {radius}" in text
    assert f"below, {unit} " in text
    assert rows(text)[0][2:] == ["22.62°", "52", "52"]


def test_fields_beyond_all_counting_are_still_told() -> None:
    text = told("--receptive-field", 1e-200)
    assert facts(text)["sensors on the hemisphere"] == "at least inf (discs), inf (caps)"


CASES: list[tuple[object, ...]] = [
    (),
    ("--friction", 0.5, "--object-size", 50),
    ("--receptive-field", 4, "--friction", 0.2, 0.5, "--object-size", 30),
    ("--flat", "--receptive-field", 4),
]


@pytest.mark.parametrize("columns", [80, 60, 40])
@pytest.mark.parametrize("arguments", CASES, ids=str)
def test_nothing_is_cut_off_in_a_narrow_window(arguments: tuple[object, ...], columns: int) -> None:
    narrow, wide = told(*arguments, columns=columns), told(*arguments, columns=200)
    assert max(map(len, narrow.splitlines())) <= columns
    assert "…" not in narrow
    assert sorted("".join(narrow.split())) == sorted("".join(wide.split()))


BAD: dict[str, tuple[list[str], str]] = {
    "two tips": (["--fingertip-radius", "10", "--flat"], "--fingertip-radius and --flat each say"),
    "tip and curvature": (["--fingertip-radius", "10", "--curvature", "0.1"], "give one"),
    "three tips": (
        ["--fingertip-radius", "10", "--curvature", "0.1", "--flat"],
        "--fingertip-radius and --curvature and --flat",
    ),
    "two sensors": (["--receptive-field", "4", "--sensor-resolution", "20"], "each say what the"),
    "flat resolution": (["--flat", "--sensor-resolution", "20"], "a flat fingertip has the same"),
    "flat limit": (["--flat", "--friction", "0.5"], "--object-size"),
    "only flat": (["--flat"], "--object-size"),
    "field": (["--receptive-field", "0"], "receptive field must be a finite length above 0"),
    "long field": (["--receptive-field", "32"], "pi x 10 = 31.42; got 32"),
    "radius": (["--fingertip-radius", "-1"], "fingertip radius must be above 0"),
    "no radius": (["--fingertip-radius", "nan"], "fingertip radius must be above 0"),
    "curvature": (["--curvature", "-1"], "curvature must be a finite number of at least 0"),
    "resolution": (["--sensor-resolution", "180"], "below 180 degrees"),
    "no resolution": (["--sensor-resolution", "0"], "above 0"),
    "friction": (["--friction", "0.5", "0"], "friction must be a finite number above 0; got 0"),
    "sensor, bad friction": (["--receptive-field", "4", "--friction", "-1"], "friction must be"),
    "size": (["--object-size", "0"], "object size must be a finite length above 0; got 0"),
    "endless size": (["--object-size", "inf"], "object size must be a finite length above 0"),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_settings_are_one_line_and_exit_code_2(name: str) -> None:
    arguments, message = BAD[name]
    run = design(*arguments)
    assert (run.returncode, run.stdout) == (2, "")
    assert run.stderr.startswith("grasp3d: ")
    assert message in run.stderr
    assert run.stderr.count("\n") == 1


@pytest.mark.parametrize("arguments", [("--friction", "high"), ("--unit", "km"), ("mug.stl",)])
def test_bad_usage_exits_with_2_and_points_to_the_help(arguments: tuple[str, ...]) -> None:
    run = design(*arguments)
    assert run.returncode == 2
    assert "--help" in run.stderr
    assert "Traceback" not in run.stderr


def test_help_names_the_options_and_loads_nothing_heavy() -> None:
    code = (
        "import sys, grasp3d.cli\n"
        "try: grasp3d.cli.main(['design', '--help'])\n"
        "except SystemExit: print(*sys.modules, file=sys.stderr)"
    )
    run = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
    assert not {"numpy", "rich", "trimesh", "numba", "pyvista"} & set(run.stderr.split())
    for option in ("--friction", "--receptive-field", "--curvature", "--object-size", "DEGREES"):
        assert option in run.stdout
    assert "None" not in run.stdout
