"""The critical friction angle of a grasp that the hand's own actuators must press.

A grasp resists every wrench of its contacts' span exactly when some internal force that the drives
can press, at any scale, lies strictly inside all friction cones. The least friction angle at which
that is so lies between what two certificates prove: contact forces, the largest angle of which
suffices; and motions u of the object and v of the joints, under which the relative velocities
e = G^T u - J v point so far away from the contacts that no smaller cones press against both.
"""

import math
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from grasp3d.arrays import RIGHT_ANGLE, ArrayLike, Bools, Floats, Ints, short_repr
from grasp3d.contact.contacts import per_contact
from grasp3d.errors import SettingError
from grasp3d.quality.hand_forces.actuation import RANK, kernel
from grasp3d.quality.hand_forces.cone_program import ConeProgram, Solution
from grasp3d.quality.hand_forces.hand_grasp import (
    POINTED,
    ConeRows,
    HandGrasp,
    cone_factors,
    cone_rows,
    widened,
)

EXACT = 1e-12
"""Error of balance, relative to the largest force, that is a rounding error."""

CLEAR = 1e-6
"""Force at a contact, or distance of a drive from its bound, relative to the largest force, that is
clearly above 0."""

ADMISSIBLE = 1e-9
"""Power of drives, relative to the motions, that is a rounding error."""

MOVING = 1e-7
"""Motion of the object in multipliers that sum up to 1 below which it stands still."""

STANDING = 1e-6
"""Relative velocity of a contact, relative to the largest, that is none."""

FORBIDDEN = 1e-6
"""Multiplier, of those that sum up to 1, above which a force must be 0."""

LARGER = (0.0, 1.0, 1e2, 1e4, 1e6)
"""Factors of motions of the joints alone that are tried."""

BEYOND, FARTHER, NEAR = 0.5, 8.0, 0.8
"""How far beyond Newton's root the other bound is looked for, in tolerances; the factor of that
each time; and distance of the root, relative to it, from a bound that is as good."""

MOST_PROGRAMS = 60
"""Cone programs after which the search ends with the bounds reached."""


@dataclass(frozen=True, eq=False)
class ClosingForces:
    """Contact forces in equilibrium, strictly inside cones, that the drives can press."""

    forces: Floats
    """On the object, of any size, shape (n, 3); 0 at contacts that the drives cannot press."""
    idle: Floats
    """Idle values of the drives meanwhile, in the basis of `Actuation.idle`, shape (k,)."""
    scale: float
    """Factor of the limits of drives and of the hand's own weight; 0: they do not matter."""

    __repr__ = short_repr


@dataclass(frozen=True, eq=False)
class SeparatingMotions:
    """Motions that no forces of smaller cones, pressed by the drives, do work against."""

    twist: Floats
    """Of the object, velocity and angular velocity, shape (6,)."""
    motion: Floats
    """Of the joints, shape (p,)."""

    __repr__ = short_repr


@dataclass(frozen=True, eq=False)
class CriticalAngle:
    """Bounds of the friction angle above which a grasp is closed by the hand's drives."""

    lower: float
    """It is not closed up to this angle [rad]; -inf: not known."""
    upper: float
    """It is closed above this angle [rad]; pi/2: at no friction, or none is known."""
    closing: ClosingForces | None
    """Proof of the upper bound; None: there is none."""
    separating: SeparatingMotions | None
    """Proof of the lower bound; None: there is none."""
    programs: int
    """Cone programs solved."""

    __repr__ = short_repr

    @property
    def value(self) -> float:
        """The upper bound [rad]."""
        return self.upper

    def tightened(self, other: "CriticalAngle") -> "CriticalAngle":
        """With the better of the bounds of both."""
        best = replace(self, programs=self.programs + other.programs)
        if other.upper < best.upper:
            best = replace(best, upper=other.upper, closing=other.closing)
        if other.lower > best.lower:
            best = replace(best, lower=other.lower, separating=other.separating)
        return best


@dataclass(frozen=True, eq=False)
class PressedForces:
    """The contact forces that drives can press at some scale: the cone of K, and its proofs.

    Vectors hold the forces in the frames, idle values of drives, and the factor t of the drives'
    limits and of the weight of the hand. Only the bounds at which drives stay without any force
    limit forces of any scale, and t is 0 then; it counts where the drives cannot hold the hand.
    """

    grasp: HandGrasp
    ranks: dict[bytes, int] = field(default_factory=dict)
    """Of the wrenches that forces exert, by drives kept at bounds and contacts without force."""

    @cached_property
    def drives(self) -> Floats:
        """Rows of what must be at least 0: distances of drives from bounds, and t."""
        actuation = self.grasp.actuation
        side, drive = self.bounds
        sign = (1.0 - 2.0 * side)[:, None]
        torque = self.grasp.torque
        by_t = np.zeros(len(drive))
        if actuation.tight is None:
            limits = np.stack([actuation.lower, actuation.upper])[side, drive]
            by_t = -((actuation.inverse @ actuation.offset)[drive] + limits) / torque
        values = (actuation.inverse @ self.grasp.joint_torques)[drive]
        rows = sign * np.concatenate([values, actuation.idle[drive], by_t[:, None]], axis=1)
        if actuation.tight is None:
            rows = np.concatenate([rows, np.eye(rows.shape[1])[-1:]])
        return np.asarray(rows)

    @cached_property
    def bounds(self) -> tuple[Ints, Ints]:
        """Sides of bounds that count, 0 for lower ones, and their drives, each (l,)."""
        actuation = self.grasp.actuation
        tight = actuation.tight
        finite = np.isfinite([actuation.lower, actuation.upper])
        side, drive = np.nonzero(finite if tight is None else tight)
        return side, drive

    @cached_property
    def statics(self) -> Floats:
        """Rows of what must be 0: torques that no drive exerts, and t where it does not count."""
        actuation = self.grasp.actuation
        loads = actuation.undriven.T @ self.grasp.joint_torques
        held = actuation.undriven.T @ actuation.offset / self.grasp.torque
        rows = np.zeros((len(loads) + 1, loads.shape[1] + actuation.idle.shape[1] + 1))
        rows[:-1, : loads.shape[1]] = loads
        rows[:-1, -1] = -held if actuation.tight is None else 0.0
        rows[-1, -1] = actuation.tight is not None
        return rows

    @cached_property
    def balance(self) -> tuple[Floats, Floats]:
        """Independent equations of balance and statics, and how they combine them."""
        balance = widened(self.grasp.wrenches, self.statics.shape[1])
        left, sizes, axes = np.linalg.svd(
            np.concatenate([balance, self.statics]), full_matrices=False
        )
        kept = sizes > RANK * sizes[0]
        return sizes[kept, None] * axes[kept], left[:, kept]

    @cached_property
    def motions(self) -> tuple[Floats, Floats]:
        """Motions of the joints for each bound and each motion that no drive acts on, as columns.

        And the relative velocities, in the frames, for each of `HandGrasp.span` and of these.
        """
        grasp, (side, drive) = self.grasp, self.bounds
        by_bound = grasp.actuation.inverse.T[:, drive] * (2.0 * side - 1.0)
        joints = np.concatenate([by_bound, grasp.actuation.undriven], axis=1)
        turned = (grasp.wrenches.T @ grasp.span.T, -grasp.joint_torques.T @ joints)
        return joints, np.concatenate(turned, axis=1)

    def closing_angle(self, closing: ClosingForces, offset: Floats | float = 0.0) -> float:
        """Friction angle, less the offsets, above which forces prove closure [rad]; nan: at none.

        Evaluated from the forces alone: they balance, the drives press them, and forces near them,
        with the drives at bounds and the contacts without force kept there, exert wrenches of all
        kinds.
        """
        grasp = self.grasp
        count = grasp.contacts.count
        local = (grasp.frames @ closing.forces[..., None])[..., 0]
        sizes = np.linalg.norm(local, axis=1)
        x = np.concatenate([local.ravel(), closing.idle, [closing.scale]])
        rows = np.concatenate([widened(grasp.wrenches, len(x)), self.statics])
        room, size = self.drives @ x, np.abs(x).max()
        still = np.abs(room) <= EXACT * (np.abs(self.drives) @ np.abs(x))
        idle = sizes == 0.0
        errors = np.abs(rows @ x) > EXACT * size * (1.0 + np.abs(rows).max(axis=1))
        # Errors must not decide whether a force or a distance is above 0.
        positive = np.concatenate([sizes[~idle], room[~still]])
        if errors.any() or idle.all() or (positive < CLEAR * sizes.max()).any():
            return math.nan
        key = np.concatenate([still, idle]).tobytes()
        if key not in self.ranks:
            unpressed = np.eye(len(x))[: 3 * count][np.repeat(idle, 3)]
            kept = kernel(np.concatenate([self.statics, self.drives[still], unpressed]))
            spanned = np.linalg.svd(grasp.wrenches @ kept[: 3 * count], compute_uv=False)
            self.ranks[key] = (spanned > RANK * max(1.0, spanned.max(initial=0.0))).sum()
        if self.ranks[key] < len(grasp.span):
            return math.nan
        angles = np.arctan2(np.hypot(local[:, 1], local[:, 2]), local[:, 0])
        return float((angles - offset)[~idle].max())

    def separating_angle(self, motions: SeparatingMotions, offset: Floats | float = 0.0) -> float:
        """Friction angle, less the offsets, up to which motions prove that there is no closure.

        Evaluated from the motions alone: the object moves as the contacts can push it, and the
        drives have no power on the motion of the joints, at any scale of their forces. nan: they
        prove nothing.
        """
        grasp, actuation = self.grasp, self.grasp.actuation
        scale = grasp.scale
        moving = np.linalg.norm(grasp.span @ (motions.twist * scale))
        pull = motions.motion @ actuation.columns
        size = np.linalg.norm(motions.motion) + moving * grasp.force / grasp.torque
        sizes = ADMISSIBLE * size * np.linalg.norm(actuation.columns, axis=0)
        rounded = np.abs(pull) <= sizes
        bounds = np.stack([actuation.lower, actuation.upper])
        if actuation.tight is not None:
            # Their power at any scale: none at bounds where they stay, else without end.
            bounds = np.where(actuation.tight, 0.0, [[-np.inf], [np.inf]])
        bound = np.where(pull > 0.0, bounds[1], bounds[0])
        power = pull @ np.where(rounded & np.isinf(bound) | (pull == 0.0), 0.0, bound)
        if actuation.tight is None:
            power += motions.motion @ actuation.offset
        joints = grasp.velocities(np.zeros(6), motions.motion)
        if not (
            moving > ADMISSIBLE * np.abs(joints).max()
            and power <= grasp.torque * sizes.max(initial=0.0)
        ):
            return math.nan
        openings = grasp.openings(motions.twist, motions.motion)
        return float((openings - offset).min())


def hand_critical_angle(
    grasp: HandGrasp, *, offset: ArrayLike = 0.0, tolerance: float = 1e-4
) -> CriticalAngle:
    """The friction angle above which the hand's drives close a grasp.

    Where `Actuation.two_way` it is that of the contacts alone, `critical_friction_angle`: limits of
    torques then never change a label, only newtons.

    Args:
        grasp: Contacts, Jacobian and drives. The contacts' own friction does not matter.
        offset: Added to the half-angles of the cones, one value or shape (n,) [rad]: with beta - a
            of each contact the result is minus the margin by which all cones may shrink.
        tolerance: Width of the bracket [rad] at which the search ends.

    Returns:
        Bounds with certificates, both ways. Cones have half-angles from 0 to 90 degrees: of grasps
        that are closed without friction the upper bound is where the widest cone is a ray.

    Raises:
        SettingError: A tolerance that is not above 0.
    """
    if not tolerance > 0.0:
        raise SettingError(f"tolerance must be above 0; got {tolerance}")
    return _Search.of(grasp, offset).bracket(tolerance)


def hand_closes(grasp: HandGrasp, half_angles: ArrayLike) -> bool | None:
    """Whether the hand's drives close a grasp with cones of half-angles, one value or (n,).

    Below 0: no force of that contact is in its cone.

    Returns:
        None: neither is proven.
    """
    found = _Search.of(grasp, half_angles).at(0.0).angle
    if found.closing is not None and found.upper < 0.0:
        return True
    return False if found.lower >= 0.0 else None


@dataclass(frozen=True, eq=False)
class _Search:
    """Cone programs with half-angles of offset + angle: forces as far inside cones as possible."""

    pressed: PressedForces
    offsets: Floats
    programs: dict[bytes, "_Program"] = field(default_factory=dict)
    """By the contacts and drives that are left out."""

    @classmethod
    def of(cls, grasp: HandGrasp, offset: ArrayLike) -> "_Search":
        return cls(PressedForces(grasp), per_contact("offset", offset, grasp.contacts))

    def at(self, angle: float) -> "_Found":
        """What programs at an angle prove.

        Where contacts cannot be pressed at that angle, or drives stay at bounds, motions of the
        joints alone show it; the next program is without them.
        """
        half_angles = np.minimum(self.offsets + angle, RIGHT_ANGLE)
        dropped = half_angles < 0.0
        rays = np.abs(half_angles) <= POINTED
        still = np.zeros(len(self.pressed.drives), dtype=np.bool_)
        joints = np.zeros(self.pressed.grasp.actuation.joints)
        best, distance, slope = CriticalAngle(-math.inf, RIGHT_ANGLE, None, None, 0), 0.0, 0.0
        for _ in range(len(dropped) + len(still) + 1):
            if dropped.all():
                break
            key = np.concatenate([dropped, rays, still]).tobytes()
            program = self.programs.get(key)
            if program is None:
                program = _Program(self.pressed, np.where(dropped, -1.0, half_angles), still)
            else:
                program = program.at(np.where(dropped, -1.0, half_angles))
            self.programs[key] = program
            found = program.solved()
            distance, slope = float(found.x[-1]), program.slope(found)
            motions = program.motions(found.z)
            best = best.tightened(self._proven(program, found, motions, joints))
            if distance > 0.0 or np.abs(motions.twist * self.pressed.grasp.scale).max() > MOVING:
                break
            unpressed, idle = program.forbidden(found.z)
            if not (unpressed & ~dropped).any() and not (idle & ~still).any():
                break
            dropped, still = dropped | unpressed, still | idle
            joints = joints * LARGER[2] + motions.motion
        return _Found(best, angle - distance / slope if slope > 0.0 else math.nan)

    def _proven(
        self, program: "_Program", found: Solution, motions: SeparatingMotions, joints: Floats
    ) -> CriticalAngle:
        """What the proposals of a program prove; `joints`: a motion of the joints alone."""
        lower, upper = -math.inf, math.nan
        closing, separating = None, None
        if found.x[-1] > 0.0:
            closing = program.closing(found.x)
            upper = self.pressed.closing_angle(closing, self.offsets)
        factors = LARGER if joints.any() else LARGER[:1]
        tries = [replace(motions, motion=motions.motion + factor * joints) for factor in factors]
        if found.infeasible:  # nothing can press: links withdraw, whatever the object does
            grasp = self.pressed.grasp
            withdrawing = LARGER[-1] * (motions.motion + joints)
            tries.append(SeparatingMotions(grasp.span[0] / grasp.scale, withdrawing))
        for tried in tries:
            angle = self.pressed.separating_angle(tried, self.offsets)
            if angle > lower:
                lower, separating = min(angle, RIGHT_ANGLE), tried
        if math.isnan(upper):
            upper, closing = RIGHT_ANGLE, None
        return CriticalAngle(lower, upper, closing, separating, 1)

    def bracket(self, tolerance: float) -> CriticalAngle:
        """Bounds that are as near as the tolerance, or as the certificates allow.

        Newton's method finds where forces no longer get inside the cones. It comes from one side,
        whose certificate is soon as good as it; that of the other side is then looked for beyond,
        farther away each time. Where steps do not get shorter the bracket is halved.
        """
        least, most = -float(self.offsets.max()), RIGHT_ANGLE - float(self.offsets.min())
        middle = 0.5 * (least + most)
        found = self.at(middle)
        best, step, beyond = found.angle, math.inf, BEYOND * tolerance
        while best.programs < MOST_PROGRAMS:
            low, high = max(best.lower, least), min(best.upper, most)
            if high - low <= tolerance:
                break
            before, step = step, abs(found.root - middle)
            stalls, root = not step <= 0.5 * before, found.root
            middle = 0.5 * (low + high)
            if best.closing is None and (root >= most or stalls):
                middle = most
            elif min(abs(root - low), abs(high - root)) <= NEAR * beyond:
                if beyond < middle - low:
                    middle = root + beyond if root < middle else root - beyond
                beyond *= FARTHER
            elif low < root < high and not stalls:
                middle = root
            found = self.at(middle)
            best = best.tightened(found.angle)
            if middle == most and best.closing is None:
                break
        return best


class _Found(NamedTuple):
    """What programs at an angle prove, and where Newton's method would go on."""

    angle: CriticalAngle
    root: float


@dataclass(frozen=True, eq=False)
class _Program:
    """The program at half-angles (n,), negative without a contact, with some drives kept still."""

    pressed: PressedForces
    half_angles: Floats
    still: Bools

    @cached_property
    def _cones(self) -> ConeRows:
        """Of the first program of all that `at` makes; the same contacts are round in these."""
        return cone_rows(self.half_angles)

    @cached_property
    def program(self) -> ConeProgram:
        """Unknown are the vectors of `PressedForces` and the distance from all borders."""
        cones, drives = self._cones, self.pressed.drives
        balance, _ = self.pressed.balance
        unknown = drives.shape[1] + 1
        total = np.zeros((1, unknown))
        total[0, : 3 * len(self.half_angles) : 3] = 1.0
        equations = [balance, drives[self.still], cones.equations, total]
        fixed = np.concatenate([widened(one, unknown) for one in equations])
        positive = np.concatenate([drives[~self.still], widened(cones.pressing, unknown - 1)])
        inside, round_ = widened(positive, unknown), widened(cones.cones, unknown)
        inside[:, -1] = round_[::3, -1] = -1.0
        bounds = np.zeros(len(fixed) + len(inside) + len(round_))
        bounds[len(fixed) - 1] = 1.0
        matrix = np.concatenate([fixed, -inside, -round_])
        return ConeProgram(matrix, bounds, len(fixed), len(inside), (3,) * len(cones.round))

    def at(self, half_angles: Floats) -> "_Program":
        """The same at other half-angles, of which as many are negative or 0."""
        other = replace(self, half_angles=half_angles)
        matrix, round_ = self.program.matrix.copy(), self._cones.round
        factors = cone_factors(half_angles[round_]).ravel()
        columns = (3 * round_[:, None] + np.arange(3)).ravel()
        matrix[len(matrix) - len(factors) + np.arange(len(factors)), columns] = -factors
        other.__dict__.update(_cones=self._cones, program=self.program.with_matrix(matrix))
        return other

    def solved(self) -> Solution:
        """What the solver proposes."""
        cost = np.zeros(self.program.matrix.shape[1])
        cost[-1] = -1.0
        found = self.program.solve(cost)
        if found.status not in ("Solved", "AlmostSolved"):
            found = self.program.solve(cost, retry=True)
        return found

    def slope(self, found: Solution) -> float:
        """How fast the distance grows with the angle of the cones."""
        round_ = self._cones.round
        multipliers = found.z[len(found.z) - 3 * len(round_) :].reshape(-1, 3)
        local = found.x[: 3 * len(self.half_angles)].reshape(-1, 3)[round_]
        changes = cone_factors(self.half_angles[round_] + RIGHT_ANGLE) * local
        return float((multipliers * changes).sum())

    def closing(self, x: Floats) -> ClosingForces:
        """Forces of a solution, with all equations solved but for rounding."""
        grasp = self.pressed.grasp
        forces = 3 * grasp.contacts.count
        fixed, x = self.program.matrix[: self.program.equations - 1, :-1], x[:-1]
        sizes = np.linalg.norm(x[:forces].reshape(-1, 3), axis=1)
        none, room = sizes < CLEAR * sizes.max(), self.pressed.drives @ x
        unpressed = np.eye(len(x))[:forces][np.repeat(none, 3)]
        fixed = np.concatenate([fixed, self.pressed.drives[room < CLEAR * sizes.max()], unpressed])
        x = x - np.linalg.lstsq(fixed, fixed @ x, rcond=RANK)[0]
        local = x[:forces].reshape(-1, 3, 1)
        local[none] = 0.0
        pressed = (np.swapaxes(grasp.frames, 1, 2) @ local)[..., 0]
        return ClosingForces(pressed, x[forces:-1], float(x[-1]))

    def motions(self, z: Floats) -> SeparatingMotions:
        """Motions of object and joints in the multipliers of a solution."""
        grasp, actuation = self.pressed.grasp, self.pressed.grasp.actuation
        balance, combined = self.pressed.balance
        statics = combined @ z[: len(balance)]
        kept = int(self.still.sum())
        after = self.program.equations
        pulls = np.zeros(len(self.still))
        pulls[self.still] = -z[len(balance) : len(balance) + kept]
        pulls[~self.still] = z[after : after + len(pulls) - kept]
        pulls[np.abs(pulls) <= ADMISSIBLE * pulls.max(initial=1.0)] = 0.0
        joints, relative = self.pressed.motions
        rank, pulled = len(grasp.span), len(joints.T) - actuation.undriven.shape[1]
        parts = np.concatenate([-grasp.span @ statics[:6], pulls[:pulled], statics[6:-1]])
        # Where an object nearly stands still at a contact it does so but for rounding.
        moved = parts != 0.0
        moved[:rank] = moved[rank + pulled :] = True
        joints, relative, parts = joints[:, moved[rank:]], relative[:, moved], parts[moved]
        sizes = np.linalg.norm((relative @ parts).reshape(-1, 3), axis=1)
        rows = relative[np.repeat(sizes <= STANDING * sizes.max(), 3)]
        if len(rows):
            parts -= np.linalg.lstsq(rows, rows @ parts, rcond=RANK)[0]
        twist = parts[:rank] @ grasp.span
        twist[3:] /= grasp.length
        return SeparatingMotions(twist, joints @ parts[rank:] * (grasp.force / grasp.torque))

    def forbidden(self, z: Floats) -> tuple[Bools, Bools]:
        """Contacts whose forces multipliers forbid, and drives that they keep at bounds."""
        after = self.program.equations
        still = self.still.copy()
        count = int((~still).sum())
        still[~self.still] = z[after : after + count] > FORBIDDEN
        rays = np.flatnonzero(np.abs(self.half_angles) <= POINTED)
        unpressed = np.zeros(len(self.half_angles), dtype=np.bool_)
        blocks = z[after + self.program.inequalities :].reshape(-1, 3)
        strict = blocks[:, 0] - np.linalg.norm(blocks[:, 1:], axis=1) > FORBIDDEN
        unpressed[self._cones.round[strict]] = True
        unpressed[rays] = z[after + count : after + count + len(rays)] > FORBIDDEN
        return unpressed, still
