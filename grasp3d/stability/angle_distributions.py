"""How critical friction angles are spread over a surface: shares of S, M and U at any setting.

A place is S where its critical friction angle over the worst normals is below beta - alpha/2, and U
where the one over the best normals is beta + alpha/2 or more (of three fingers and more, while that
is below 90 degrees). So two cumulative distributions of
angles hold the shares for every friction and every sensor resolution, and the resolution that a
share needs.
"""

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from grasp3d.arrays import Floats
from grasp3d.errors import SearchCoverageError, SettingError
from grasp3d.settings import GraspModel
from grasp3d.stability.thresholds import unstable_from

ROUNDING = 1e-9
"""Angle by which a question may exceed what was searched [rad]."""

SLACK = 1e-12
"""Part of a surface that rounding may take from a share."""

HALVINGS = 60
"""Of an interval of pi, down to rounding."""


def accuracy_ceiling(fractions: dict[str, float]) -> float:
    """Best accuracy of any predictor of grasp success that sees through this sensor.

    Sure places are predicted rightly, of the others half (Wan & Howe 2018, Sec. V): S + U + M / 2.

    Args:
        fractions: Shares under the keys S, M and U.
    """
    return fractions["S"] + fractions["U"] + fractions["M"] / 2.0


def check_fraction(share: float) -> None:
    """Raise SettingError unless a share lies between 0 and 1."""
    if not 0.0 <= share <= 1.0:
        raise SettingError(f"a share must be from 0 to 1; got {share:g}")


class AngleDistribution(ABC):
    """Shares of a surface by its critical friction angles."""

    limit: float = math.inf
    """Largest friction angle plus tilt for which grasps were searched [rad]."""

    fingers: int = 2
    """Contacts of the grasps; three and more are never U from beta + alpha/2 = 90 degrees on."""

    @abstractmethod
    def worst_below(self, angles: npt.ArrayLike) -> Floats:
        """Share whose critical angle over the worst normals is below angles [rad], any shape."""

    @abstractmethod
    def best_below(self, angles: npt.ArrayLike) -> Floats:
        """Share whose critical angle over the best normals is below angles [rad], any shape."""

    def worst_quantile(self, share: float) -> float:
        """Angle just above which every angle holds a share of the surface [rad], worst normals.

        Args:
            share: Of the surface, from 0 to 1.

        Returns:
            The smallest such angle; inf where none holds so much.

        Raises:
            SettingError: The share is outside its range.
        """
        check_fraction(share)
        low, high = -math.pi, math.pi + ROUNDING
        if float(self.worst_below(high)) < share - SLACK:
            return math.inf
        for _ in range(HALVINGS):
            middle = 0.5 * (low + high)
            if float(self.worst_below(middle)) >= share - SLACK:
                high = middle
            else:
                low = middle
        return high

    def fractions(self, *, friction: float, sensor_resolution: float) -> dict[str, float]:
        """Shares of the surface that are S, M and U.

        Args:
            friction: Coulomb coefficient, above 0.
            sensor_resolution: Resolution alpha [rad].

        Raises:
            SettingError: A value is outside its range.
            SearchCoverageError: Grasps that would count were not searched.
        """
        model = GraspModel(friction=friction, sensor_resolution=sensor_resolution)
        stable, ambiguous, unstable = self.shares(model.friction_angle, model.tilt)
        return {"S": float(stable), "M": float(ambiguous), "U": float(unstable)}

    def shares(
        self, friction_angle: npt.ArrayLike, tilt: npt.ArrayLike
    ) -> tuple[Floats, Floats, Floats]:
        """Shares of the surface that are S, M and U, for many settings at once.

        Args:
            friction_angle: Half-angles beta of the friction cones [rad].
            tilt: Halves of the resolutions alpha [rad]; both are broadcast together.

        Returns:
            Three arrays of their common shape.

        Raises:
            SearchCoverageError: Grasps that would count were not searched.
        """
        beta, a = np.asarray(friction_angle, float), np.asarray(tilt, float)
        widest = float(np.max(beta + a, initial=0.0))
        if min(widest, math.pi / 2.0) > self.limit + ROUNDING:
            raise SearchCoverageError(
                f"atan(friction) + alpha/2 is {math.degrees(widest):.4g} degrees, but grasps "
                f"were searched only up to {math.degrees(self.limit):.4g}; label the surface again "
                f"with Sampling(search_angle={min(widest, math.pi / 2.0):.4g})"
            )
        stable = self.worst_below(beta - a)
        unstable = 1.0 - self.best_below(unstable_from(beta, a, self.fingers))
        return stable, np.maximum(0.0, 1.0 - stable - unstable), unstable

    def required_resolution(self, share: float, *, friction: float) -> float:
        """Coarsest sensor resolution alpha below which a share of the surface is S [rad].

        Args:
            share: Of the surface, above 0, at most 1.
            friction: Coulomb coefficient, above 0.

        Returns:
            The resolution; 0 where no sensor is fine enough.

        Raises:
            SettingError: A value is outside its range.
            SearchCoverageError: Grasps that would count were not searched.
        """
        if not 0.0 < share <= 1.0:
            raise SettingError(f"the share must be above 0 and at most 1; got {share:g}")
        beta, angle = GraspModel(friction=friction).friction_angle, self.worst_quantile(share)
        if angle > self.limit and min(beta, math.pi / 2.0) > self.limit + ROUNDING:
            raise SearchCoverageError(
                f"atan(friction) is {math.degrees(beta):.4g} degrees, but grasps were searched "
                f"only up to {math.degrees(self.limit):.4g}; label the surface again with "
                f"Sampling(search_angle={beta:.4g})"
            )
        return max(0.0, 2.0 * (beta - angle))


@dataclass(frozen=True, eq=False)
class SampledAngles(AngleDistribution):
    """Angles of places that each stand for a part of the surface."""

    worst: Floats
    """Critical angle over the worst normals [rad], inf: no grasp, shape (k,)."""
    best: Floats
    """The same over the best normals, shape (k,)."""
    weights: Floats
    """Shares of the surface, their sum 1, shape (k,)."""
    limit: float = math.inf
    fingers: int = 2

    def __reduce__(self) -> tuple[type["SampledAngles"], tuple[object, ...]]:
        """Send to other processes what was given, not what was made of it."""
        return SampledAngles, (self.worst, self.best, self.weights, self.limit, self.fingers)

    def worst_below(self, angles: npt.ArrayLike) -> Floats:
        """See `AngleDistribution`."""
        return _below(*self._worst_steps, angles)

    def best_below(self, angles: npt.ArrayLike) -> Floats:
        """See `AngleDistribution`."""
        return _below(*self._best_steps, angles)

    @cached_property
    def _worst_steps(self) -> tuple[Floats, Floats]:
        return _steps(self.worst, self.weights)

    @cached_property
    def _best_steps(self) -> tuple[Floats, Floats]:
        return _steps(self.best, self.weights)


def _steps(angles: Floats, weights: Floats) -> tuple[Floats, Floats]:
    """Angles in order, and the share below each, shape (k,) and (k + 1,)."""
    order = np.argsort(angles, kind="stable")
    reached = np.cumsum(weights[order])
    return angles[order], np.concatenate([[0.0], reached / reached[-1]])


def _below(angles: Floats, shares: Floats, limits: npt.ArrayLike) -> Floats:
    return np.asarray(shares[np.searchsorted(angles, np.asarray(limits, dtype=np.float64))])


@dataclass(frozen=True)
class SphereAngles(AngleDistribution):
    """A sphere with one finger fixed anywhere, by area (closed form).

    Fingers an angle t apart about the centre make a line that is (pi - t) / 2 off both normals.
    """

    def worst_below(self, angles: npt.ArrayLike) -> Floats:
        """See `AngleDistribution`: sin(angle)^2."""
        within = np.clip(np.asarray(angles, dtype=np.float64), 0.0, math.pi / 2.0)
        return np.asarray(np.sin(within) ** 2)

    def best_below(self, angles: npt.ArrayLike) -> Floats:
        """See `AngleDistribution`: a sphere has no creases."""
        return self.worst_below(angles)

    def worst_quantile(self, share: float) -> float:
        """See `AngleDistribution`: the inverse."""
        check_fraction(share)
        return math.asin(math.sqrt(share))
