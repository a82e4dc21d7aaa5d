"""Second-order cone programs, solved by Clarabel (Goulart & Chen 2024, arXiv:2405.12762)."""

from dataclasses import dataclass
from functools import cache, cached_property
from typing import Any, NamedTuple

import numpy as np

from grasp3d.arrays import Floats

FEASIBLE = 1e-7
"""Largest violation of a row, relative to the largest number of a point, but at least to 1, with
which that counts as feasible."""


class Solution(NamedTuple):
    """A feasible point, and a bound that none passes.

    Interior-point answers are approximate: the point is feasible but for `FEASIBLE`, which is
    checked whatever the solver says of it, and the bound is that of the dual, right to about 1e-8
    of the numbers of the program. Where the solver gives up there is no bound.
    """

    x: Floats | None
    """None: no point is known."""
    least: float
    """No feasible point costs less; -inf: not known, inf: there is none."""
    multipliers: Floats
    """Of the rows, z with cost + A^T z = 0."""


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
    def _solver(self) -> Any:
        import clarabel
        from scipy import sparse

        kinds: list[Any] = [clarabel.ZeroConeT(self.equations)]
        kinds.append(clarabel.NonnegativeConeT(self.inequalities))
        kinds += [clarabel.SecondOrderConeT(size) for size in self.cones]
        count = self.matrix.shape[1]
        matrix, none = sparse.csc_matrix(self.matrix), sparse.csc_matrix((count, count))
        return clarabel.DefaultSolver(
            none, np.zeros(count), matrix, self.bounds, kinds, _settings()
        )

    def solve(self, cost: Floats) -> Solution:
        """Solve it for a cost (k,)."""
        self._solver.update(q=cost)
        found = self._solver.solve()
        x, left = np.array(found.x), np.array(found.s)  # what is left is in the cones
        error = np.abs(self.bounds - self.matrix @ x - left).max()
        feasible = error <= FEASIBLE * max(1.0, np.abs(x).max())
        status = str(found.status)
        least = {"Solved": found.obj_val_dual, "PrimalInfeasible": np.inf}.get(status, -np.inf)
        known = feasible and least < np.inf
        return Solution(x if known else None, least, np.array(found.z))


@cache
def _settings() -> Any:
    import clarabel

    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.presolve_enable = False
    settings.max_threads = 1
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = 1e-9
    return settings
