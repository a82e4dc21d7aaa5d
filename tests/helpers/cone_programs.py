"""Grip force by a second-order cone program: an oracle for tests and benchmarks (Clarabel)."""

import math

import clarabel
import numpy as np
from numpy.typing import NDArray
from scipy import sparse

import grasp3d
from grasp3d.contact.contacts import tangents

Floats = NDArray[np.float64]


class ConeProgram:
    """Smallest t for which forces in their cones, bounded by t, balance a wrench; one grasp.

    The unknowns are t, the components of each contact's force along its normal and two tangents,
    and for soft fingers its torsional moment times friction over the torsion radius.
    """

    def __init__(self, contacts: grasp3d.Contacts, bound: str) -> None:
        points, normals, friction = contacts.points, contacts.normals, contacts.friction
        self.soft = bool((contacts.torsion_radius > 0.0).any())
        self.scale = float(np.linalg.norm(points, axis=1).max()) or 1.0
        count, size = len(points), 4 if self.soft else 3
        frames = np.stack([normals, *tangents(normals)], axis=1)  # (n, 3, 3)
        moments = np.cross(points[:, None], frames) / self.scale
        rows = np.concatenate([frames, moments], axis=2)  # (n, 3, 6)
        if self.soft:
            per_unit = contacts.torsion_radius / friction / self.scale
            twist = np.zeros((count, 1, 6))
            twist[:, 0, 3:] = per_unit[:, None] * normals
            rows = np.concatenate([rows, twist], axis=1)
        unknown = count * size + 1
        balance = np.concatenate([rows.reshape(-1, 6).T, np.zeros((6, 1))], axis=1)
        cones = -np.eye(unknown - 1, unknown)
        cones[::size] *= friction[:, None]
        blocks = [balance, cones]
        kinds = [clarabel.ZeroConeT(6), *[clarabel.SecondOrderConeT(size)] * count]
        if bound == "norm":
            limits = np.zeros((count, 4, unknown))
            limits[:, 0, -1] = -1.0
            for i in range(count):
                limits[i, 1:, i * size : i * size + 3] = -np.eye(3)
            blocks.append(limits.reshape(-1, unknown))
            kinds += [clarabel.SecondOrderConeT(4)] * count
        else:
            limits = np.zeros((count if bound == "normal" else 1, unknown))
            limits[:, -1] = -1.0
            for i in range(count):
                limits[i if bound == "normal" else 0, i * size] = 1.0
            blocks.append(limits)
            kinds.append(clarabel.NonnegativeConeT(len(limits)))
        matrix = np.concatenate(blocks)
        self._matrix, self._kinds = sparse.csc_matrix(matrix), kinds
        self._right = np.zeros(len(matrix))
        self._costs = np.zeros(unknown)
        self._costs[-1] = 1.0
        self._quadratic = sparse.csc_matrix((unknown, unknown))
        self._settings = clarabel.DefaultSettings()
        self._settings.verbose = False

    def force(self, wrench: Floats) -> float:
        """Return the force that a wrench needs; inf: no force suffices; nan: the solver failed."""
        self._right[:3], self._right[3:6] = -wrench[:3], -wrench[3:] / self.scale
        solution = clarabel.DefaultSolver(
            self._quadratic, self._costs, self._matrix, self._right, self._kinds, self._settings
        ).solve()
        status = str(solution.status)
        if status == "Solved":
            return float(solution.obj_val)
        return math.inf if status == "PrimalInfeasible" else math.nan
