import math

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from grasp3d._kernels.hull.pair_epsilon import Arrow, largest_on_cap, value_at

SEEDS = st.integers(0, 2**32)
COSINES = st.floats(0.05, 0.9999)


def drawn(seed: int) -> tuple[Arrow, np.ndarray, np.ndarray, np.ndarray]:
    """P as an arrow and as a matrix, q and n; entries and slopes of very different size."""
    rng = np.random.default_rng(seed)
    corner, one, two = rng.uniform(0.0, 1.0, 3) * 10.0 ** rng.uniform(-3, 3, 3)
    arms = rng.uniform(-1.0, 1.0, 2) * np.sqrt(corner * np.array([one, two]) / 2.0)
    arms *= rng.random(2) < 0.8
    slope = rng.normal(size=3) * 10.0 ** rng.uniform(-3, 3) * (rng.random(3) < 0.8)
    normal = rng.normal(size=3)
    matrix = np.array([[corner, *arms], [arms[0], one, 0.0], [arms[1], 0.0, two]])
    return Arrow(corner, *arms, one, two), matrix, slope, normal / np.linalg.norm(normal)


def points_of_cap(normal: np.ndarray, cosine: float, count: int = 60) -> np.ndarray:
    """A grid of unit vectors of a cap, its middle and rim included."""
    first = np.linalg.svd(normal[None])[2][1]
    second = np.cross(normal, first)
    angles = np.linspace(0.0, math.acos(cosine), count)[:, None, None]
    around = np.linspace(0.0, 2.0 * math.pi, 3 * count)[:, None]
    across = np.cos(around) * first + np.sin(around) * second
    return np.asarray((np.cos(angles) * normal + np.sin(angles) * across).reshape(-1, 3))


@pytest.mark.slow
@given(SEEDS, COSINES, st.floats(0.0, 10.0))
@example(0, 0.5, 0.0)
@settings(deadline=None)
def test_no_point_of_the_cap_exceeds_the_bound(seed: int, cosine: float, start: float) -> None:
    arrow, matrix, slope, normal = drawn(seed)
    points = points_of_cap(normal, cosine)
    values = np.einsum("ki,ij,kj->k", points, matrix, points) + 2.0 * points @ slope
    size = np.abs(matrix).max() + np.abs(slope).max()
    for enough in (-math.inf, float(values.max())):
        bound, _, found = largest_on_cap(
            arrow, tuple(slope), tuple(normal), cosine, start * size, enough
        )
        g = np.array(found)
        assert bound >= values.max() - 1e-9 * size
        assert abs(np.linalg.norm(g) - 1.0) < 1e-9
        assert g @ normal >= cosine - 1e-9
        value = value_at(arrow, tuple(slope), found)
        assert abs(value - (g @ matrix @ g + 2.0 * g @ slope)) <= 1e-12 * size
        assert value <= bound + 1e-9 * size


@pytest.mark.slow
def test_the_bound_is_mostly_attained() -> None:
    attained = 0
    for seed in range(300):
        arrow, matrix, slope, normal = drawn(seed)
        bound, _, found = largest_on_cap(arrow, tuple(slope), tuple(normal), 0.8, 0.0, -math.inf)
        size = np.abs(matrix).max() + np.abs(slope).max()
        attained += bound - value_at(arrow, tuple(slope), found) < 1e-6 * size
    assert attained > 240
