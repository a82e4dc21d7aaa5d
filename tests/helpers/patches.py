"""Patches that two fingers touch, and slow ways to evaluate them."""

import math
from typing import NamedTuple

import clarabel
import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from grasp3d import Contacts, critical_friction_angle
from grasp3d.quality.patch_lines import best_line_angles

Floats = NDArray[np.float64]


class Patches(NamedTuple):
    """Pairs of elliptic patches."""

    points: Floats
    """Middles (b, 2, 3)."""
    normals: Floats
    """Inward unit normals (b, 2, 3)."""
    axes: Floats
    """Semi-axes in the tangent planes (b, 2, 2, 3)."""

    @property
    def point_angles(self) -> Floats:
        """Critical friction angles of the middles (b,)."""
        return np.asarray(critical_friction_angle(Contacts(self.points, self.normals)))

    @property
    def angles(self) -> Floats:
        """Those of the best lines (b,)."""
        return np.asarray(best_line_angles(*self, self.point_angles))


def random_patches(count: int, seed: int, *, size: float = 0.3) -> Patches:
    """Patches on a ball, normals roughly inward, nearly opposite to each other."""
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(count, 2, 3))
    points /= np.linalg.norm(points, axis=-1, keepdims=True)
    points[:, 1] = -points[:, 0] + 0.4 * rng.normal(size=(count, 3))
    normals = -points + 0.3 * rng.normal(size=points.shape)
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    axes = size * rng.normal(size=(*points.shape[:-1], 2, 3))
    along = (axes * normals[..., None, :]).sum(axis=-1, keepdims=True)
    return Patches(points, normals, axes - along * normals[..., None, :])


def _solve(
    goal: Floats, rows: list[Floats], constants: list[float], cones: list[object]
) -> tuple[float, Floats]:
    """Smallest goal . x with constants - rows x in the cones, and x."""
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = 1e-11
    found = clarabel.DefaultSolver(
        sparse.csc_matrix((len(goal), len(goal))), goal, sparse.csc_matrix(np.array(rows)),
        np.array(constants), cones, settings,
    ).solve()  # fmt: skip
    solved = found.status in {clarabel.SolverStatus.Solved, clarabel.SolverStatus.AlmostSolved}
    return (float(found.obj_val) if solved else math.inf), np.array(found.x)


def best_line(points: Floats, first: Floats, second: Floats, patch: Floats) -> tuple[float, Floats]:
    """Least of the larger angle between a line from patch to patch and two directions.

    A second-order cone program over the line's length and the centres of pressure; inf where no
    line is within 90 degrees of both.
    """
    line = np.concatenate([-patch[0], patch[1], [points[1] - points[0]], np.zeros((1, 3))]).T
    unit = np.eye(6)
    rows = [unit[5] - first @ line, unit[5] - second @ line, np.zeros(6), *-line]
    for k in (0, 2):
        rows += [-unit[4], -unit[k], -unit[k + 1]]
    cones = [clarabel.NonnegativeConeT(2), clarabel.SecondOrderConeT(4)]
    cones += [clarabel.SecondOrderConeT(3)] * 2
    value, x = _solve(-unit[5], rows, [0.0, 0.0, 1.0, *[0.0] * 9], cones)
    cosine = -value
    return (math.inf if cosine < 1e-6 else math.acos(min(cosine, 1.0))), line @ x


def force_of_points(
    points: Floats, normals: Floats, friction: Floats, wrench: Floats, bound: str = "normal"
) -> float:
    """Least force per patch that resists a wrench, by hard contacts at points (n, k, 3) of patches.

    The normal components along normals (n, 3) at the points of a patch, or the lengths of the
    forces, together are bounded.
    """
    patches, size = points.shape[:2]
    count = size * patches
    columns = 4 * count + 1  # each point's force and share of the bound; then the bound
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
