"""Rates and their intervals."""

import math

import numpy as np
import pytest

from grasp3d.physics import SuccessRate
from grasp3d.physics.simulation import rates_by, success_rate


@pytest.mark.parametrize(("count", "successes"), [(20, 20), (60, 57), (7, 0), (1, 1)])
def test_intervals_are_those_of_wilson(count: int, successes: int) -> None:
    rate, z = successes / count, 1.959963984540054
    middle = (rate + z * z / (2 * count)) / (1 + z * z / count)
    half = z * math.sqrt(rate * (1 - rate) / count + (z / (2 * count)) ** 2) / (1 + z * z / count)
    found = SuccessRate("", count, successes)
    assert (found.low, found.high) == pytest.approx((middle - half, middle + half), abs=1e-9)


def test_no_grasps_have_no_rate() -> None:
    empty = success_rate("S", np.zeros(0, dtype=bool))
    assert math.isnan(empty.rate)
    assert (empty.low, empty.high) == (0.0, 1.0)


def test_bins_hold_every_grasp_once() -> None:
    values, success = np.array([-5.0, 0.0, 3.0, 9.0]), np.array([False, True, False, True])
    found = list(rates_by(values, success, [-math.inf, 0.0, 5.0, math.inf]))
    assert [(one.name, one.count, one.successes) for one in found] == [
        ("below 0", 1, 0),
        ("0 to 5", 2, 1),
        ("from 5", 1, 1),
    ]
