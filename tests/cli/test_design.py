"""`grasp3d design`: mostly in this process, once in a process of its own."""

import math
import re
import subprocess
from pathlib import Path

import pytest

from grasp3d.contact.friction_cones import effective_friction
from grasp3d.contact.sensor import Sensor
from tests.helpers.commands import run_here, run_process


def design(*arguments: object, columns: int = 80) -> subprocess.CompletedProcess[str]:
    return run_here("design", *map(str, arguments), cwd=Path(), columns=columns)


def real_design(*arguments: object) -> subprocess.CompletedProcess[str]:
    return run_process("design", *map(str, arguments), cwd=Path(), columns=80)


def printed(*arguments: object, columns: int = 80) -> str:
    run = design(*arguments, columns=columns)
    assert (run.returncode, run.stderr) == (0, "")
    return run.stdout


def rows(text: str) -> list[list[str]]:
    """Words of the lines that start with a number: the rows of the tables."""
    return [line.split() for line in text.splitlines() if re.match(r" *\d\S*  ", line)]


def facts(text: str) -> dict[str, str]:
    """Values of the table of a sensor, by the words in its left column."""
    pairs = (re.split(r"  +", line.strip(), maxsplit=1) for line in text.splitlines())
    return {pair[0]: pair[1].strip() for pair in pairs if len(pair) == 2}


@pytest.mark.slow
def test_the_command_prints_the_same_in_its_own_process() -> None:
    for words in ((), ("--friction", "0")):
        real, here = real_design(*words), design(*words)
        assert (real.returncode, real.stdout) == (here.returncode, here.stdout)
        assert real.stderr == here.stderr
    assert "--receptive-field" in real_design("--help").stdout


def test_without_options_it_prints_the_numbers_of_the_paper() -> None:
    text = printed()
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
    assert "give --object-size or --object to include it" in " ".join(text.split())


def test_required_sensors_for_some_frictions_on_an_object() -> None:
    text = printed("--fingertip-radius", 6, "--friction", 0.3, 0.7, "--object-size", 25)
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
    assert "Wan & Howe report" not in text
    assert "--object-size" not in text


def test_required_friction_for_a_sensor() -> None:
    text = printed("--fingertip-radius", 10, "--receptive-field", 4, "--object-size", 30)
    sensor = Sensor(4.0, 10.0)
    assert facts(text) | {
        "fingertip": "radius 10 mm, curvature 0.1 per mm",
        "receptive field": "4 mm",
        "sensor resolution": f"{math.degrees(0.4):.2f}°",
        "location uncertainty": "within 2 mm",
        "sensors on the hemisphere": "at least 50 (discs), 51 (caps)",
        "required friction": f"above {math.tan(0.2):.4g}",
        "their line tilts by up to": f"{math.degrees(sensor.line_error(30.0)):.2f}°",
        "required friction with this": f"above {sensor.required_friction_at(30.0):.4g}",
    } == facts(text)
    assert "warning: the location uncertainty, 6.67 % of" in text
    assert "warning" not in printed("--receptive-field", 4, "--object-size", 50)
    assert rows(text) == []


def test_the_resolution_can_be_given_in_degrees_instead() -> None:
    given = facts(printed("--sensor-resolution", 22.6, "--fingertip-radius", 10))
    assert given["sensor resolution"] == "22.60°"
    assert given["receptive field"] == f"{10.0 * math.radians(22.6):.4g} mm"
    assert given["required friction"] == f"above {math.tan(math.radians(11.3)):.4g}"
    by_field = printed("--receptive-field", 10.0 * math.radians(22.6), "--fingertip-radius", 10)
    assert facts(by_field) == given


def test_a_sensor_is_compared_with_frictions() -> None:
    text = printed("--receptive-field", 4, "--friction", 0.2, 0.5, "--object-size", 18)
    sensor, found = Sensor(4.0, 10.0), iter(rows(text))
    for opening in (math.inf, 18.0):
        for friction in (0.2, 0.5):
            row, tilt = next(found), sensor.misalignment(opening)
            margin = math.atan(friction) - tilt
            assert float(row[0]) == friction
            assert row[1] == ("yes" if margin > 0.0 else "no")
            assert row[2] == f"{math.degrees(margin):.2f}°"
            assert float(row[3]) == pytest.approx(
                float(effective_friction(friction, 2.0 * tilt)), rel=1e-3
            )
    assert next(found, None) is None


def test_a_sensor_with_the_limiting_resolution_is_not_fine_enough() -> None:
    resolution = math.degrees(2.0 * math.atan(0.5))
    text = printed("--sensor-resolution", repr(resolution), "--friction", 0.5, 0.51, 0.499999)
    assert [row[1] for row in rows(text)] == ["no", "yes", "no"]
    assert rows(text)[0][2] == rows(text)[2][2] == "0.00°"  # rounded from -0.00005


@pytest.mark.parametrize("tip", [("--flat",), ("--fingertip-radius", "inf")], ids=str)
def test_a_flat_fingertip_has_uncertain_locations_only(tip: tuple[object, ...]) -> None:
    sensor = printed(*tip, "--receptive-field", 4, "--object-size", 30)
    values = facts(sensor)
    assert values["fingertip"] == "flat"
    assert values["sensor resolution"] == "0°: its normal is the same everywhere"
    assert (values["required friction"], values["required friction with this"]) == (
        "above 0",
        "above 0.1333",
    )
    assert "hemisphere" not in sensor
    limits = printed(*tip, "--friction", 0.3, "--object-size", 30)
    assert rows(limits) == [["0.3", "9.000"]]
    assert "normals only" not in limits


def test_no_friction_can_be_sufficient() -> None:
    text = printed("--receptive-field", 31, "--object-size", 20, "--friction", 5)
    assert facts(text)["required friction with this"] == "none is sufficient"
    assert "no friction compensates" in " ".join(text.split())
    assert rows(text)[1][1] == "no"


def test_lengths_have_units_of_their_own() -> None:
    given = ("--fingertip-radius", "0.8cm", "--receptive-field", "3mm", "--object-size", "2in")
    plain = ("--fingertip-radius", 8, "--receptive-field", 3, "--object-size", 50.8)
    assert printed(*given) == printed(*plain)
    assert facts(printed(*given, "--print-unit", "cm"))["receptive field"] == "0.3 cm"
    error = design("--object-size", "2ft").stderr
    assert "must be a length: a number, or a number with a unit (m, cm, mm, in)" in " ".join(
        error.replace("│", " ").split()
    )
    assert "mesh" not in error


@pytest.mark.parametrize(("unit", "radius"), [("cm", "1 cm"), ("m", "0.01 m"), ("in", "0.3937 in")])
def test_the_default_fingertip_is_the_same_in_every_unit(unit: str, radius: str) -> None:
    text = printed("--print-unit", unit, "--friction", 0.2)
    assert f"fingertip: radius {radius}" in text
    assert f"below, {unit} " in text
    assert rows(text)[0][2:] == ["22.62°", "52", "52"]


def test_receptive_fields_too_small_to_count_are_printed_as_infinite() -> None:
    text = printed("--receptive-field", 1e-200)
    assert facts(text)["sensors on the hemisphere"] == "at least inf (discs), inf (caps)"


CASES: list[tuple[object, ...]] = [
    (),
    ("--friction", 0.5, "--object-size", 50),
    ("--receptive-field", 4, "--friction", 0.2, 0.5, "--object-size", 30),
    ("--flat", "--receptive-field", 4),
]


@pytest.mark.slow
@pytest.mark.parametrize("columns", [80, 60, 40])
@pytest.mark.parametrize("arguments", CASES, ids=str)
def test_nothing_is_truncated_in_a_narrow_terminal(
    arguments: tuple[object, ...], columns: int
) -> None:
    narrow, wide = printed(*arguments, columns=columns), printed(*arguments, columns=200)
    assert max(map(len, narrow.splitlines())) <= columns
    assert "…" not in narrow
    assert sorted("".join(narrow.split())) == sorted("".join(wide.split()))
