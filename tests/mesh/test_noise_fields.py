import math

import numpy as np
import pytest

from grasp3d.mesh.noise import SIDES, random_field

FIELDS = 4000


def fields(points: np.ndarray, normals: np.ndarray, correlation: float) -> np.ndarray:
    """Many fields at the same points, (FIELDS, n)."""
    random = np.random.default_rng(3)
    return np.stack([random_field(points, normals, correlation, random) for _ in range(FIELDS)])


@pytest.mark.parametrize("correlation", [0.0, 1.0])
def test_every_value_is_gaussian_with_unit_deviation(correlation: float) -> None:
    values = fields(np.zeros((1, 3)), np.array([[0.0, 0.0, 1.0]]), correlation).ravel()
    assert values.mean() == pytest.approx(0.0, abs=0.06)
    assert values.std() == pytest.approx(1.0, abs=0.04)
    assert (np.abs(values) < 1.0).mean() == pytest.approx(math.erf(math.sqrt(0.5)), abs=0.03)


@pytest.mark.slow
@pytest.mark.parametrize("distance", [0.0, 0.5, 1.0, 2.0, 4.0])
@pytest.mark.parametrize("turn", [0.0, 0.5, math.pi])
def test_neighbours_have_the_stated_correlation(distance: float, turn: float) -> None:
    points = np.array([[1.0, 2.0, 3.0], [1.0 + 0.2 * distance, 2.0, 3.0]])
    normals = np.array([[0.0, 0.0, 1.0], [math.sin(turn), 0.0, math.cos(turn)]])
    one, two = fields(points, normals, 0.2).T
    apart = 2.0 * math.sin(turn / 2.0)
    expected = math.exp(-(distance**2) / 2.0 - apart**2 / (2.0 * SIDES**2))
    assert np.mean(one * two) == pytest.approx(expected, abs=0.06)


def test_white_noise_has_no_neighbours() -> None:
    points, normals = np.zeros((2, 3)), np.tile([0.0, 0.0, 1.0], (2, 1))
    one, two = fields(points, normals, 0.0).T
    assert np.mean(one * two) == pytest.approx(0.0, abs=0.06)


@pytest.mark.slow
def test_the_same_seed_gives_the_same_field_at_any_number_of_points() -> None:
    random = np.random.default_rng(0)
    points = random.normal(size=(40_000, 3))
    normals = np.tile([0.0, 0.0, 1.0], (40_000, 1))
    every = random_field(points, normals, 0.5, np.random.default_rng(5))
    few = random_field(points[20_000:20_010], normals[:10], 0.5, np.random.default_rng(5))
    np.testing.assert_allclose(every[20_000:20_010], few, atol=1e-12)
