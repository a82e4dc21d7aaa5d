"""Settings of simulated grasps."""

import math
from dataclasses import dataclass
from typing import Literal

from grasp3d.settings import DEGREE, Radians, check_choice
from grasp3d.settings.checks import LARGEST_SEED, check_length, check_range
from grasp3d.settings.pose_error import PoseError, PoseErrorField
from grasp3d.settings.units import FORCES, MASSES, STIFFNESSES, Length, LengthSettings, Quantity

Pulled = Literal["line", "center_of_mass"]
MAX_GRASPS = 100_000
MAX_TRIALS = 1000
MIN_THRESHOLD, MAX_THRESHOLD = 0.005, 1.0
GRAVITY = 9.80665
"""Standard acceleration of gravity [m/s^2]."""


@dataclass(frozen=True)
class SimulationSettings(LengthSettings):
    """How grasps are drawn, and how they are simulated.

    A length is in metres, or has a unit: '3mm'; see `Length`.

    Attributes:
        count: Grasps that are drawn from the surface, as many of each label, from 3.
        tip_radius: Radius of round tips without a gripper, a length.
        object_mass: Mass of the object [kg], or with a unit: 100g.
        grip_ratio: Force of each finger, as a multiple of the object's weight, above 0.5. Labels
            are about directions of forces: at 50 a pull by the weight turns them by 0.6 degrees.
        grip_force: Force of each finger [N], or with a unit: 40N. none: grip_ratio times the
            weight.
        pull_acceleration: Acceleration with which the object is pulled beside that of gravity
            [m/s^2].
        pad_stiffness: Stiffness of a gripper's pad that is pressed on its whole face [N/m], or with
            a unit: 300N/mm. Each part of it gives way by itself; a round tip does as a whole.
        pose_error: How wrong given poses are, such as 5mm,3deg: each is simulated at true poses
            that are drawn around it, normally distributed with half of it as standard deviation.
        trials: True poses that are drawn for each given one.
        give_way: Depth to which the open gripper may be in the object, besides the pose error: the
            object gives way to it. A length.
        pulled: Where the pulls act. line: at a centre of mass midway between the contacts, where
            two points can resist them; center_of_mass: at the object's centre of mass, whose moment
            about the line only torsion resists.
        pull_time: Time of each of the six pulls [s].
        max_slip: Shift of a touched point of the object from its tip, a length, from which the
            contacts have slipped, and the grasp has failed even if another one holds the object.
        max_shift: Shift of the object from where it was touched, a length, from which it is not
            held.
        max_turn: The same as an angle.
        part_threshold: Concavity below which a convex part is not divided further, as a fraction of
            the object's size, 0.005 to 1.
        part_angle: Largest angle between the normals of the mesh and of its convex parts at drawn
            contacts: elsewhere another shape would be simulated.
        time_step: Step of the simulation [s].
        seed: Seed of what is drawn, and of the convex parts; the same seed gives the same result.

    Example:
        >>> from grasp3d.physics import SimulationSettings
        >>> SimulationSettings(count=300, object_mass="200 g").object_mass
        0.2
    """

    count: int = 60
    tip_radius: Length[float] = Length(0.003)
    object_mass: Quantity[float] = Quantity(0.1, MASSES)
    grip_ratio: float = 50.0
    grip_force: Quantity[float | None] = Quantity(None, FORCES)
    pull_acceleration: float = 0.0
    pad_stiffness: Quantity[float] = Quantity(3e5, STIFFNESSES)
    pose_error: PoseErrorField = PoseErrorField(PoseError())
    trials: int = 1
    give_way: Length[float] = Length(0.001)
    pulled: Pulled = "line"
    pull_time: float = 2.0
    max_slip: Length[float] = Length(0.001)
    max_shift: Length[float] = Length(0.05)
    max_turn: Radians = 15.0 * DEGREE
    part_threshold: float = 0.02
    part_angle: Radians = 3.0 * DEGREE
    time_step: float = 1e-3
    seed: int = 0

    def __post_init__(self) -> None:
        super().__post_init__()
        check_range("count", self.count, 3, MAX_GRASPS)
        check_range("trials", self.trials, 1, MAX_TRIALS)
        check_range("pull_acceleration", self.pull_acceleration, 0.0, 1e3)
        check_length("give_way", self.give_way)
        check_choice("pulled", self.pulled, Pulled)
        for name in ("tip_radius", "max_slip", "max_shift"):
            check_length(name, getattr(self, name), above=True)
        self._check_numbers()
        check_range("simulation seed", self.seed, 0, LARGEST_SEED)

    def _check_numbers(self) -> None:
        """Refuse numbers and angles that are outside their range."""
        for name, least, most in (
            ("grip_ratio", 0.5, 1e4), ("pull_time", 0.0, 60.0), ("time_step", 0.0, 2e-3),
        ):  # fmt: skip
            check_range(name, getattr(self, name), least, most, ends="(]")
        check_range("part_threshold", self.part_threshold, MIN_THRESHOLD, MAX_THRESHOLD)
        for name in ("max_turn", "part_angle"):
            check_range(name, getattr(self, name), 0.0, math.pi, ends="(]", degrees=True)

    @property
    def weight(self) -> float:
        """Weight of the object [N]."""
        return self.object_mass * GRAVITY

    @property
    def pull(self) -> float:
        """Force of each pull [N]."""
        return self.object_mass * (GRAVITY + self.pull_acceleration)

    @property
    def may_yield(self) -> float:
        """Depth of the open gripper in the object to which it gives way [m]."""
        return float(self.give_way + self.pose_error.position)

    @property
    def force(self) -> float:
        """Force of each finger along the closing axis [N]."""
        return self.grip_ratio * self.weight if self.grip_force is None else self.grip_force
