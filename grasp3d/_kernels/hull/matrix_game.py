"""Matrix games: the mixture of columns whose largest row is least, with a proof.

They are linear programs of a special form, which the simplex method solves in microseconds while
they are small; its pivots need no first phase, as some mixture always exists.
"""

from typing import NamedTuple

import numpy as np

from grasp3d._kernels.compiling.decorators import merged

PIVOTS = 200
"""Largest number of pivots of the simplex method; few games need more than 20."""

ZERO = 1e-14
"""Size below which an entry of the tableau counts as 0; those at the start are from 1 to 2."""


class Game(NamedTuple):
    """A game with its solution, and scratch for the simplex method."""

    matrix: np.ndarray
    """The game (rows, columns); it is kept."""
    weights: np.ndarray
    """Solution: weights of the columns (columns,), not negative, with the sum 1."""
    prices: np.ndarray
    """Proof: weights of the rows (rows,), not negative, with the sum 1."""
    tableau: np.ndarray
    """Scratch (rows + 1, columns + 1)."""
    basic: np.ndarray
    """Scratch (rows,): the variable of each row of the tableau, columns first."""
    free: np.ndarray
    """Scratch (columns,): the variable of each column of the tableau."""


def make_game(rows: int, columns: int) -> Game:
    """Allocate a game of up to so many rows and columns."""
    return Game(
        matrix=np.zeros((rows, columns)),
        weights=np.zeros(columns),
        prices=np.zeros(rows),
        tableau=np.zeros((rows + 1, columns + 1)),
        basic=np.zeros(rows, dtype=np.int64),
        free=np.zeros(columns, dtype=np.int64),
    )


@merged
def _start(game, rows, columns):
    """Write the tableau of max sum(x) with A x <= 1, x >= 0; A is the game, shifted and scaled."""
    matrix, tableau = game.matrix, game.tableau
    least = greatest = matrix[0, 0]
    for i in range(rows):
        for k in range(columns):
            least = min(least, matrix[i, k])
            greatest = max(greatest, matrix[i, k])
    scale = 1.0 / (greatest - least) if greatest > least else 0.0
    for i in range(rows):
        game.basic[i] = columns + i
        tableau[i, columns] = 1.0
        for k in range(columns):
            tableau[i, k] = 1.0 + scale * (matrix[i, k] - least)
    tableau[rows, columns] = 0.0
    for k in range(columns):
        game.free[k] = k
        tableau[rows, k] = 1.0


@merged
def _pivot(tableau, rows, columns, row, column):
    """Exchange the basic variable of a row with the free one of a column."""
    inverse = 1.0 / tableau[row, column]
    for k in range(columns + 1):
        tableau[row, k] *= inverse
    tableau[row, column] = inverse
    for i in range(rows + 1):
        factor = tableau[i, column]
        if i != row and factor != 0.0:
            for k in range(columns + 1):
                tableau[i, k] -= factor * tableau[row, k]
            tableau[i, column] = -factor * inverse


@merged
def _leaving_row(tableau, rows, columns, column):
    """Row whose basic variable first becomes 0 when the free one of a column grows; -1: none."""
    row, least = -1, np.inf
    for i in range(rows):
        if tableau[i, column] > ZERO:
            ratio = tableau[i, columns] / tableau[i, column]
            if ratio < least:
                row, least = i, ratio
    return row


@merged
def _maximise(game, rows, columns):
    """Pivot while the sum grows."""
    tableau = game.tableau
    for _ in range(PIVOTS):
        column = 0
        for k in range(1, columns):
            if tableau[rows, k] > tableau[rows, column]:
                column = k
        if not tableau[rows, column] > ZERO:
            break
        row = _leaving_row(tableau, rows, columns, column)
        if row < 0:
            break
        _pivot(tableau, rows, columns, row, column)
        game.basic[row], game.free[column] = game.free[column], game.basic[row]


@merged
def _normalise(weights, count):
    """Scale weights to the sum 1; equal weights where it is 0."""
    total = 0.0
    for i in range(count):
        total += weights[i]
    for i in range(count):
        weights[i] = weights[i] / total if total > 0.0 else 1.0 / count


@merged
def _write_solution(game, rows, columns):
    """Write the weights of columns and rows from the tableau."""
    for k in range(columns):
        game.weights[k] = 0.0
    for i in range(rows):
        game.prices[i] = 0.0
    for i in range(rows):
        if game.basic[i] < columns:
            game.weights[game.basic[i]] = max(game.tableau[i, columns], 0.0)
    for k in range(columns):
        if game.free[k] >= columns:
            game.prices[game.free[k] - columns] = max(-game.tableau[rows, k], 0.0)
    _normalise(game.weights, columns)
    _normalise(game.prices, rows)


@merged
def solve_game(game, rows, columns):
    """Write the mixture of columns whose largest row is least, and the prices that prove it.

    Args:
        game: A `Game`, of which the first rows and columns are used.
        rows: Their number, at least 1.
        columns: Their number, at least 1.

    Returns:
        A lower bound of the largest row of every mixture: the least entry of the prices'
        combination of the rows. It holds however accurate the solution is, up to the rounding of
        this combination.
    """
    _start(game, rows, columns)
    _maximise(game, rows, columns)
    _write_solution(game, rows, columns)
    bound = np.inf
    for k in range(columns):
        entry = 0.0
        for i in range(rows):
            entry += game.prices[i] * game.matrix[i, k]
        bound = min(bound, entry)
    return bound
