"""One simulated grasp: the tips close on the object and press, then it is pulled six times.

The protocol is that of DexGraspBench (Chen et al., 2025): the object floats, is squeezed, and is
then pulled by its weight, or more, along each of six directions, here those of the gripper's axes.
The object is held where it stays within 5 cm and 15 degrees of where the tips touched it.

That alone does not say that the labelled grasp holds: an object between two tips may slip and turn
until it sits in a better grasp, and stay there. So the contacts are watched as well: a grasp holds
where the points of the object that the tips touched stay at the tips.

Two hard fingers resist no torque about the line through their contacts, whatever the label: forces
at two points of a line have no moment about it. So pulls act on that line, unless the settings say
otherwise, and the turn of hard fingers' objects is that of the line; how far the object spins about
it is reported beside it. With a torsion radius, which real tips have, any turn counts.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

import numpy as np

from grasp3d.arrays import Floats, short_repr
from grasp3d.physics.engine import mujoco_module, without_log
from grasp3d.physics.scene import JOINTS, OBJECT, Stage, Tips, lay_object, put_object
from grasp3d.physics.simulation_settings import SimulationSettings

RAMP, WAITING = 0.2, 0.3
"""Time in which the grip force grows, and then until the first pull [s]."""

YIELDING = 0.3
"""Longest time in which an object gives way to the open gripper [s]."""

CLEAR = 2e-4
"""Depth to which the open gripper may still be in an object that gave way [m]."""

CHECKED = 0.01
"""Time between two looks at the object [s]."""

PULLS = np.concatenate([np.eye(3), -np.eye(3)])[[0, 3, 1, 4, 2, 5]]
"""Directions of the pulls in the gripper's frame: x, -x, y, -y, z, -z."""


class Fate(StrEnum):
    """How a simulated grasp ended."""

    HELD = "held"
    """Through all pulls, at the contacts where it was touched."""
    REGRASPED = "regrasped"
    """The object was held, but the contacts slipped first: another grasp holds it."""
    PULLED = "pulled"
    """The object was held while it was squeezed, but not through each pull."""
    LOST = "lost"
    """The object slipped or turned away while it was squeezed."""
    MISSED = "missed"
    """The two tips never touched the object at once."""
    BLOCKED = "blocked"
    """The open gripper is in the object before it closes, by more than it gives way."""
    BROKEN = "broken"
    """The simulation became unstable; it says nothing about the grasp."""


@dataclass(frozen=True, eq=False)
class Attempt:
    """One grasp to simulate; lengths in metres."""

    pose: Floats
    """Matrix that takes the gripper's coordinates to the object's, shape (4, 4)."""
    opening: float
    """Distance of the contacts at which the tips begin to close."""
    center: Floats
    """Centre of mass, on which the pulls act, in the object's frame, shape (3,)."""
    friction: Floats
    """Coulomb coefficient of each tip, shape (2,)."""
    may_move: bool = False
    """Whether the object may move while the tips close: it gives way to the open gripper, lies with
    friction until it is held, and is watched from after the squeeze on."""

    __repr__ = short_repr


@dataclass(frozen=True)
class Outcome:
    """What became of a grasp."""

    fate: Fate
    pulls_held: int
    """Number of pulls that it held, of 6."""
    shift: float
    """Farthest shift of the object's centre of mass [m], of all pulls, or until it was lost."""
    turn: float
    """Largest turn of the object [rad]; without torsion that of its closing axis."""
    spin: float
    """Largest turn of the object about the closing axis [rad]."""
    squeeze_shift: float
    """Shift of the centre of mass after the squeeze [m]."""
    squeeze_turn: float
    """Turn of the object after the squeeze [rad]."""
    slip: float
    """Farthest shift of a touched point of the object from its tip [m]."""
    start_shift: float = 0.0
    """Shift of the centre of mass by which it gave way to the open gripper [m]."""

    @property
    def held(self) -> bool:
        """Whether the object was held, in this grasp or another."""
        return self.fate in {Fate.HELD, Fate.REGRASPED}


@without_log()
def simulate_attempt(model: Any, data: Any, attempt: Attempt, stage: Stage) -> Outcome:
    """Close the tips on the object, press, and pull.

    Args:
        model: From `grasp_model`; changed.
        data: Its data.
        attempt: The grasp.
        stage: The tips of the model, and forces, times and limits.
    """
    mujoco, tips, settings = mujoco_module(), stage.tips, stage.settings
    put_object(model, data, attempt.pose, attempt.center, attempt.friction)
    data.qpos[7:9] = -(0.5 * attempt.opening + tips.radius)
    mujoco.mj_forward(model, data)
    start_shift = 0.0
    if attempt.may_move:
        start_shift = _give_way(model, data, settings)
        if math.isinf(start_shift):
            return Outcome(Fate.BLOCKED, 0, *(0.0,) * 6)
        lay_object(model, stage)
    watch = _Watch(model, data, settings, tips)
    way = 0.5 * attempt.opening / tips.speed if attempt.may_move else 0.0
    steps = math.ceil((way + RAMP + WAITING) / settings.time_step)

    def squeeze(step: int) -> None:
        data.ctrl[:] = settings.force * min(1.0, (step + 1) * settings.time_step / RAMP)

    held = watch.run(steps, squeeze, anywhere=attempt.may_move)
    squeezed = watch.shift, watch.turn
    lay_object(model, None)
    if attempt.may_move and watch.touched and watch.finite:
        held = watch.restart()
    pulls = _pulls(model, data, watch, settings) if held and watch.touched else 0
    fate = watch.fate(held=held, pulls=pulls)
    return Outcome(fate, pulls, *watch.largest, *squeezed, watch.slip, start_shift)


def _give_way(model: Any, data: Any, settings: SimulationSettings) -> float:
    """Push the object out of the open gripper, slowly; shift of its centre of mass [m].

    inf: the gripper is in it by more than it gives way, or it has no way out.
    """
    mujoco, body = mujoco_module(), model.body(OBJECT).id
    if _depth(data) > settings.may_yield:
        return math.inf
    start, fingers = np.array(data.xipos[body]), np.array(data.qpos[7:])
    for _ in range(math.ceil(YIELDING / settings.time_step)):
        if _depth(data) <= CLEAR:
            break
        mujoco.mj_step(model, data)
        data.qvel[:] = 0.0  # without inertia: it moves no farther than it is pushed
        data.qpos[7:] = fingers
    else:
        return math.inf
    data.qacc_warmstart[:] = 0.0
    data.time = 0.0
    mujoco.mj_forward(model, data)
    return float(np.linalg.norm(data.xipos[body] - start))


def _depth(data: Any) -> float:
    """How deep the gripper is in the object [m]; 0: it is not."""
    return max(0.0, -float(data.contact.dist.min())) if data.ncon else 0.0


def _pulls(model: Any, data: Any, watch: "_Watch", settings: SimulationSettings) -> int:
    """Pull in every direction, each time from the squeezed state; number of pulls that hold."""
    mujoco = mujoco_module()
    body = model.body(OBJECT).id
    kind = mujoco.mjtState.mjSTATE_INTEGRATION
    state = np.empty(mujoco.mj_stateSize(model, kind))
    mujoco.mj_getState(model, data, state, kind)
    steps, held = math.ceil(settings.pull_time / settings.time_step), 0
    for direction in PULLS:
        mujoco.mj_setState(model, data, state, kind)
        pull = settings.pull * direction

        def act(_step: int, pull: Floats = pull) -> None:
            data.xfrc_applied[body, :3] = pull
            if settings.pulled == "line":
                data.xfrc_applied[body, 3:] = _cross(watch.lever, pull)

        held += watch.run(steps, act)
    return held


def _cross(a: Floats, b: Floats) -> tuple[float, float, float]:
    """Cross product of two vectors; NumPy's takes longer than a step of the simulation."""
    (ax, ay, az), (bx, by, bz) = a.tolist(), b.tolist()
    return ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx


class _Watch:
    """Looks at how far the object has moved, and its contacts slipped, since it was touched."""

    def __init__(self, model: Any, data: Any, settings: SimulationSettings, tips: Tips) -> None:
        self._model, self._data, self._settings = model, data, settings
        self._soft = tips.soft
        self._body = model.body(OBJECT).id
        self._tips = [model.body(name).id for name in JOINTS]
        self._from_tips = np.zeros((2, 3))
        self.shift, self.turn, self.finite = 0.0, 0.0, True
        self._begin()

    def _begin(self) -> None:
        """Forget what was touched, and measure motions from the current state on."""
        self._start = np.array(self._data.xipos[self._body])
        self._turned = np.array(self._data.qpos[3:7])
        self._touched: Floats | None = None
        self.slip, self.largest = 0.0, (0.0, 0.0, 0.0)
        """Farthest slip [m]; largest shift [m], turn and spin [rad] so far."""

    @property
    def touched(self) -> bool:
        """Whether both tips have touched the object."""
        return self._touched is not None

    @property
    def lever(self) -> Floats:
        """From the centre of mass to the middle of the touched points [m], shape (3,)."""
        assert self._touched is not None
        data, rotation = self._data, self._data.xmat[self._body].reshape(3, 3)
        middle = rotation @ self._touched.mean(axis=0) + data.xpos[self._body]
        return np.asarray(middle - data.xipos[self._body])

    def restart(self) -> bool:
        """Watch from the current state on; returns whether both tips touch the object in it."""
        self._begin()
        self._touch()
        return self.touched

    def fate(self, *, held: bool, pulls: int) -> Fate:
        """How a grasp ended.

        Args:
            held: Whether the object was within the limits after the squeeze.
            pulls: Number of pulls that it held.
        """
        if not self.finite:
            return Fate.BROKEN
        if not self.touched:
            return Fate.MISSED
        if not held:
            return Fate.LOST
        if pulls < len(PULLS):
            return Fate.PULLED
        return Fate.HELD if self.slip < self._settings.max_slip else Fate.REGRASPED

    def run(self, steps: int, each: Callable[[int], None], *, anywhere: bool = False) -> bool:
        """Simulate steps until the object has moved too far; returns whether it has not.

        Args:
            steps: Number of steps.
            each: Called with the number of the next step: before every step until both tips touch,
                then before every look.
            anywhere: Whether it may move as far as it likes.
        """
        mujoco = mujoco_module()
        every = max(1, round(CHECKED / self._settings.time_step))
        step = 0
        while step < steps:
            each(step)
            count = min(every, steps - step) if self.touched else 1
            mujoco.mj_step(self._model, self._data, count)
            step += count
            if not self.touched:
                self._touch()
            if not self._look() and not (anywhere and self.finite):
                return False
        return True

    def _touch(self) -> None:
        """Remember where the tips touch the object, as soon as both do."""
        data = self._data
        if data.ncon < len(self._tips):
            return
        bodies, points = self._model.geom_bodyid[data.contact.geom], data.contact.pos
        of_tips = [points[(bodies == tip).any(axis=1)] for tip in self._tips]
        if all(map(len, of_tips)):
            points = np.array([one.mean(axis=0) for one in of_tips])  # (2, 3)
            rotation = data.xmat[self._body].reshape(3, 3)
            self._touched = (points - data.xpos[self._body]) @ rotation
            self._from_tips = points - data.xpos[self._tips]

    def _look(self) -> bool:
        """Whether the object is still within the limits."""
        data, settings = self._data, self._settings
        self.shift = float(np.linalg.norm(data.xipos[self._body] - self._start))
        self.turn, spin = self._turns()
        self.finite = math.isfinite(self.shift) and not data.warning.number.any()
        if not self.finite:
            return False
        shift, turn, most = self.largest
        self.largest = max(shift, self.shift), max(turn, self.turn), max(most, spin)
        if self._touched is not None:
            rotation = data.xmat[self._body].reshape(3, 3)
            points = self._touched @ rotation.T + data.xpos[self._body] - data.xpos[self._tips]
            distances = np.linalg.norm(points - self._from_tips, axis=1)
            self.slip = max(self.slip, float(distances.max()))
        return self.shift < settings.max_shift and self.turn < settings.max_turn

    def _turns(self) -> tuple[float, float]:
        """Turn that counts, and spin about the closing axis, since the touch [rad]."""
        mujoco = mujoco_module()
        back, relative = np.zeros(4), np.zeros(4)
        mujoco.mju_negQuat(back, self._turned)
        mujoco.mju_mulQuat(relative, self._data.qpos[3:7], back)
        w, x, y, z = relative
        spin, swing = (
            2.0 * math.atan2(abs(x), abs(w)),
            2.0 * math.atan2(math.hypot(y, z), math.hypot(w, x)),
        )
        return (2.0 * math.atan2(math.hypot(x, y, z), abs(w)) if self._soft else swing), spin
