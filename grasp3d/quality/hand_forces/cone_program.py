"""Second-order cone programs, solved by Clarabel (Goulart & Chen 2024, arXiv:2405.12762).

Interior-point answers are approximate, and now and then the solver gives up on programs that are
feasible. What is printed rests on certificates that are evaluated apart from it, never on a status:
callers take a solution as a proposal, check it, and ask for one with more care.
"""

from dataclasses import dataclass
from functools import cache, cached_property
from typing import Any

import numpy as np

from grasp3d.arrays import Floats, Ints

HUGE = 1e30
"""Numbers in a proposal that are none."""


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
