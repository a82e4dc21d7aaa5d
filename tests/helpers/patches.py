"""Grip force of fingers that touch at several points, by a cone program."""

import math

import clarabel
import numpy as np
from numpy.typing import NDArray
from scipy import sparse

Floats = NDArray[np.float64]


def _solve(
    goal: Floats, rows: list[Floats], constants: list[float], cones: list[object]
) -> tuple[float, Floats]:
    """Return the smallest goal . x with constants - rows x in the cones, and x."""
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = 1e-11
    found = clarabel.DefaultSolver(
        sparse.csc_matrix((len(goal), len(goal))), goal, sparse.csc_matrix(np.array(rows)),
        np.array(constants), cones, settings,
    ).solve()  # fmt: skip
    solved = found.status in {clarabel.SolverStatus.Solved, clarabel.SolverStatus.AlmostSolved}
    return (float(found.obj_val) if solved else math.inf), np.array(found.x)


def force_of_points(
    points: Floats, normals: Floats, friction: Floats, wrench: Floats, bound: str = "normal"
) -> float:
    """Smallest force per patch that resists a wrench, by hard contacts at points (n, k, 3).

    For each patch, the normal components along normals (n, 3), or the lengths of the forces, are
    bounded together.
    """
    patches, size = points.shape[:2]
    count = size * patches
    columns = 4 * count + 1  # force and part of the bound for each point; then the bound
    balance, below = np.zeros((6, columns)), np.zeros((patches, columns))
    rows, cones = [], [clarabel.ZeroConeT(6)]
    for k in range(count):
        i = k // size
        point, normal = points[i, k % size], normals[i]
        balance[:3, 4 * k : 4 * k + 3] = np.eye(3)
        balance[3:, 4 * k : 4 * k + 3] = np.cross(point, np.eye(3)).T
        local = np.eye(columns)[4 * k : 4 * k + 4]
        pressing = normal @ local[:3]
        sideways = (np.eye(3) - np.outer(normal, normal)) @ local[:3]
        rows += [-friction[i] * pressing, *-sideways]
        cones.append(clarabel.SecondOrderConeT(4))
        rows += [-local[3], *-(local[:3] if bound == "norm" else np.outer(normal, pressing))]
        cones.append(clarabel.SecondOrderConeT(4))
        below[i] += local[3]
    below[:, -1] = -1.0
    cones.append(clarabel.NonnegativeConeT(patches))
    constants = [*-wrench, *[0.0] * (len(rows) + patches)]
    return _solve(np.eye(columns)[-1], [*balance, *rows, *below], constants, cones)[0]
