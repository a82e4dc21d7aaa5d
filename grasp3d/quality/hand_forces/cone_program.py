"""Second-order cone programs, solved by Clarabel (Goulart & Chen 2024, arXiv:2405.12762).

Interior-point answers are approximate, and now and then the solver gives up on programs that are
feasible. What is printed rests on certificates that are evaluated apart from it, never on a status:
callers take a solution as a proposal, check it, and ask for `polished` ones or `retried` programs.
"""

import math
from dataclasses import dataclass, replace
from functools import cache, cached_property
from typing import Any

import numpy as np

from grasp3d.arrays import Floats, Ints

HUGE = 1e30
"""Numbers in a proposal that are none."""

STEPS = 8
"""Newton steps of polishing."""


@dataclass(frozen=True, eq=False)
class Solution:
    """A proposal: x and multipliers z with cost + A^T z = 0, both nearly feasible."""

    x: Floats
    z: Floats
    status: str
    """As the solver calls it."""

    @property
    def infeasible(self) -> bool:
        """Whether z proposes a proof that nothing is feasible."""
        return self.status in ("PrimalInfeasible", "AlmostPrimalInfeasible")

    @property
    def unbounded(self) -> bool:
        """Whether x proposes a direction along which the cost falls for ever."""
        return self.status in ("DualInfeasible", "AlmostDualInfeasible")


@dataclass(frozen=True, eq=False)
class ConeProgram:
    """Minimise cost . x where b - A x lies in the product of cones, in this order."""

    matrix: Floats
    """A, shape (m, k)."""
    bounds: Floats
    """b, shape (m,)."""
    equations: int
    """Rows whose values are 0."""
    inequalities: int
    """Rows whose values are at least 0; what follows are second-order cones."""
    cones: tuple[int, ...]
    """Sizes of the second-order cones."""

    @cached_property
    def _place(self) -> tuple[Ints, Ints]:
        """Rows and columns of the numbers in the matrix that are not 0, by columns."""
        column, row = np.nonzero(self.matrix.T)
        return row, column

    def make_solver(self, cost: Floats, *, retry: bool) -> Any:
        """Clarabel's solver; `retry`: one that goes on with care instead of speed."""
        import clarabel
        from scipy import sparse

        kinds: list[Any] = []
        if self.equations:
            kinds.append(clarabel.ZeroConeT(self.equations))
        if self.inequalities:
            kinds.append(clarabel.NonnegativeConeT(self.inequalities))
        kinds += [clarabel.SecondOrderConeT(size) for size in self.cones]
        row, column = self._place
        ends = np.searchsorted(column, np.arange(len(cost) + 1))
        parts = (self.matrix[row, column], row, ends)
        matrix = sparse.csc_matrix(parts, shape=self.matrix.shape)
        none = _no_squares(len(cost))
        return clarabel.DefaultSolver(none, cost, matrix, self.bounds, kinds, _settings(retry))

    @cached_property
    def _kept(self) -> Any:
        return self.make_solver(np.zeros(self.matrix.shape[1]), retry=False)

    def with_matrix(self, matrix: Floats) -> "ConeProgram":
        """The same program with other numbers in the matrix, where there were others than 0."""
        other = replace(self, matrix=matrix)
        self._kept.update(A=matrix[self._place])
        other.__dict__.update(_kept=self._kept, _place=self._place)
        return other

    def solve(self, cost: Floats, *, retry: bool = False) -> Solution:
        """Propose a solution for a cost (k,); `retry`: with care instead of speed."""
        if retry:
            solver = self.make_solver(cost, retry=True)
        else:
            solver = self._kept
            solver.update(q=cost)
        found = solver.solve()
        x, z = np.array(found.x), np.array(found.z)
        if not (np.abs(x).max() < HUGE and np.abs(z).max(initial=0.0) < HUGE):
            return Solution(np.zeros_like(x), np.zeros_like(z), "NumericalError")
        return Solution(x, z, str(found.status))

    def polished(self, cost: Floats, found: Solution) -> Solution:
        """Newton's method on the conditions of optimality, from a solution nearly at the optimum.

        It converges quadratically where the optimum is unique and strictly complementary
        (Alizadeh, Haeberly & Overton 1998), and a step that makes the conditions worse ends it.
        """
        x, z = found.x, found.z
        error, residual, jacobian = self._conditions(cost, x, z)
        for _ in range(STEPS if math.isfinite(error) else 0):
            step = np.linalg.lstsq(jacobian, -residual, rcond=1e-13)[0]
            next_x, next_z = x + step[: len(x)], z + step[len(x) :]
            next_error, next_residual, next_jacobian = self._conditions(cost, next_x, next_z)
            if not next_error < error:
                break
            x, z, error = next_x, next_z, next_error
            residual, jacobian = next_residual, next_jacobian
        return replace(found, x=x, z=z)

    def _conditions(self, cost: Floats, x: Floats, z: Floats) -> tuple[float, Floats, Floats]:
        """Their largest error, their values (k + m,), and the matrix of their changes."""
        unknown, rows = len(x), len(z)
        s = self.bounds - self.matrix @ x
        residual = np.concatenate([cost + self.matrix.T @ z, s])
        by_s, by_z = np.eye(rows), np.zeros((rows, rows))
        first = self.equations
        middle = slice(first, first + self.inequalities)
        inside = np.arange(rows)[middle]
        by_s[inside, inside], by_z[inside, inside] = z[middle], s[middle]
        residual[unknown:][middle] = s[middle] * z[middle]
        start = first + self.inequalities
        for size in self.cones:
            block = slice(start, start + size)
            by_s[block, block], by_z[block, block] = _arrow(z[block]), _arrow(s[block])
            residual[unknown:][block] = by_z[block, block] @ z[block]
            start += size
        jacobian = np.zeros((unknown + rows, unknown + rows))
        jacobian[:unknown, unknown:] = self.matrix.T
        jacobian[unknown:, :unknown] = -by_s @ self.matrix
        jacobian[unknown:, unknown:] = by_z
        return float(np.abs(residual).max()), residual, jacobian


@cache
def _settings(retry: bool) -> Any:
    """The solver's settings; to retry with shorter steps and more regularisation."""
    import clarabel

    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.presolve_enable = False
    settings.max_threads = 1
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = 1e-10
    if retry:
        settings.max_step_fraction, settings.max_iter = 0.9, 500
        settings.static_regularization_constant = 1e-7
    return settings


@cache
def _no_squares(count: int) -> Any:
    """Of a cost that is linear."""
    from scipy import sparse

    return sparse.csc_matrix((count, count))


def _arrow(vector: Floats) -> Floats:
    """Matrix of the Jordan product with a vector of a second-order cone."""
    matrix = vector[0] * np.eye(len(vector))
    matrix[0], matrix[:, 0] = vector, vector
    return np.asarray(matrix)
