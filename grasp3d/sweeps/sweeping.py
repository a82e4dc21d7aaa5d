"""Computes sweeps: from critical angles of a surface, and the mean over several surfaces."""

from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np

from grasp3d.arrays import ArrayLike, Floats, locked
from grasp3d.errors import SettingError
from grasp3d.settings import check_choice
from grasp3d.settings.lengths import AnyLength, GivenLength, Unit
from grasp3d.stability.angle_distributions import AngleDistribution
from grasp3d.stability.label import Mode
from grasp3d.sweeps.axes import NAMES, AxisName, AxisValues, axis_values
from grasp3d.sweeps.sweep_result import Sweep


class LocatedGrasps(Protocol):
    """Grasps whose critical angles are known at any location error: labels, a closed form."""

    def angle_distribution(self, *, location_error: Any) -> AngleDistribution:
        """Distribution of critical angles at a location error, a length."""


def sweep(
    source: AngleDistribution | LocatedGrasps,
    *,
    friction: ArrayLike,
    sensor_resolution: ArrayLike,
    friction_error: ArrayLike | None = None,
    normal_error: ArrayLike | None = None,
    location_error: ArrayLike | GivenLength | Sequence[GivenLength] | None = None,
    name: str = "",
    mode: Mode = "label",
) -> Sweep:
    """Compute area fractions S, M and U over two of the uncertainties, from critical angles.

    All values may be one or several, in any order; at most two settings may have several.

    Args:
        source: Critical angles of a surface, from `SurfaceLabels.angle_distribution`; or the labels
            themselves, or a shape in closed form, which give them at any location error.
        friction: Coulomb coefficients above 0.
        sensor_resolution: Resolutions alpha [rad].
        friction_error: Largest differences between the true friction and `friction`, below it.
            None, here and below: that of the labels' model; 0 where critical angles are given.
        normal_error: Largest angles between true and perceived normals beyond alpha/2 [rad].
        location_error: Largest distances between true and perceived contact points: lengths, in the
            unit of the mesh or with a unit. The grasps are the same at all of them. None: that of
            `source`, critical angles too.
        name: Name of the surface.
        mode: Whether the grasps were searched ('label') or given ('scan').

    Raises:
        SettingError: A value is outside its range, more than two settings have several values, the
            critical angles are not known at a location error, or fingers have a friction of their
            own.
        SearchCoverageError: The search did not cover all values.

    Example:
        A cone, for two frictions and three resolutions:

        >>> import numpy as np
        >>> import trimesh
        >>> import grasp3d
        >>> cone = trimesh.creation.cone(radius=0.03, height=0.1, sections=32)
        >>> mesh = grasp3d.load_mesh(cone, unit="m", max_edge=0.02)
        >>> labels = grasp3d.label_surface(mesh, sampling=grasp3d.Sampling(search_angle=1.0))
        >>> found = grasp3d.sweep(
        ...     labels.angle_distribution(),
        ...     friction=[0.3, 0.5],
        ...     sensor_resolution=np.radians([0.0, 10.0, 30.0]),
        ... )
        >>> found.stable.round(2).tolist()
        [[0.05, 0.0, 0.0], [0.68, 0.68, 0.0]]
        >>> np.degrees(found.required_resolution(0.5)).round(1).tolist()
        [0.0, 19.3]

        How much of a sphere of radius 30 is S where friction is known to 0.1 and contacts to 2:

        >>> found = grasp3d.sweep(
        ...     grasp3d.stability.SphereAngles(radius=30.0),
        ...     friction=1.0,
        ...     sensor_resolution=0.2,
        ...     friction_error=[0.0, 0.1],
        ...     location_error=[0.0, 2.0],
        ... )
        >>> found.rows, found.columns, found.stable.round(2).tolist()
        ('friction_error', 'location_error', [[0.4, 0.32], [0.35, 0.28]])
    """
    check_choice("mode", mode, Mode)
    axes = axis_values(
        friction=friction,
        sensor_resolution=sensor_resolution,
        friction_error=_error_of(source, "friction_error", friction_error),
        normal_error=_error_of(source, "normal_error", normal_error),
        location_error=_error_of(source, "location_error", location_error),
    )
    distributions = tuple(_angles_at(source, one) for one in axes.location_errors())
    return _swept(axes, distributions, name=name, mode=mode)


def _swept(
    axes: AxisValues, distributions: tuple[AngleDistribution, ...], *, name: str, mode: Mode
) -> Sweep:
    """The sweep of critical angles that are known at each location error."""
    rows, columns = axes.rows_and_columns
    shape = len(axes.values[rows]), len(axes.values[columns])
    least, largest, tilt = (
        np.broadcast_to(one, shape) for one in (*axes.friction_angles(), axes.tilts())
    )
    found = np.empty((3, *shape))
    for number, distribution in enumerate(distributions):
        at: Any = slice(None)
        if len(distributions) > 1:
            at = (number, slice(None)) if rows == "location_error" else (slice(None), number)
        found[(slice(None), *np.index_exp[at])] = distribution.fractions_at(
            least[at], tilt[at], largest_friction_angle=largest[at]
        )
    stable, ambiguous, unstable = map(locked, found)
    return Sweep(name, mode, axes, stable, ambiguous, unstable, distributions)


def _error_of(source: Any, name: AxisName, given: Any) -> Any:
    """Values of an error; None: the one of labels, and the location error of critical angles."""
    return getattr(getattr(source, "model", source), name, 0.0) if given is None else given


def _angles_at(source: AngleDistribution | LocatedGrasps, location: AnyLength) -> AngleDistribution:
    """Critical angles at a location error."""
    known = _error_of(source, "location_error", None)
    if isinstance(source, AngleDistribution) and location == known:
        return source
    located = getattr(source, "angle_distribution", None)
    if located is None:
        raise SettingError(
            f"the location error of these critical angles is {known}, not {location}: give the "
            "labels instead, grasp3d.sweep(labels, ...)"
        )
    found: AngleDistribution = located(location_error=location)
    return found


def mean_sweep(sweeps: Sequence[Sweep], *, name: str = "") -> Sweep:
    """Mean over surfaces with equal weights, independent of their areas.

    Its required resolution is that of the mean fractions, not the mean of required resolutions.

    Args:
        sweeps: Sweeps of the same values, mode and fingers; at least one.
        name: Name of the mean.

    Raises:
        SettingError: There is none, or they differ.
    """
    if not sweeps:
        raise SettingError("the mean needs at least one sweep")
    first = sweeps[0]
    for other in sweeps[1:]:
        if _kind(other) != _kind(first) or not all(
            np.array_equal(other.axes.values[axis], first.axes.values[axis]) for axis in NAMES
        ):
            raise SettingError(
                "the mean needs sweeps of the same frictions, resolutions, errors, mode and "
                f"fingers; {other.name!r} differs from {first.name!r}"
            )
    parts = zip(*(one.distributions for one in sweeps), strict=True)
    return _swept(first.axes, tuple(map(_MeanAngles, parts)), name=name, mode=first.mode)


def _kind(one: Sweep) -> tuple[Mode, int, Unit | None, float]:
    angles = one.distribution
    return one.mode, angles.fingers, one.unit, angles.further_tilt


class _MeanAngles(AngleDistribution):
    """Mean of several surfaces' distributions."""

    def __init__(self, parts: tuple[AngleDistribution, ...]) -> None:
        self._parts = parts
        self.limit = min(part.limit for part in parts)
        self.fingers = parts[0].fingers
        self.further_tilt = parts[0].further_tilt

    def worst_below(self, angles: ArrayLike) -> Floats:
        """See `AngleDistribution`."""
        return np.asarray(np.mean([part.worst_below(angles) for part in self._parts], axis=0))

    def best_below(self, angles: ArrayLike) -> Floats:
        """See `AngleDistribution`."""
        return np.asarray(np.mean([part.best_below(angles) for part in self._parts], axis=0))
