"""Settings of simulated grasps."""

import math
from dataclasses import dataclass

from grasp3d.settings import DEGREE, Radians
from grasp3d.settings.checks import LARGEST_SEED, check_length, check_range
from grasp3d.settings.pose_error import PoseError, PoseErrorField
from grasp3d.settings.units import FORCES, MASSES, STIFFNESSES, Length, LengthSettings, Quantity

GRAVITY = 9.80665
"""Standard acceleration of gravity [m/s^2]."""


@dataclass(frozen=True)
class SimulationSettings(LengthSettings):
    """How grasps of a gripper are simulated.

    A length is in metres, or has a unit: '3mm'; see `Length`.

    Attributes:
        count: Number of best grasps that are simulated if none are given.
        object_mass: Mass of the object [kg], or with a unit: 100g.
        grip_force: Force of each finger [N], or with a unit: 40N. none: the largest force of the
            gripper, or 40 N if it states none.
        pull_acceleration: Acceleration with which the object is pulled, in addition to gravity
            [m/s^2].
        pad_stiffness: Stiffness of a gripper's pad that is pressed on its whole face [N/m], or with
            a unit: 300N/mm. Each part of a pad gives way independently; a round tip gives way as a
            whole.
        pose_error: Error of the poses, such as 5mm,3deg. Each pose is simulated at true poses drawn
            from a normal distribution about it; the error is two standard deviations.
        trials: Trials of each pose, each with its own true pose and true friction.
        give_way: Depth, added to the pose error, by which the open gripper may overlap the object,
            which is then pushed aside. A length.
        pull_time: Time of each of the six pulls [s].
        max_shift: Largest shift of a held object from where it was squeezed, a length.
        max_turn: Largest turn of a held object.
        part_threshold: CoACD's concavity, with the object scaled to a longest side of 2, below
            which a part is not divided further, 0.005 to 1.
        time_step: Step of the simulation [s].
        seed: Seed of random draws and of the convex parts; the same seed gives the same result.

    Example:
        >>> from grasp3d.outcomes import SimulationSettings
        >>> SimulationSettings(trials=3, object_mass="200 g").object_mass
        0.2
    """

    count: int = 10
    object_mass: Quantity[float] = Quantity(0.1, MASSES)
    grip_force: Quantity[float | None] = Quantity(None, FORCES)
    pull_acceleration: float = 0.0
    pad_stiffness: Quantity[float] = Quantity(3e5, STIFFNESSES)
    pose_error: PoseErrorField = PoseErrorField(PoseError())
    trials: int = 1
    give_way: Length[float] = Length(0.001)
    pull_time: float = 2.0
    max_shift: Length[float] = Length(0.05)
    max_turn: Radians = 15.0 * DEGREE
    part_threshold: float = 0.02
    time_step: float = 1e-3
    seed: int = 0

    def __post_init__(self) -> None:
        super().__post_init__()
        check_range("count", self.count, 1, 1000)
        check_range("trials", self.trials, 1, 1000)
        check_range("pull_acceleration", self.pull_acceleration, 0.0, 1e3)
        check_length("give_way", self.give_way)
        check_length("max_shift", self.max_shift, above=True)
        check_range("pull_time", self.pull_time, 0.0, 60.0, ends="(]")
        check_range("time_step", self.time_step, 0.0, 2e-3, ends="(]")
        check_range("part_threshold", self.part_threshold, 0.005, 1.0)
        check_range("max_turn", self.max_turn, 0.0, math.pi, ends="(]", degrees=True)
        check_range("simulation seed", self.seed, 0, LARGEST_SEED)

    @property
    def weight(self) -> float:
        """Weight of the object [N]."""
        return self.object_mass * GRAVITY

    @property
    def pull(self) -> float:
        """Force of each pull [N]."""
        return self.object_mass * (GRAVITY + self.pull_acceleration)
