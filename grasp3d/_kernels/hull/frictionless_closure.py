"""Depth of frictionless force closure: by how much all normals may tilt before it is lost.

A direction u of wrench space is an infinitesimal motion of the object, g_i = u_f + u_tau x p_i its
velocity at contact i. Contact i excludes the directions with n_i . g_i > s |g_i|, a convex cone;
the depth is the largest s at which all contacts together exclude every direction.

Its bounds are those of matrix games: the mixture of columns whose largest row is least, with a
proof. They are linear programs of a special form, which the simplex method solves in microseconds
while they are small; its pivots need no first phase, as some mixture always exists.
"""

import math
from typing import NamedTuple

import numpy as np

from grasp3d._kernels.array_types import Floats1, Floats2, Floats3, Floats4, Ints1
from grasp3d._kernels.compiling import merged, scratch_kernel
from grasp3d._kernels.surface.vectors import copy

PIVOTS = 200
"""Largest number of pivots of the simplex method; few games need more than 20."""

ZERO = 1e-14
"""Size below which an entry of the tableau counts as 0; those at the start are from 1 to 2."""


class Game(NamedTuple):
    """A game with its solution, and scratch for the simplex method."""

    matrix: Floats2
    """The game (rows, columns); it is kept."""
    weights: Floats1
    """Solution: weights of the columns (columns,), not negative, with the sum 1."""
    prices: Floats1
    """Proof: weights of the rows (rows,), not negative, with the sum 1."""
    tableau: Floats2
    """Scratch (rows + 1, columns + 1)."""
    basic: Ints1
    """Scratch (rows,): the variable of each row of the tableau, columns first."""
    free: Ints1
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


STACK = 256
"""Capacity for pending cells: depth-first search adds one per bisection, starting from 64."""

DESCENTS = 8
"""Largest number of steps of a descent."""

LEAST_DESCENT = 1e-9
"""Decrease of the cosine by less than which a descent ends."""

NEAREST_CUT = 0.2
"""Smallest fraction of an edge that a bisection cuts off."""

ROUNDING = 1e-14
"""Rounding of a bound for each contact, relative to the largest entry."""


class Cells(NamedTuple):
    """Simplicial cones of directions, the pending ones first."""

    rays: Floats3
    """Unit vectors that span each cell (STACK, 6, 6)."""
    velocities: Floats4
    """Velocity of each ray at each contact along its normal and tangents (STACK, 6, n, 3)."""
    speeds: Floats3
    """Lengths of the velocities (STACK, 6, n)."""
    mixture: Floats1
    """Weights of a cell's rays, for a direction in the cell (6,)."""
    excess: Floats1
    """By how much each contact excludes this direction (n,)."""
    game: Game
    """Contacts against rays."""


def make_cells(count: int) -> Cells:
    """Allocate the cells of `frictionless_depth` for `count` contacts."""
    return Cells(
        rays=np.zeros((STACK, 6, 6)),
        velocities=np.zeros((STACK, 6, count, 3)),
        speeds=np.zeros((STACK, 6, count)),
        mixture=np.zeros(6),
        excess=np.zeros(count),
        game=make_game(count, 6),
    )


@merged
def _write_ray(axes, dim, cells, cell, k):
    """Scale a ray to length 1, and write its velocities."""
    length = 0.0
    for c in range(dim):
        length += cells.rays[cell, k, c] * cells.rays[cell, k, c]
    length = math.sqrt(length)
    for c in range(dim):
        cells.rays[cell, k, c] /= length
    for i in range(axes.shape[0]):
        square = 0.0
        for a in range(3):
            component = 0.0
            for c in range(dim):
                component += axes[i, a, c] * cells.rays[cell, k, c]
            cells.velocities[cell, k, i, a] = component
            square += component * component
        cells.speeds[cell, k, i] = math.sqrt(square)


@merged
def _write_orthant(axes, dim, cells, cell, corner):
    """Write one of the 2^d orthants of the wrench space as a cell."""
    for k in range(dim):
        for c in range(dim):
            cells.rays[cell, k, c] = 0.0
        cells.rays[cell, k, k] = -1.0 if corner >> k & 1 else 1.0
        _write_ray(axes, dim, cells, cell, k)


@merged
def _velocity(cells, dim, cell, i):
    """Velocity (components, length) at contact i of the mixed direction of a cell."""
    normal = first = second = 0.0
    for k in range(dim):
        normal += cells.mixture[k] * cells.velocities[cell, k, i, 0]
        first += cells.mixture[k] * cells.velocities[cell, k, i, 1]
        second += cells.mixture[k] * cells.velocities[cell, k, i, 2]
    return normal, first, second, math.sqrt(normal * normal + first * first + second * second)


@merged
def _largest_cosine(cells, contacts, dim, cell):
    """Largest cosine between velocity and normal in the mixed direction.

    A stationary contact is left out: directions nearby move it along any velocity.
    """
    largest = -1.0
    for i in range(contacts):
        normal, _, _, length = _velocity(cells, dim, cell, i)
        if length > 0.0:
            largest = max(largest, normal / length)
    return largest


@merged
def _is_excluded(cells, contacts, dim, cell, threshold):
    """Whether a combination of contacts excludes a whole cell; writes the mixed direction.

    In the cell |g_i| is at most its linear interpolation between the rays, as it is convex. So
    n_i . g_i - s |g_i| is at least the interpolation of its values at the rays, which are a matrix;
    a combination of its rows that is positive at every ray excludes every mixture of the rays.
    Else the mixture that is excluded least becomes the mixed direction. The error is quadratic in
    the size of the cell and proportional to s.
    """
    matrix = cells.game.matrix
    largest = 0.0
    for i in range(contacts):
        for k in range(dim):
            matrix[i, k] = cells.velocities[cell, k, i, 0] - threshold * cells.speeds[cell, k, i]
            largest = max(largest, abs(matrix[i, k]))
    bound = solve_game(cells.game, contacts, dim)
    for k in range(dim):
        cells.mixture[k] = cells.game.weights[k]
    return bound > ROUNDING * contacts * largest


@merged
def _write_tangents(cells, contacts, dim, cell, cosine):
    """Write the game of a descent: n_i . g_i - s t_i . g_i, t_i along the mixed velocity."""
    for i in range(contacts):
        normal, first, second, length = _velocity(cells, dim, cell, i)
        factor = cosine / length if length > 0.0 else 0.0
        for k in range(dim):
            velocity = cells.velocities[cell, k, i]
            along = normal * velocity[0] + first * velocity[1] + second * velocity[2]
            cells.game.matrix[i, k] = velocity[0] - factor * along


@merged
def _descended(cells, contacts, dim, cell, cosine):
    """Largest cosine of a direction of a cell that a descent from the mixed direction reaches.

    |g_i| is at least t_i . g_i, t_i a unit vector: mixtures below 0 in the game of tangents have a
    smaller largest cosine. (The convex-concave procedure.)
    """
    least = cosine
    for _ in range(DESCENTS):
        _write_tangents(cells, contacts, dim, cell, least)
        solve_game(cells.game, contacts, dim)
        weights = cells.game.weights
        for k in range(dim):
            cells.mixture[k], weights[k] = weights[k], cells.mixture[k]
        reached = _largest_cosine(cells, contacts, dim, cell)
        if not reached < least - LEAST_DESCENT:
            for k in range(dim):
                cells.mixture[k] = weights[k]
            break
        least = reached
    return least


@merged
def _widest_edge(cells, contacts, dim, cell, threshold):
    """The two rays between which the speeds of the mixed direction are interpolated worst.

    Contacts count by how much they exclude the direction, as the interpolation hides this.
    """
    for i in range(contacts):
        normal, _, _, length = _velocity(cells, dim, cell, i)
        cells.excess[i] = max(normal - threshold * length, 0.0)
    first, second, widest = 0, 1, -1.0
    for a in range(dim):
        for b in range(a):
            gap = 0.0
            for i in range(contacts):
                product = 0.0
                for c in range(3):
                    product += cells.velocities[cell, a, i, c] * cells.velocities[cell, b, i, c]
                speeds = cells.speeds[cell, a, i] * cells.speeds[cell, b, i]
                gap += cells.excess[i] * (speeds - product)
            gap *= cells.mixture[a] * cells.mixture[b]
            if gap > widest:
                first, second, widest = a, b, gap
    return first, second


@merged
def _bisect(axes, dim, cells, cell, other, a, b):
    """Cut an edge at the mixed direction: one part replaces the cell, one is written to `other`."""
    for k in range(dim):
        for c in range(dim):
            cells.rays[other, k, c] = cells.rays[cell, k, c]
        for i in range(axes.shape[0]):
            cells.speeds[other, k, i] = cells.speeds[cell, k, i]
            copy(cells.velocities[cell, k, i], cells.velocities[other, k, i])
    total = cells.mixture[a] + cells.mixture[b]
    fraction = cells.mixture[b] / total if total > 0.0 else 0.5
    fraction = min(max(fraction, NEAREST_CUT), 1.0 - NEAREST_CUT)
    for c in range(dim):
        x = (1.0 - fraction) * cells.rays[cell, a, c] + fraction * cells.rays[cell, b, c]
        cells.rays[other, a, c] = x
        cells.rays[cell, b, c] = x
    _write_ray(axes, dim, cells, other, a)
    _write_ray(axes, dim, cells, cell, b)


@scratch_kernel("Floats3, int, float, int, Cells")
def frictionless_depth(axes, dim, tolerance, most, cells):
    """Smallest, over all directions, of the largest cosine between a contact's motion and normal.

    Branch and bound: the directions are divided into simplicial cones (cells), starting from the
    2^d orthants. A cell is finished when a combination of contacts excludes it at the smallest
    cosine found less the tolerance, else it is bisected. The largest cosine has its local minima
    where as many contacts as the rank are equally large, as it is made of concave functions: it
    rises steeply on all sides, so that few cells are needed near them.

    Args:
        axes: Wrenches of the contacts' normals and tangents in the span (n, 3, 6).
        dim: Rank.
        tolerance: Largest error of the result, as an angle [rad].
        most: Largest number of bounds computed.
        cells: From `make_cells`.

    Returns:
        (best, sure): the smallest cosine of the examined directions, and a lower bound that holds
        in every direction, 0 where the number of cells did not suffice.
    """
    contacts = axes.shape[0]
    best, size, corner = 1.0, 0, 0
    for _ in range(most):
        threshold = math.sin(math.asin(best) - tolerance)
        if threshold <= 0.0:
            break
        if corner < 1 << dim:  # all orthants first, for a small cosine
            _write_orthant(axes, dim, cells, size, corner)
            corner += 1
            size += 1
            is_new = True
        elif size == 0:
            break
        else:
            is_new = False
        cell = size - 1
        if _is_excluded(cells, contacts, dim, cell, threshold):
            size -= 1
            continue
        cosine = _largest_cosine(cells, contacts, dim, cell)
        if is_new or cosine < best:
            best = max(min(best, _descended(cells, contacts, dim, cell, cosine)), 0.0)
        if is_new or best <= threshold:
            continue
        if size >= cells.rays.shape[0]:
            break
        a, b = _widest_edge(cells, contacts, dim, cell, threshold)
        _bisect(axes, dim, cells, cell, size, a, b)
        size += 1
    if size > 0 or corner < 1 << dim:
        return best, 0.0
    return best, max(math.sin(math.asin(best) - tolerance), 0.0)
