"""`grasp3d design`: mostly in this process, once in a process of its own."""

import math
import re
import subprocess
from pathlib import Path

import pytest

from grasp3d.contact.contacts import effective_friction
from grasp3d.contact.sensor import Sensor, required_counts
from tests.helpers.commands import run_here


def design(*arguments: object, columns: int = 80) -> subprocess.CompletedProcess[str]:
    return run_here("design", *map(str, arguments), cwd=Path(), columns=columns)


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


def test_without_options_it_prints_the_numbers_of_the_paper() -> None:
    text = printed()
    assert facts(text)["fingertip"] == "radius 10 mm"
    table = rows(text)
    assert [float(row[0]) for row in table] == [step / 10.0 for step in range(1, 11)]
    assert ["0.5", "9.273", "53.13°", "10", "10"] in table
    assert ["0.2", "3.948", "22.62°", "52", "52"] in table
    for row in table:
        sensor = Sensor.limiting(float(row[0]), 10.0)
        assert float(row[1]) == pytest.approx(sensor.receptive_field, abs=0.006)
        assert row[3:] == [str(sensor.sensors_by_discs), str(sensor.sensors_by_caps)]
    assert "lower bounds" in text


def test_required_sensors_for_some_frictions() -> None:
    text = printed("--fingertip-radius", "6mm", "--friction", 0.3, 0.7)
    expected = [Sensor.limiting(friction, 6.0) for friction in (0.3, 0.7)]
    for row, sensor in zip(rows(text), expected, strict=True):
        assert float(row[1]) == pytest.approx(sensor.receptive_field, rel=1e-3)
        assert row[2] == f"{math.degrees(sensor.resolution):.2f}°"
        assert row[3:] == [str(sensor.sensors_by_discs), str(sensor.sensors_by_caps)]


def test_required_friction_for_a_sensor() -> None:
    text = printed("--fingertip-radius", "10mm", "--receptive-field", "4mm")
    assert facts(text) | {
        "fingertip": "radius 10 mm",
        "receptive field": "4 mm",
        "sensor resolution": f"{math.degrees(0.4):.2f}°",
        "location uncertainty": "within 2 mm",
        "sensors on the hemisphere": "at least 50 (discs), 51 (caps)",
        "required friction": f"above {math.tan(0.2):.4g}",
    } == facts(text)
    assert rows(text) == []


def test_the_resolution_can_be_given_in_degrees_instead() -> None:
    given = facts(printed("--sensor-resolution", 22.6, "--fingertip-radius", "10mm"))
    assert given["sensor resolution"] == "22.60°"
    assert given["receptive field"] == f"{10.0 * math.radians(22.6):.4g} mm"
    assert given["required friction"] == f"above {math.tan(math.radians(11.3)):.4g}"
    by_field = printed(
        "--receptive-field", f"{10.0 * math.radians(22.6)}mm", "--fingertip-radius", "10mm"
    )
    assert facts(by_field) == given


def test_a_sensor_is_compared_with_frictions() -> None:
    text = printed("--receptive-field", "4mm", "--friction", 0.2, 0.5, "--joints", 2)
    sensor = Sensor(4.0, 10.0)
    for row, friction in zip(rows(text), (0.2, 0.5), strict=True):
        margin = math.atan(friction) - sensor.tilt
        assert float(row[0]) == friction
        assert row[1] == ("yes" if margin > 0.0 else "no")
        assert row[2] == f"{math.degrees(margin):.2f}°"
        effective = float(effective_friction(friction, sensor.resolution))
        assert float(row[3]) == pytest.approx(effective, rel=1e-3)
        assert row[4] == str(required_counts(2, friction, sensor.resolution)).lower()


def test_a_sensor_with_the_limiting_resolution_is_not_fine_enough() -> None:
    resolution = math.degrees(2.0 * math.atan(0.5))
    text = printed("--sensor-resolution", repr(resolution), "--friction", 0.5, 0.51, 0.499999)
    assert [row[1] for row in rows(text)] == ["no", "yes", "no"]
    assert rows(text)[0][2] == rows(text)[2][2] == "0.00°"  # rounded from -0.00005


def test_lengths_have_units_of_their_own() -> None:
    given = ("--fingertip-radius", "0.8cm", "--receptive-field", "3mm")
    assert printed(*given) == printed("--fingertip-radius", "8mm", "--receptive-field", "0.3cm")
    assert "fingertip_radius needs its unit, such as 8mm" in design("--fingertip-radius", 8).stderr
    error = design("--receptive-field", "2ft").stderr
    assert "must be a length: a number, or a number with a unit (m, cm, mm, in)" in " ".join(
        error.replace("│", " ").split()
    )
    assert "mesh" not in error
