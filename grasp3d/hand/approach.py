"""Which approach directions are tried, and which are allowed."""

import math
from dataclasses import dataclass

import numpy as np

from grasp3d.arrays import Floats, locked
from grasp3d.errors import SettingError
from grasp3d.hand.choices import check_approach


@dataclass(frozen=True, eq=False)
class Approach:
    """Approach directions: a cone about one direction, in the frame of the mesh."""

    direction: Floats | None = None
    """The direction in which the gripper would best move, shape (3,); None: into the table, or
    any direction where there is no table."""
    within: float = math.pi
    """Largest angle between it and the approach direction [rad]."""
    angles: int = 32
    """Angles about the closing axis that are tested, 8 to 64."""

    def __post_init__(self) -> None:
        if self.direction is not None:
            direction = np.asarray(self.direction, dtype=np.float64)
            length = float(np.linalg.norm(direction)) if direction.shape == (3,) else math.nan
            if not (math.isfinite(length) and length > 0.0):
                raise SettingError(
                    f"an approach direction must be three finite numbers; got {self.direction}"
                )
            object.__setattr__(self, "direction", locked(direction / length))
        check_approach(self.within, self.angles)
