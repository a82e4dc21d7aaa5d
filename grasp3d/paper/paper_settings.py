"""Settings of the recomputation; the defaults are the paper's own."""

import math
from dataclasses import dataclass

import numpy as np

from grasp3d.arrays import Floats
from grasp3d.errors import SettingError
from grasp3d.settings import DEGREE, GraspModel

WIDEST = 120.0 * DEGREE
"""Largest resolution of the swept fractions [rad]."""
COLUMNS = 2
"""Most resolutions that fit side by side on a page."""

STEPS = 480
"""Steps of the swept resolutions: a quarter of a degree each."""


@dataclass(frozen=True)
class PaperSettings:
    """Friction, and the resolutions at which curves and pictures are drawn.

    Attributes:
        friction: Coulomb coefficient, above 0.
        sensor_resolutions: Resolutions alpha [rad], one or two, each with a column of the figures.
    """

    friction: float = 1.0
    sensor_resolutions: tuple[float, ...] = (30.0 * DEGREE, 15.0 * DEGREE)

    def __post_init__(self) -> None:
        if not 1 <= len(self.sensor_resolutions) <= COLUMNS:
            raise SettingError(
                f"give one or two sensor resolutions; got {len(self.sensor_resolutions)}"
            )
        if len(set(self.sensor_resolutions)) < len(self.sensor_resolutions):
            degrees = ", ".join(f"{math.degrees(angle):g}" for angle in self.sensor_resolutions)
            raise SettingError(f"sensor resolutions must be different; got {degrees}")
        _ = self.models

    @property
    def models(self) -> tuple[GraspModel, ...]:
        """Models of the one friction at each resolution."""
        return tuple(
            GraspModel(friction=self.friction, sensor_resolution=angle)
            for angle in self.sensor_resolutions
        )

    @property
    def swept(self) -> Floats:
        """Resolutions over which fractions are drawn [rad], shape (k,)."""
        return np.linspace(0.0, WIDEST, STEPS + 1)
