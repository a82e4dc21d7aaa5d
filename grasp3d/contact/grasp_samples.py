"""Grasps of two fingers that a finger is designed for."""

import math
from dataclasses import dataclass

import numpy as np

from grasp3d.arrays import ArrayLike, short_repr
from grasp3d.errors import SettingError


@dataclass(frozen=True, eq=False)
class GraspSamples:
    """Grasps of two fingers that a design is for: one, or those of an object's surface.

    Example:
        >>> import grasp3d
        >>> from grasp3d.contact import FingerDesign, GraspSamples
        >>> grasps = GraspSamples(critical_angle=[0.0, 0.1, 0.4], opening=50.0)
        >>> design = FingerDesign(0.5, grasp3d.Sensor(receptive_field=4.0, fingertip_radius=10.0))
        >>> print(f"{design.stable_fraction(grasps):.0%} of the grasps are S")
        67% of the grasps are S
    """

    critical_angle: ArrayLike
    """Critical friction angle beta* of each [rad], shape (k,), or (k, c) where c grasps are known
    at each contact point, of which the one with the largest margin counts; inf: no grasp."""
    opening: ArrayLike = math.inf
    """Distance between the contacts, at least 0, of the same shape; inf: locations do not
    matter."""
    weights: ArrayLike = 1.0
    """Weight of each contact point, at least 0, shape (k,)."""

    __repr__ = short_repr

    def __post_init__(self) -> None:
        pair = (
            np.atleast_1d(np.asarray(one, float)) for one in (self.critical_angle, self.opening)
        )
        critical, opening = np.broadcast_arrays(*pair)
        weights = np.broadcast_to(np.asarray(self.weights, float), critical.shape[:1])
        for name, values in zip(
            ("critical_angle", "opening", "weights"), (critical, opening, weights), strict=True
        ):
            object.__setattr__(self, name, values)
        if not weights.sum() > 0.0:
            raise SettingError("there must be a grasp with a weight above 0")

    def fraction(self, chosen: ArrayLike) -> float:
        """Fraction, by weight, of chosen grasps.

        Args:
            chosen: Whether each is chosen, shape (k,).
        """
        weights = np.asarray(self.weights)
        return float(weights[np.asarray(chosen)].sum() / weights.sum())
