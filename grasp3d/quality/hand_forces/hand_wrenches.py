"""The wrenches that a hand can exert on an object: how far they reach along directions."""

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from grasp3d.arrays import Floats, Ints, short_repr
from grasp3d.quality.hand_forces.cone_program import ConeProgram
from grasp3d.quality.hand_forces.hand_grasp import HandGrasp

OF_FORCE = "the largest contact force"
"""What limits where no motor does."""


class Farthest(NamedTuple):
    """How far wrenches reach along a direction."""

    point: Floats | None
    """Coordinates of a wrench that reaches farthest [N], shape (k,); None: none is known."""
    upper: float
    """None reaches farther [N]; -inf: there is none, inf: not known."""
    shares: Floats
    """Parts of it that the limits of the motors bear, and that of the contact forces, (k + 1,)."""
    work: Floats
    """Part of the direction that carries the links, as the proof of `upper` has it, for links that
    weigh as they do with 1 kg, (k,)."""


@dataclass(frozen=True, eq=False)
class HandWrenches:
    """The wrenches of a subspace that balance what a hand can press."""

    grasp: HandGrasp
    basis: Floats
    """Orthonormal rows that span the subspace, torques by `grasp.scale`, within the span of the
    wrenches of the contacts, shape (k, 6)."""
    constant: Floats
    """Wrench that the contacts exert besides [N], shape (6,)."""
    carried: Floats
    """Torques that the drives exert less [N m], shape (p,)."""
    links: Floats | None = None
    """Torques that hold the links per acceleration, as in `Actuation`, where the wrench is that of
    the object's weight; None: they do not weigh."""
    mass: float = np.inf
    """Mass of the object then [kg]; inf: the links weigh nothing against it."""

    __repr__ = short_repr

    @cached_property
    def _held(self) -> Floats:
        """Torques that hold the links, in units of 1, along the basis, for 1 kg, shape (p, k)."""
        grasp = self.grasp
        none = np.zeros((grasp.actuation.joints, 3))
        links = none if self.links is None else self.links
        return -(grasp.force / grasp.torque) * links @ self.basis[:, :3].T

    @property
    def _limited(self) -> Ints:
        """Motors that have a limit."""
        return np.flatnonzero(np.isfinite(self.grasp.actuation.limits))

    @cached_property
    def program(self) -> ConeProgram:
        """Unknown are forces along normals and tangents, drives, and coordinates, in units of 1."""
        grasp, actuation = self.grasp, self.grasp.actuation
        (joints, drives), motors = actuation.columns.shape, len(actuation.limits)
        count, limited = grasp.wrenches.shape[1], self._limited
        first, unknown = count + drives, count + drives + len(self.basis)
        units = np.ones(drives)
        units[limited] = actuation.limits[limited] / grasp.torque
        balanced = np.zeros((len(grasp.spanned), unknown))
        balanced[:, :count] = grasp.spanned @ grasp.wrenches
        balanced[:, first:] = -grasp.spanned @ self.basis.T
        driven = np.zeros((joints, unknown))
        driven[:, :count] = grasp.force / grasp.torque * grasp.joint_torques
        driven[:, count:first] = -actuation.columns * units
        driven[:, first:] = self._held / self.mass
        values = np.eye(drives, unknown, count)
        within = np.concatenate([values[limited], -values[limited], -values[motors:]])
        pressed = np.eye(count, unknown).reshape(-1, 3, unknown)
        angles = grasp.contacts.friction_angle
        factors = np.stack([np.sin(angles), *[np.cos(angles)] * 2], axis=1)
        rubbing = (factors[:, :, None] * pressed).reshape(-1, unknown)
        capped = np.pad(pressed, ((0, 0), (1, 0), (0, 0))).reshape(-1, unknown)
        cap = [grasp.most_force / grasp.force, 0.0, 0.0, 0.0]
        bounds = (
            grasp.spanned @ self.constant / grasp.force,
            self.carried / grasp.torque,
            np.repeat([1.0, 0.0], [2 * len(limited), drives - motors]),
            np.zeros(count),
            np.tile(cap, len(angles)),
        )
        return ConeProgram(
            np.concatenate([balanced, driven, within, -rubbing, -capped]),
            np.concatenate(bounds),
            len(balanced) + len(driven),
            len(within),
            (3,) * len(angles) + (4,) * len(angles),
        )

    def reach(self, direction: Floats) -> Farthest:
        """How far the wrenches reach along a direction of the subspace, (k,), of length 1."""
        grasp, program, limited = self.grasp, self.program, self._limited
        first = program.matrix.shape[1] - len(direction)
        x, least, multipliers = program.solve(np.pad(-direction, (first, 0)))
        parts = grasp.force * program.bounds * multipliers
        start, end = program.equations, program.equations + program.inequalities
        shares = np.zeros(len(grasp.actuation.limits) + 1)
        shares[limited] = parts[start : start + 2 * len(limited)].reshape(2, -1).sum(axis=0)
        shares[-1] = parts[end:].sum()
        work = multipliers[len(grasp.spanned) : start] @ self._held
        point = None if x is None else grasp.force * x[first:]
        return Farthest(point, -grasp.force * least, shares, work)
