"""Simulation of one grasp: the gripper closes on the object and presses; six pulls follow.

The protocol is that of DexGraspBench (Chen et al., 2025): the object floats, is squeezed, and is
then pulled by its weight, or more, along each of six directions, here those of the gripper's axes.
The object counts as held if it stays within 5 cm and 15 degrees of its pose after the squeeze.

Hard fingers resist no torque about the line through their contacts, whatever the label, as forces
at two points of a line have no moment about it. So only the turn of that line counts for hard
fingers. With pads, or a torsion radius, any turn of the object counts.
"""

import math
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

import mujoco
import numpy as np

from grasp3d.arrays import Floats, short_repr
from grasp3d.outcomes.scene import (
    CLOSING,
    JOINTS,
    OBJECT,
    Stage,
    lay_object,
    put_object,
    without_log,
)
from grasp3d.outcomes.simulation_settings import SimulationSettings

RAMP, WAITING = 0.2, 0.3
"""Times in which the grip force grows, and from then until the first pull [s]."""

YIELDING = 0.3
"""Longest time for which an object gives way to the open gripper [s]."""

CLEAR = 2e-4
"""Depth to which the open gripper may overlap an object that has given way [m]."""

CHECKED = 0.01
"""Time between two checks of the object [s]."""

PULLS = np.concatenate([np.eye(3), -np.eye(3)])[[0, 3, 1, 4, 2, 5]]
"""Directions of the pulls in the gripper's frame: x, -x, y, -y, z, -z."""


class Fate(StrEnum):
    """How a simulated grasp ended."""

    HELD = "held"
    """The object was held through all pulls."""
    PULLED = "pulled"
    """The object was held after the squeeze, but not through every pull."""
    LOST = "lost"
    """Both fingers touched the object, but it slipped or turned away during the squeeze."""
    MISSED = "missed"
    """The two fingers never touched the object at the same time."""
    BLOCKED = "blocked"
    """The open gripper overlaps the object by more than the object gives way."""
    BROKEN = "broken"
    """The simulation became unstable; it says nothing about the grasp."""


@dataclass(frozen=True, eq=False)
class Attempt:
    """One grasp to simulate."""

    pose: Floats
    """Matrix that takes the gripper's coordinates to the object's [m], shape (4, 4)."""
    opening: float
    """Distance of the fingers before they close [m]."""
    friction: float
    """Coulomb coefficient."""

    __repr__ = short_repr


@dataclass(frozen=True)
class Outcome:
    """Outcome of a grasp; its numbers are columns of the results."""

    fate: Fate
    pulls_held: int = 0
    """Number of pulls through which the object was held, of 6."""
    slip_m: float = 0.0
    """Largest shift of a touched point of the object from its finger, over all pulls [m]."""
    pull_shift_m: float = 0.0
    """Largest shift of the object's centre of mass, over all pulls [m]."""
    pull_turn: float = 0.0
    """Largest turn of the object [rad]; without torsion, that of its closing axis."""
    start_shift_m: float = 0.0
    """Shift of the centre of mass when the object gave way to the open gripper [m]."""
    squeeze_shift_m: float = 0.0
    """Shift of the centre of mass during the squeeze [m]."""
    squeeze_turn: float = 0.0
    """Turn of the object during the squeeze [rad]."""


@without_log()
def simulate_attempt(model: Any, data: Any, attempt: Attempt, stage: Stage) -> Outcome:
    """Close the fingers on the object, press, and pull.

    Args:
        model: Model from `grasp_model`; changed.
        data: Data of the model; changed.
        attempt: The grasp.
        stage: The gripper of the model, and forces, times and limits.
    """
    settings = stage.settings
    put_object(model, data, attempt.pose, attempt.friction)
    data.qpos[7:9] = -0.5 * attempt.opening
    mujoco.mj_forward(model, data)
    start_shift = _give_way(model, data, settings)
    if math.isinf(start_shift):
        return Outcome(Fate.BLOCKED)
    lay_object(model, stage)
    watch, time = _Watch(model, data, stage), 0.5 * attempt.opening / CLOSING + RAMP + WAITING
    watch.run(time, anywhere=True)
    touched, squeezed = watch.touched, watch.now
    lay_object(model, None)
    watch.begin()
    held = _pulls(model, data, watch, settings) if watch.touched and watch.finite else 0
    if not watch.finite:
        fate = Fate.BROKEN
    elif not watch.touched:
        fate = Fate.LOST if touched else Fate.MISSED
    else:
        fate = Fate.HELD if held == len(PULLS) else Fate.PULLED
    return Outcome(fate, held, watch.slip, *watch.largest, start_shift, *squeezed)


def _give_way(model: Any, data: Any, settings: SimulationSettings) -> float:
    """Push the object slowly out of the open gripper; return its shift [m].

    inf: the gripper overlaps it by more than it gives way, or it has no way out.
    """
    body = model.body(OBJECT).id
    if _depth(data) > settings.give_way + settings.pose_error.position:
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
    """Depth of the gripper in the object [m]; 0 if they do not overlap."""
    return max(0.0, -float(data.contact.dist.min())) if data.ncon else 0.0


def _pulls(model: Any, data: Any, watch: "_Watch", settings: SimulationSettings) -> int:
    """Pull in every direction, each time from the squeezed state; return the pulls that hold."""
    kind = mujoco.mjtState.mjSTATE_INTEGRATION
    state = np.empty(mujoco.mj_stateSize(model, kind))
    mujoco.mj_getState(model, data, state, kind)
    held = 0
    for direction in PULLS:
        mujoco.mj_setState(model, data, state, kind)
        data.xfrc_applied[model.body(OBJECT).id, :3] = settings.pull * direction
        held += watch.run(settings.pull_time)
    return held


class _Watch:
    """Record of how far the object has moved, and its contacts have slipped, since the touch."""

    def __init__(self, model: Any, data: Any, stage: Stage) -> None:
        self._model, self._data, self._stage = model, data, stage
        self._body = model.body(OBJECT).id
        self._tips = [model.body(name).id for name in JOINTS]
        self.finite = True
        self.begin()

    def begin(self) -> None:
        """Forget the touched points, and measure motions from the current state on."""
        self._start = np.array(self._data.xipos[self._body])
        self._turned = np.array(self._data.qpos[3:7])
        self._points: Floats | None = None
        self.slip, self.now, self.largest = 0.0, (0.0, 0.0), (0.0, 0.0)
        """Largest slip [m]; shift [m] and turn [rad] now, and the largest ones so far."""
        self._touch()

    @property
    def touched(self) -> bool:
        """Whether both fingers have touched the object."""
        return self._points is not None

    def run(self, seconds: float, *, anywhere: bool = False) -> bool:
        """Simulate until the object has moved too far; return whether it stayed within the limits.

        Args:
            seconds: Time to simulate.
            anywhere: Whether the limits are ignored.
        """
        data, step = self._data, self._stage.settings.time_step
        left, every = math.ceil(seconds / step), max(1, round(CHECKED / step))
        while left > 0:
            data.ctrl[:] = self._stage.force * min(1.0, (data.time + step) / RAMP)
            count = min(every, left) if self.touched else 1
            mujoco.mj_step(self._model, data, count)
            left -= count
            if not self.touched:
                self._touch()
            if not self._look() and not (anywhere and self.finite):
                return False
        return True

    def _touch(self) -> None:
        """Store where the fingers touch the object, as soon as both do."""
        data = self._data
        bodies, points = self._model.geom_bodyid[data.contact.geom], data.contact.pos
        of_tips = [points[(bodies == tip).any(axis=1)] for tip in self._tips]
        if all(map(len, of_tips)):
            middles = np.array([one.mean(axis=0) for one in of_tips])  # (2, 3)
            rotation = data.xmat[self._body].reshape(3, 3)
            self._points = (middles - data.xpos[self._body]) @ rotation
            self._from_tips = middles - data.xpos[self._tips]

    def _look(self) -> bool:
        """Measure shift and turn; return whether the object is within the limits."""
        data, settings = self._data, self._stage.settings
        shift, turn = float(np.linalg.norm(data.xipos[self._body] - self._start)), self._turn()
        self.now, self.finite = (shift, turn), not data.warning.number.any() and shift < math.inf
        if not self.finite:
            return False
        self.largest = max(shift, self.largest[0]), max(turn, self.largest[1])
        if self._points is not None:
            rotation = data.xmat[self._body].reshape(3, 3)
            points = self._points @ rotation.T + data.xpos[self._body] - data.xpos[self._tips]
            distances = np.linalg.norm(points - self._from_tips, axis=1)
            self.slip = max(self.slip, float(distances.max()))
        return shift < settings.max_shift and turn < settings.max_turn

    def _turn(self) -> float:
        """Turn since the touch, of the object or of its closing axis only [rad]."""
        back, relative = np.zeros(4), np.zeros(4)
        mujoco.mju_negQuat(back, self._turned)
        mujoco.mju_mulQuat(relative, self._data.qpos[3:7], back)
        w, x, y, z = relative
        if self._stage.fingers.soft:
            return 2.0 * math.atan2(math.hypot(x, y, z), abs(w))
        return 2.0 * math.atan2(math.hypot(y, z), math.hypot(w, x))
