import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from grasp3d.validating.perturbing.perturb import (
    MOST_UNCONFIRMED,
    _rounded_up,
    error_to_enter,
    least_error,
)

COUNT = st.integers(1, 40)


def failing(margin: np.ndarray, confirmed: np.ndarray, areas: np.ndarray, error: float) -> float:
    """Area fraction of what is S with an error that is not confirmed; nan: nothing is S."""
    stable = margin > error
    area = areas[stable].sum()
    return float(areas[stable & ~confirmed].sum() / area) if area else math.nan


@given(st.integers(0, 2**32), COUNT, st.floats(0.0, 1.0))
def test_it_is_the_least_error_that_passes(seed: int, count: int, part: float) -> None:
    random = np.random.default_rng(seed)
    margin = np.round(random.normal(0.2, 0.3, count), 2)  # with equal ones
    confirmed, areas = (
        random.random(count) < part,
        random.random(count) * (random.random(count) > 0.2),
    )
    least = least_error(margin, confirmed, areas)
    tried = [0.0, *margin[margin > 0.0]]
    passing = [e for e in tried if failing(margin, confirmed, areas, e) <= MOST_UNCONFIRMED]
    assert least == (min(passing) if passing else math.inf)


def test_nothing_is_needed_where_all_is_confirmed_and_nothing_helps_where_none_is() -> None:
    margin, areas = np.array([0.1, 0.2, -0.1]), np.ones(3)
    assert least_error(margin, np.ones(3, bool), areas) == 0.0
    assert least_error(margin, np.zeros(3, bool), areas) == math.inf
    assert least_error(-margin[:2], np.ones(2, bool), areas[:2]) == math.inf


@given(st.floats(1e-9, 1e9))
def test_numbers_are_rounded_up_to_two_digits(number: float) -> None:
    rounded = _rounded_up(number)
    assert number * (1.0 - 1e-9) <= rounded <= 1.1 * number
    assert float(f"{rounded:.2g}") == pytest.approx(rounded)


def test_zero_and_infinity_stay() -> None:
    assert (_rounded_up(0.0), _rounded_up(math.inf)) == (0.0, math.inf)


def test_the_larger_error_is_entered_unless_it_leaves_too_little() -> None:
    margin, areas = np.array([0.1, 0.2, 0.3, 0.4]), np.ones(4)
    assert error_to_enter(margin, 0.0, 0.15, areas) == 0.15
    assert error_to_enter(margin, 0.25, 0.15, areas) == 0.25  # two of three remain
    assert error_to_enter(margin, 0.35, 0.15, areas) == 0.15  # one of three would
    assert error_to_enter(margin, math.inf, 0.15, areas) == 0.15
    assert error_to_enter(margin, math.inf, 0.5, areas) == 0.5
