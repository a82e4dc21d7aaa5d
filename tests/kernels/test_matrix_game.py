import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import linprog

from grasp3d._kernels.hull.frictionless_closure import make_game, solve_game

few = settings(max_examples=100, deadline=None)


def solved(matrix: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
    """Bound, weights and prices, in arrays larger than the game."""
    rows, columns = matrix.shape
    game = make_game(rows + 2, columns + 1)
    game.matrix[...] = np.nan
    game.matrix[:rows, :columns] = matrix
    bound = solve_game(game, rows, columns)
    return bound, game.weights[:columns], game.prices[:rows]


def value(matrix: np.ndarray) -> float:
    """Value of the game by a linear program: min t with matrix @ x <= t."""
    rows, columns = matrix.shape
    result = linprog(
        np.append(np.zeros(columns), 1.0),
        A_ub=np.column_stack([matrix, -np.ones(rows)]),
        b_ub=np.zeros(rows),
        A_eq=np.append(np.ones(columns), 0.0)[None],
        b_eq=[1.0],
        bounds=[(0.0, None)] * columns + [(None, None)],
    )
    return float(result.fun)


@pytest.mark.slow
@given(
    st.integers(0, 100_000), st.integers(1, 14), st.integers(1, 6), st.sampled_from([1e-9, 1, 1e6])
)
@few
def test_the_solution_is_that_of_a_linear_program(
    seed: int, rows: int, columns: int, scale: float
) -> None:
    matrix = scale * np.random.default_rng(seed).normal(size=(rows, columns))
    bound, weights, prices = solved(matrix)
    expected = pytest.approx(scale * value(matrix / scale), abs=1e-8 * scale)
    assert bound == expected
    assert (matrix @ weights).max() == expected
    for mixture in (weights, prices):
        assert mixture.min() >= 0.0
        assert mixture.sum() == pytest.approx(1.0)


@pytest.mark.slow
@given(st.integers(0, 100_000), st.integers(1, 10), st.integers(1, 6))
@few
def test_games_with_equal_entries(seed: int, rows: int, columns: int) -> None:
    """Ties of all kinds: whole numbers, equal rows and columns, all entries equal."""
    matrix = np.random.default_rng(seed).integers(-1, 2, size=(rows, columns)).astype(float)
    for tied in (matrix, np.repeat(matrix, 2, axis=0), 0.0 * matrix, 0.0 * matrix - 3.0):
        bound, weights, _ = solved(tied)
        assert bound == pytest.approx(value(tied), abs=1e-9)
        assert (tied @ weights).max() == pytest.approx(bound, abs=1e-9)


@pytest.mark.slow
def test_a_known_game() -> None:
    bound, weights, prices = solved(np.array([[1.0, -1.0], [-1.0, 1.0]]))
    assert bound == pytest.approx(0.0, abs=1e-15)
    np.testing.assert_allclose(weights, 0.5)
    np.testing.assert_allclose(prices, 0.5)
