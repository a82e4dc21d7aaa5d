"""`grasp3d design`: sections IV-A and IV-B in tables."""

import math
import re
from pathlib import Path

import pytest

from grasp3d.contact.contacts import effective_friction
from grasp3d.contact.sensor import Sensor, required_counts
from tests.helpers.commands import printed


def design(*arguments: object) -> tuple[dict[str, str], list[list[str]]]:
    """Values by the words in the left column, and rows of the table that start with a number."""
    lines = printed("design", *map(str, arguments), cwd=Path(), columns=80).splitlines()
    pairs = (re.split(r"  +", line.strip(), maxsplit=1) for line in lines)
    rows = [line.split() for line in lines if re.match(r" *\d\S*  ", line)]
    return {pair[0]: pair[1].strip() for pair in pairs if len(pair) == 2}, rows


def test_without_options_it_prints_the_numbers_of_the_paper() -> None:
    facts, rows = design()
    assert facts["fingertip"] == "radius 10 mm"
    assert [float(row[0]) for row in rows] == [step / 10.0 for step in range(1, 11)]
    assert ["0.5", "9.273", "53.13°", "10", "10"] in rows
    assert ["0.2", "3.948", "22.62°", "52", "52"] in rows
    for words, radius, given in (((), 10.0, rows), (("--fingertip-radius", "0.6cm"), 6.0, None)):
        for row in given or design(*words, "--friction", 0.3, 0.7)[1]:
            sensor = Sensor.limiting(float(row[0]), radius)
            assert float(row[1]) == pytest.approx(sensor.receptive_field, abs=0.006)
            assert row[2] == f"{math.degrees(sensor.resolution):.2f}°"
            assert row[3:] == [str(sensor.sensors_by_discs), str(sensor.sensors_by_caps)]


def test_a_sensor_requires_friction_and_is_compared_with_some() -> None:
    words = ("--receptive-field", "4mm", "--friction", 0.2, 0.5, "--joints", 2)
    facts, rows = design(*words)
    assert (
        facts.items()
        >= {
            "fingertip": "radius 10 mm",
            "receptive field": "4 mm",
            "sensor resolution": f"{math.degrees(0.4):.2f}°",
            "location uncertainty": "within 2 mm",
            "sensors on the hemisphere": "at least 50 (discs), 51 (caps)",
            "required friction": f"above {math.tan(0.2):.4g}",
        }.items()
    )
    for row, friction in zip(rows, (0.2, 0.5), strict=True):
        margin = math.atan(friction) - 0.2
        assert float(row[0]) == friction
        assert row[1:3] == ["yes" if margin > 0.0 else "no", f"{math.degrees(margin):.2f}°"]
        assert float(row[3]) == pytest.approx(float(effective_friction(friction, 0.4)), rel=1e-3)
        assert row[4] == str(required_counts(2, friction, 0.4)).lower()
    assert design("--sensor-resolution", "0.4rad", *words[2:]) == (facts, rows)


def test_a_sensor_with_the_limiting_resolution_is_not_fine_enough() -> None:
    resolution = math.degrees(2.0 * math.atan(0.5))
    _, rows = design("--sensor-resolution", repr(resolution), "--friction", 0.5, 0.51, 0.499999)
    assert [row[1] for row in rows] == ["no", "yes", "no"]
    assert rows[0][2] == rows[2][2] == "0.00°"  # rounded from -0.00005
