"""Distributions of critical friction angles over a surface, and fractions S, M and U from them.

A surface point is S where its critical friction angle over the worst normals is below
beta - alpha/2, and U where that over the best normals is beta + alpha/2 or more (for three fingers
and more, while beta + alpha/2 is below 90 degrees). So two cumulative distributions of angles
determine the fractions for every friction and sensor resolution, and the sensor resolution that a
fraction S requires. With uncertain contact locations the angles are also over the worst and the
best locations, and each distribution is for one location error.
"""

import math
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from grasp3d.arrays import ArrayLike, Floats, short_repr
from grasp3d.settings import ANGLE_ROUNDING, GraspModel
from grasp3d.settings.checks import check_range
from grasp3d.settings.grasp_model import friction_interval
from grasp3d.settings.sampling import not_covered
from grasp3d.stability.label import unstable_from

FRACTION_ROUNDING = 1e-12
"""Fraction of a surface that rounding errors may amount to."""

BISECTIONS = 60
"""Bisections of an interval of 2 pi, enough to reach rounding errors."""


def _first_angle(reaches: Callable[[float], bool]) -> float:
    """First angle from which a condition holds, by bisection [rad]; inf: nowhere."""
    low, high = -math.pi, math.pi + ANGLE_ROUNDING
    if not reaches(high):
        return math.inf
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        if reaches(middle):
            high = middle
        else:
            low = middle
    return high


def accuracy_ceiling(fractions: dict[str, float]) -> float:
    """Highest possible accuracy of a predictor of grasp success that uses this sensor.

    All S and U are predicted correctly, and half of M (Wan & Howe 2018, Sec. IV-C): S + U + M / 2.

    Args:
        fractions: Fractions of the surface under the keys S, M and U.
    """
    return fractions["S"] + fractions["U"] + fractions["M"] / 2.0


class AngleDistribution(ABC):
    """Cumulative distribution of critical friction angles over the area of a surface."""

    limit: float = math.inf
    """Largest beta + alpha/2 for which grasps were searched [rad]."""

    fingers: int = 2
    """Contacts of each grasp; with three or more, none is U from beta + alpha/2 = 90 degrees on."""

    @abstractmethod
    def worst_below(self, angles: ArrayLike) -> Floats:
        """Area fractions with critical angles over the worst normals below `angles` [rad]."""

    @abstractmethod
    def best_below(self, angles: ArrayLike) -> Floats:
        """Area fractions with critical angles over the best normals below `angles` [rad]."""

    def worst_quantile(self, fraction: float) -> float:
        """Quantile of the critical angle over the worst normals [rad].

        Args:
            fraction: Area fraction, from 0 to 1.

        Returns:
            The infimum of the angles that exceed the critical angles of at least that fraction of
            the surface; inf where there are none.

        Raises:
            SettingError: The fraction is outside its range.
        """
        check_range("a fraction", fraction, 0.0, 1.0)
        least = fraction - FRACTION_ROUNDING
        return _first_angle(lambda angle: float(self.worst_below(angle)) >= least)

    def fractions(
        self, *, friction: float | tuple[float, float], sensor_resolution: float
    ) -> dict[str, float]:
        """Area fractions S, M and U.

        Args:
            friction: Coulomb coefficient, above 0, or the interval in which it lies.
            sensor_resolution: Resolution alpha [rad].

        Raises:
            SettingError: A value is outside its range.
            SearchCoverageError: The search did not cover all grasps that this needs.
        """
        model = GraspModel(friction=friction, sensor_resolution=sensor_resolution)
        least, largest = map(math.atan, model.friction_interval)
        stable, ambiguous, unstable = self.fractions_at(
            least, model.tilt, largest_friction_angle=largest
        )
        return {"S": float(stable), "M": float(ambiguous), "U": float(unstable)}

    def fractions_at(
        self,
        friction_angle: ArrayLike,
        tilt: ArrayLike,
        *,
        largest_friction_angle: ArrayLike | None = None,
    ) -> tuple[Floats, Floats, Floats]:
        """Area fractions S, M and U, for arrays of settings.

        Args:
            friction_angle: Half-angles beta of the friction cones [rad]; where friction is an
                interval, those at the smallest friction.
            tilt: Largest angles between true and perceived normals [rad]: halves of the resolutions
                alpha.
            largest_friction_angle: Half-angles at the largest friction [rad]; None: the same. All
                are broadcast together.

        Returns:
            Three arrays of their common shape.

        Raises:
            SearchCoverageError: The search did not cover all grasps that this needs.
        """
        beta, a = np.asarray(friction_angle, float), np.asarray(tilt, float)
        largest = beta if largest_friction_angle is None else np.asarray(largest_friction_angle)
        widest = float(np.max(largest + a, initial=0.0))
        if min(widest, math.pi / 2.0) > self.limit + ANGLE_ROUNDING:
            raise not_covered("atan(friction) + alpha/2", widest, self.limit)
        stable = self.worst_below(beta - a)
        unstable = 1.0 - self.best_below(unstable_from(largest, a, self.fingers))
        stable, unstable = np.broadcast_arrays(stable, unstable)
        return stable, np.maximum(0.0, 1.0 - stable - unstable), unstable

    def required_resolution(
        self, fraction: float, *, friction: float | tuple[float, float]
    ) -> float:
        """Coarsest sensor resolution alpha below which a fraction of the surface is S [rad].

        Args:
            fraction: Area fraction, above 0, at most 1.
            friction: Coulomb coefficient, above 0, or the interval in which it lies.

        Returns:
            The resolution; 0 where no sensor is fine enough.

        Raises:
            SettingError: A value is outside its range.
            SearchCoverageError: The search did not cover all grasps that this needs.
        """
        check_range("the fraction", fraction, 0.0, 1.0, ends="(]")
        beta, angle = math.atan(friction_interval(friction)[0]), self.worst_quantile(fraction)
        if angle > self.limit and min(beta, math.pi / 2.0) > self.limit + ANGLE_ROUNDING:
            raise not_covered("atan(friction)", beta, self.limit)
        return max(0.0, 2.0 * (beta - angle))


@dataclass(frozen=True, eq=False)
class SampledAngles(AngleDistribution):
    """Critical angles of samples, each with its fraction of the surface."""

    worst: Floats
    """Critical angle over the worst normals [rad], shape (k,); inf: no grasp."""
    best: Floats
    """The same over the best normals, shape (k,)."""
    weights: Floats
    """Fraction of the surface of each sample, shape (k,); their sum is 1."""
    limit: float = math.inf
    fingers: int = 2

    __repr__ = short_repr

    def worst_below(self, angles: ArrayLike) -> Floats:
        """See `AngleDistribution`."""
        return _below(*self._steps[0], angles)

    def best_below(self, angles: ArrayLike) -> Floats:
        """See `AngleDistribution`."""
        return _below(*self._steps[1], angles)

    @cached_property
    def _steps(self) -> list[tuple[Floats, Floats]]:
        return [_steps(angles, self.weights) for angles in (self.worst, self.best)]


def _steps(angles: Floats, weights: Floats) -> tuple[Floats, Floats]:
    """Sorted angles (k,), and the fraction below each and below infinity (k + 1,)."""
    order = np.argsort(angles, kind="stable")
    cumulative = np.cumsum(weights[order])
    return angles[order], np.concatenate([[0.0], cumulative / cumulative[-1]])


def _below(angles: Floats, fractions: Floats, limits: ArrayLike) -> Floats:
    return np.asarray(fractions[np.searchsorted(angles, np.asarray(limits, dtype=np.float64))])


@dataclass(frozen=True)
class SphereAngles(AngleDistribution):
    """Two fingers on a sphere, one of them fixed anywhere (closed form).

    The line through contacts that are an angle t apart about the centre makes the angle
    (pi - t) / 2 with both normals.

    Example:
        >>> from grasp3d.stability import SphereAngles
        >>> fractions = SphereAngles().fractions(friction=0.5, sensor_resolution=0.2)
        >>> {name: round(fraction, 3) for name, fraction in fractions.items()}
        {'S': 0.127, 'M': 0.159, 'U': 0.715}
    """

    def worst_below(self, angles: ArrayLike) -> Floats:
        """See `AngleDistribution`: sin(angle)^2."""
        angle = np.clip(np.asarray(angles, dtype=np.float64), 0.0, math.pi / 2.0)
        return np.asarray(np.sin(angle) ** 2)

    def best_below(self, angles: ArrayLike) -> Floats:
        """See `AngleDistribution`: the same, as a sphere has no creases."""
        return self.worst_below(angles)
