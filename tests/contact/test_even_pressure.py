"""The torsion that evenly pressed patches resist."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from grasp3d.contact.contacts import evenly_pressed_radius


def mean_distance(inside: np.ndarray, points: np.ndarray) -> float:
    chosen = points[inside]
    return float(np.linalg.norm(chosen - chosen.mean(axis=0), axis=1).mean())


@pytest.fixture(scope="module")
def grid() -> np.ndarray:
    steps = (np.arange(1200) + 0.5) / 600.0 - 1.0
    return np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)


@pytest.mark.slow
@pytest.mark.parametrize("ratio", [1.0, 0.5, 0.05])
def test_an_evenly_pressed_ellipse_resists_its_mean_distance(
    grid: np.ndarray, ratio: float
) -> None:
    found = evenly_pressed_radius(np.array([1.0, ratio]), np.array(math.pi * ratio))
    points = grid * [1.0, ratio]
    inside = (grid**2).sum(axis=1) < 1.0
    assert found == pytest.approx(mean_distance(inside, points), rel=2e-3)


@pytest.mark.slow
@pytest.mark.parametrize("ratio", [1.0, 0.4, 0.02, 1e-3])
def test_a_rectangle_resists_a_little_more_than_stated(grid: np.ndarray, ratio: float) -> None:
    found = evenly_pressed_radius(np.array([ratio, 1.0]), np.array(4.0 * ratio))
    exact = mean_distance(np.ones(len(grid), dtype=bool), grid * [ratio, 1.0])
    assert 0.95 * exact < found < exact


@given(st.floats(1e-3, 1.0), st.floats(1e-3, 2.0))
def test_no_patch_resists_less_than_a_disc_of_its_area(ratio: float, area: float) -> None:
    found = evenly_pressed_radius(np.array([1.0, ratio]), np.array(area))
    assert found >= 2.0 / 3.0 * math.sqrt(area / math.pi) * (1.0 - 1e-12)


def test_points_and_lines_are_patches_too() -> None:
    extents = np.array([[0.0, 0.0], [0.0, 3.0], [2.0, 1e-15]])
    found = evenly_pressed_radius(extents, np.array([0.0, 1e-20, 1e-15]))
    assert found.tolist() == [0.0, 1.5, 1.0]
