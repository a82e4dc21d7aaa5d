"""Linear programs of measures, solved many together."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.sparse import block_diag

from grasp3d.arrays import Floats

TOGETHER = 32
"""Programs solved as one: a call of the solver costs more than a small program."""

TOLERANCE = 1e-10
"""Largest violation of a constraint; rows and unknowns are of size 1."""

NUMERICAL_DIFFICULTIES = 4
"""Status of a program of which the solver found nothing out."""


@dataclass(frozen=True, eq=False)
class Program:
    """Maximise the first unknown x[0], with `equal @ x = constants` and `below @ x <= 0`."""

    equal: Floats
    """Shape (e, v)."""
    constants: Floats
    """Shape (e,)."""
    below: Floats
    """Shape (k, v); k may be 0."""
    least: Floats
    """Lower bounds of the unknowns, shape (v,)."""
    most: Floats
    """Upper bounds, shape (v,)."""


def solve(programs: Sequence[Program]) -> Floats:
    """The largest first unknown of each program, shape (p,); nan where there is no solution."""
    values = np.full(len(programs), np.nan)
    for start in range(0, len(programs), TOGETHER):
        chunk = programs[start : start + TOGETHER]
        values[start : start + len(chunk)] = _solve_together(chunk)
    return values


def _solve_together(programs: Sequence[Program], *, presolve: bool = True) -> Floats:
    """Solve programs as one with blocks; divide them in halves if that has no solution.

    The solver may fail to lead the solution of a simplified program back to the program itself; one
    of which it neither finds a solution nor that there is none is solved as it is.
    """
    widths = np.array([len(program.least) for program in programs])
    first = np.concatenate([[0], np.cumsum(widths)[:-1]])
    cost = np.zeros(widths.sum())
    cost[first] = -1.0
    below = _blocks([program.below for program in programs])
    bounds: Any = np.concatenate(
        [np.stack([program.least, program.most], axis=1) for program in programs]
    )
    from scipy.optimize import linprog

    result = linprog(
        cost,
        A_eq=_blocks([program.equal for program in programs]),
        b_eq=np.concatenate([program.constants for program in programs]),
        A_ub=below if below.shape[0] else None,
        b_ub=np.zeros(below.shape[0]) if below.shape[0] else None,
        bounds=bounds,
        method="highs",
        options={
            "presolve": presolve,
            "primal_feasibility_tolerance": TOLERANCE,
            "dual_feasibility_tolerance": TOLERANCE,
        },
    )
    if result.status == 0 and result.x is not None:
        return np.asarray(result.x[first], dtype=np.float64)
    if len(programs) == 1:
        undecided = result.status == NUMERICAL_DIFFICULTIES and presolve
        return _solve_together(programs, presolve=False) if undecided else np.array([np.nan])
    half = len(programs) // 2
    return np.concatenate([_solve_together(programs[:half]), _solve_together(programs[half:])])


def _blocks(matrices: Sequence[Floats]) -> Any:
    """Sparse matrix with the given ones along its diagonal."""
    return block_diag(matrices, format="csr")
