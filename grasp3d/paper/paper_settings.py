"""What the paper is recomputed for; its own settings are the defaults."""

import math
from dataclasses import dataclass

import numpy as np

from grasp3d.arrays import Floats
from grasp3d.errors import SettingError
from grasp3d.settings import DEGREE, GraspModel

WIDEST = 120.0 * DEGREE
"""Where the shares over the resolution end [rad]."""
COLUMNS = 2
"""Most resolutions that fit beside one another on a page."""

STEPS = 480
"""Resolutions between which the shares are drawn as lines; every quarter of a degree."""


@dataclass(frozen=True)
class PaperSettings:
    """Friction, and the resolutions at which curves and pictures are drawn."""

    friction: float = 1.0
    """Coulomb coefficient, above 0."""
    sensor_resolutions: tuple[float, ...] = (30.0 * DEGREE, 15.0 * DEGREE)
    """Resolutions alpha [rad], one or two: a column of the figures each."""

    def __post_init__(self) -> None:
        if not 1 <= len(self.sensor_resolutions) <= COLUMNS:
            raise SettingError(
                f"name one or two sensor resolutions; got {len(self.sensor_resolutions)}"
            )
        if len(set(self.sensor_resolutions)) < len(self.sensor_resolutions):
            degrees = ", ".join(f"{math.degrees(angle):g}" for angle in self.sensor_resolutions)
            raise SettingError(f"each sensor resolution must be named once; got {degrees}")
        _ = self.models

    @property
    def models(self) -> tuple[GraspModel, ...]:
        """The same friction at each resolution."""
        return tuple(
            GraspModel(friction=self.friction, sensor_resolution=angle)
            for angle in self.sensor_resolutions
        )

    @property
    def swept(self) -> Floats:
        """Resolutions over which shares are drawn [rad], shape (k,)."""
        return np.linspace(0.0, WIDEST, STEPS + 1)
