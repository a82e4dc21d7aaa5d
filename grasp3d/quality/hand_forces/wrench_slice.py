"""How far the wrenches that a hand can exert reach along directions, with proofs both ways.

The wrenches are those that balance a constant one and any of a subspace: of all, of forces at the
centre of mass, or along the ray of one wrench. A force in the cones that the drives can press
proves that they reach so far. Motions u of the object and v of the joints prove that no force
reaches farther: the work of the contact forces f on the relative velocities e = G^T u - J v is
never above 0 where these point out of the cones, so that u . G f is at most the power of the drives
on v. Both are evaluated apart from the solver that proposes them.
"""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from grasp3d.arrays import Floats, angles_between, short_repr
from grasp3d.quality.hand_forces.actuation import RANK
from grasp3d.quality.hand_forces.cone_program import ConeProgram, Solution
from grasp3d.quality.hand_forces.hand_grasp import HandGrasp, cone_rows, widened

EVIDENT = 1e-7
"""Largest error of a proof: angles [rad], and forces and torques relative to the largest."""

NEGLIGIBLE = 1e-3
"""Reach, relative to the unit of force, below which bounds need not agree relative to it."""

AGREED = 1e-6
"""Relative difference of the bounds that a solution as found must not exceed."""


@dataclass(frozen=True, eq=False)
class Reach:
    """How far the wrenches reach along a direction, with the proofs."""

    lower: float
    """They reach so far: nan where no force is known to be possible, inf: without end."""
    upper: float
    """They reach no farther; inf: no proof is known. Below 0 with a direction of 0: nothing is
    possible at all."""
    point: Floats
    """Coordinates in the subspace of the wrench that reaches `lower`, shape (k,)."""
    forces: Floats
    """Contact forces that exert it [N], shape (n, 3)."""
    drives: Floats
    """Values of the drives that press them, shape (q,)."""
    twist: Floats
    """Motion u of the object, shape (6,)."""
    motion: Floats
    """Motion v of the joints, shape (p,)."""
    residual: float
    """Error of the forces: of balance, limits and cones, relative to the largest."""
    slack: float
    """Error of the motions [rad]: how far relative velocities point into the cones."""
    unit: float
    """Unit of force of the grasp [N]."""

    __repr__ = short_repr

    @property
    def proven(self) -> bool:
        """Whether both bounds are proven and agree, or one shows that there is no other."""
        if math.isnan(self.lower):
            return self.upper < 0.0
        size = max(abs(self.upper), abs(self.lower), NEGLIGIBLE * self.unit)
        return self.lower == math.inf or self.upper - self.lower <= AGREED * size


@dataclass(frozen=True, eq=False)
class WrenchSlice:
    """The wrenches of a subspace that balance what a hand can press."""

    grasp: HandGrasp
    half_angles: Floats
    """Of the cones [rad], below pi / 2, shape (n,)."""
    basis: Floats
    """Orthonormal rows that span the subspace, torques divided by `grasp.length`, shape (k, 6)."""
    constant: Floats
    """Wrench that the contacts exert besides, in the same coordinates [N], shape (6,)."""
    links: Floats | None = None
    """Torques of the joints that hold the links, along the basis [N m/N], (p, k); None: none."""

    @cached_property
    def _limits(self) -> tuple[Floats, Floats]:
        """Sides, 0 for lower, and drives that have a limit, (2, l); units of the drives, (q,)."""
        actuation = self.grasp.actuation
        both = np.stack([actuation.lower, actuation.upper])
        finite = np.isfinite(both)
        units = np.where(finite, np.abs(both), 0.0).max(axis=0) / self.grasp.torque
        return np.stack(np.nonzero(finite)), np.where(units > 0.0, units, 1.0)

    @cached_property
    def _idle(self) -> Floats:
        """Idle values of the drives of which limited ones are part, shape (q, i)."""
        idle = self.grasp.actuation.idle
        limited = np.unique(self._limits[0][1]).astype(int)
        _, sizes, rows = np.linalg.svd(idle[limited], full_matrices=False)
        return np.asarray(idle @ rows[sizes > RANK].T)

    @cached_property
    def _held(self) -> Floats:
        """Torques that hold the links, along the basis [N m/N], shape (p, k)."""
        none = np.zeros((self.grasp.actuation.joints, len(self.basis)))
        return none if self.links is None else self.links

    @cached_property
    def _torques(self) -> Floats:
        """Torques of the joints of forces in the frames, idle values and coordinates."""
        grasp = self.grasp
        idle = np.zeros((grasp.actuation.joints, self._idle.shape[1]))
        held = self._held * (grasp.force / grasp.torque)
        return np.concatenate([grasp.joint_torques, idle, held], axis=1)

    @cached_property
    def _equations(self) -> tuple[Floats, Floats, Floats]:
        """Independent equations, their right sides, and how they combine those of statics."""
        grasp, actuation = self.grasp, self.grasp.actuation
        idle = self._idle.shape[1]
        balance = np.concatenate([grasp.wrenches, np.zeros((6, idle)), -self.basis.T], axis=1)
        rows = np.concatenate([balance, actuation.undriven.T @ self._torques])
        right = np.concatenate(
            [self.constant / grasp.force, actuation.undriven.T @ actuation.offset / grasp.torque]
        )
        left, sizes, axes = np.linalg.svd(rows, full_matrices=False)
        kept = sizes > RANK * sizes[0]
        # What cannot be balanced stays as an equation that nothing fulfils.
        rest = right - left[:, kept] @ (left[:, kept].T @ right)
        size = float(np.linalg.norm(rest))
        matrix, combined = sizes[kept, None] * axes[kept], left[:, kept]
        if size > EVIDENT * max(1.0, float(np.abs(right).max())):
            matrix = np.concatenate([matrix, np.zeros((1, rows.shape[1]))])
            combined = np.concatenate([combined, rest[:, None] / size], axis=1)
        return matrix, combined.T @ right, combined

    @cached_property
    def program(self) -> ConeProgram:
        """Unknown are forces in the frames, idle values of drives, and coordinates."""
        grasp, actuation = self.grasp, self.grasp.actuation
        matrix, right, _ = self._equations
        (side, drive), units = self._limits
        unknown, forces = matrix.shape[1], 3 * grasp.contacts.count
        idle = self._idle
        sign = 2.0 * side - 1.0
        values = actuation.inverse @ self._torques
        values[:, forces : forces + idle.shape[1]] = idle
        limits = (sign / units[drive])[:, None] * values[drive]
        bound = np.where(side == 1, actuation.upper[drive], actuation.lower[drive])
        rest = actuation.inverse @ actuation.offset
        most = sign / units[drive] * (bound + rest[drive]) / grasp.torque
        rows = cone_rows(self.half_angles)
        ours = (rows.equations, -rows.pressing, -rows.cones)
        fixed, pressing, cones = (widened(one, unknown) for one in ours)
        blocks = [matrix, fixed, limits, pressing, cones]
        bounds = [right, np.zeros(len(rows.equations)), most, np.zeros(len(rows.pressing))]
        bounds.append(np.zeros(len(rows.cones)))
        sizes = (3,) * len(rows.round)
        if math.isfinite(grasp.most_force):
            capped = np.zeros((grasp.contacts.count, 4, unknown))
            capped[:, 1:, :forces] = np.eye(forces).reshape(-1, 3, forces)
            blocks.append(capped.reshape(-1, unknown))
            bounds.append(np.tile([grasp.most_force / grasp.force, 0.0, 0.0, 0.0], len(capped)))
            sizes += (4,) * len(capped)
        return ConeProgram(
            np.concatenate(blocks),
            np.concatenate(bounds),
            len(matrix) + len(rows.equations),
            len(limits) + len(rows.pressing),
            sizes,
        )

    def reach(self, direction: Floats) -> Reach:
        """How far the wrenches reach along a direction of the subspace, (k,).

        Args:
            direction: Of length 1; 0: whether anything is possible.
        """
        cost = np.zeros(self.program.matrix.shape[1])
        cost[len(cost) - len(direction) :] = -direction
        best: Reach | None = None
        for retry in (False, True):
            best = _better(best, self._evaluated(self.program.solve(cost, retry=retry), direction))
            if best.proven:
                break
        assert best is not None
        loaded = not self.grasp.actuation.holds_links or self.constant.any()
        if best.lower == math.inf and direction.any() and loaded:
            # A solver that finds a way without end need not have found a point where it starts.
            start = self.reach(np.zeros(len(direction)))
            return best if not math.isnan(start.lower) else start
        return best

    def _evaluated(self, found: Solution, direction: Floats) -> Reach:
        """What a proposal proves."""
        grasp = self.grasp
        forces = 3 * grasp.contacts.count
        x = found.x
        local = x[:forces].reshape(-1, 3, 1) * grasp.force
        pressed = (np.swapaxes(grasp.frames, 1, 2) @ local)[..., 0]
        point = x[len(x) - len(direction) :] * grasp.force
        idle = x[forces : len(x) - len(direction)] * grasp.torque
        drives, residual = self._pressing(pressed, idle, point, ray=found.unbounded)
        possible = residual <= EVIDENT and not found.infeasible
        lower = float(direction @ point) if possible else math.nan
        if found.unbounded and possible:
            lower = math.inf if lower > 0.0 else math.nan
        # What shows that nothing is possible reaches along no direction.
        twist, motion = self._motions(found.z, direction * (not found.infeasible))
        upper, slack = self.bound(twist, motion)
        if found.infeasible:
            size = np.linalg.norm(motion) * np.linalg.norm(grasp.actuation.offset)
            size += np.linalg.norm(twist) * np.linalg.norm(self.constant)
            upper = upper if upper < -EVIDENT * size else math.inf
        return Reach(
            lower, upper, point, pressed, drives, twist, motion, residual, slack, grasp.force
        )

    def _pressing(
        self, forces: Floats, idle: Floats, point: Floats, *, ray: bool
    ) -> tuple[Floats, float]:
        """Drives that press contact forces, and the error of all; `ray`: times any factor."""
        grasp, actuation = self.grasp, self.grasp.actuation
        _, units = self._limits
        offset = np.zeros(actuation.joints) if ray else actuation.offset
        torques = grasp.joint_loads(forces) + self._held @ point
        drives = actuation.inverse @ (torques - offset) + self._idle @ idle
        lower, upper = (
            np.where(np.isfinite(one), 0.0, one) if ray else one
            for one in (actuation.lower, actuation.upper)
        )
        beyond = np.maximum(lower - drives, drives - upper) / (units * grasp.torque)
        undriven = actuation.undriven.T @ (torques - offset) / grasp.torque
        wrench = grasp.balance(forces) / grasp.scale
        constant = np.zeros(6) if ray else self.constant
        sizes = np.linalg.norm(forces, axis=1)
        largest = max(float(sizes.max()), grasp.force)
        unbalanced = (wrench - constant - point @ self.basis) / max(
            largest, float(np.abs(constant).max())
        )
        outside = angles_between(forces, grasp.contacts.normals) - np.maximum(self.half_angles, 0.0)
        outside = np.where(self.half_angles < 0.0, 1.0, outside) * sizes / largest
        excess = 0.0 if ray else float(sizes.max()) / grasp.most_force - 1.0
        if ray and math.isfinite(grasp.most_force):
            excess = 1.0
        errors = (beyond, np.abs(undriven), np.abs(unbalanced), outside)
        worst = max(excess, *(float(one.max(initial=0.0)) for one in errors))
        return drives, worst if math.isfinite(worst) else math.inf

    def _motions(self, z: Floats, direction: Floats) -> tuple[Floats, Floats]:
        """Motions of object and joints in the multipliers of a program."""
        grasp, actuation = self.grasp, self.grasp.actuation
        _, _, combined = self._equations
        (side, drive), units = self._limits
        statics = combined @ z[: combined.shape[1]]
        first = self.program.equations
        pulls = np.zeros(len(actuation.lower))
        np.add.at(pulls, drive, (2.0 * side - 1.0) * z[first : first + len(drive)] / units[drive])
        motion = actuation.inverse.T @ pulls + actuation.undriven @ statics[6:]
        motion *= grasp.force / grasp.torque
        twist = -statics[:6]
        twist += (direction - self.basis @ twist - motion @ self._held) @ self.basis
        twist[3:] /= grasp.length
        return twist, motion

    def bound(self, twist: Floats, motion: Floats) -> tuple[float, float]:
        """(upper, slack): how far motions of object and joints prove that wrenches reach at most.

        inf where they prove nothing: relative velocities point into the cones, or the motion moves
        drives that have no limit.
        """
        grasp = self.grasp
        turning = float(np.linalg.norm(twist * grasp.scale))
        work = grasp.actuation.power(motion, turning * grasp.force / grasp.torque)
        velocities = grasp.velocities(twist, motion)
        sizes = np.linalg.norm(velocities, axis=1)
        into = np.maximum(self.half_angles, 0.0) - grasp.openings(twist, motion)
        into = np.where((self.half_angles < 0.0) | (into < 0.0), 0.0, into)
        joints = float(np.linalg.norm(motion)) * grasp.torque / grasp.force
        moving = max(turning, joints, 1e-300)
        slack = float((into * sizes).max() / moving)
        if math.isfinite(grasp.most_force):
            work += grasp.most_force * float((sizes * np.sin(np.minimum(into, np.pi / 2))).sum())
            slack = 0.0
        constant = twist * grasp.scale @ self.constant
        return (work - float(constant) if slack <= EVIDENT else math.inf), slack


def _better(first: Reach | None, second: Reach) -> Reach:
    """The better proven of two."""
    if first is None or second.proven:
        return second
    known = [math.isfinite(one.upper) + (not math.isnan(one.lower)) for one in (first, second)]
    return second if known[1] >= known[0] else first
