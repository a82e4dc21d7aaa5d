"""Sweeps: area fractions S, M and U over two of the uncertainties, their mean, and their table."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from grasp3d.arrays import ArrayLike, Floats, locked, short_repr
from grasp3d.errors import SettingError
from grasp3d.settings import check_choice
from grasp3d.settings.lengths import AnyLength, GivenLength, Unit
from grasp3d.stability.angle_distributions import AngleDistribution
from grasp3d.stability.label import Mode
from grasp3d.surface.sweeps.axes import NAMES, RESOLUTION, AxisName, AxisValues, axis_values


@dataclass(frozen=True, eq=False)
class Sweep:
    """Area fractions of one surface, or their mean over several, over two of the uncertainties.

    Rows and columns are frictions (m,) and resolutions (k,), or, where others have several values,
    those; in every entry S + M + U = 1.
    """

    name: str
    mode: Mode
    """As in `SurfaceLabels`: whether grasps were searched or given."""
    axes: AxisValues
    """Values of every uncertainty, one or several."""
    stable: Floats
    """Area fraction that is S, shape (m, k)."""
    ambiguous: Floats
    """Area fraction that is M, shape (m, k)."""
    unstable: Floats
    """Area fraction that is U, shape (m, k)."""
    distributions: tuple[AngleDistribution, ...]
    """Critical angles that the fractions were computed from, one for each location error."""

    __repr__ = short_repr

    @property
    def rows(self) -> AxisName:
        """What varies from row to row."""
        return self.axes.rows_and_columns[0]

    @property
    def columns(self) -> AxisName:
        """What varies from column to column."""
        return self.axes.rows_and_columns[1]

    @property
    def friction(self) -> Floats:
        """Coulomb coefficients, in increasing order, shape (m,), or one."""
        return self.axes.values["friction"]

    @property
    def sensor_resolution(self) -> Floats:
        """Resolutions alpha [rad], in increasing order, shape (k,), or one."""
        return self.axes.values["sensor_resolution"]

    @property
    def friction_error(self) -> Floats:
        """Largest differences from `friction`, in increasing order, or one."""
        return self.axes.values["friction_error"]

    @property
    def normal_error(self) -> Floats:
        """Errors of normals beyond alpha/2 [rad], in increasing order, or one."""
        return self.axes.values["normal_error"]

    @property
    def location_error(self) -> Floats:
        """Errors of contact locations [`unit`], in increasing order, or one."""
        return self.axes.values["location_error"]

    @property
    def unit(self) -> Unit | None:
        """Unit of the location errors; None: that of the mesh."""
        return self.axes.unit

    @property
    def distribution(self) -> AngleDistribution:
        """Critical angles at the smallest location error."""
        return self.distributions[0]

    @property
    def accuracy_ceiling(self) -> Floats:
        """Best accuracy of any predictor that sees through this sensor, shape (m, k).

        S + U + M / 2 (Wan & Howe 2018, Sec. IV-C): half of the ambiguous grasps are guessed
        correctly.
        """
        return self.stable + self.unstable + self.ambiguous / 2.0

    def required_resolution(self, fraction: float) -> Floats:
        """Coarsest resolution alpha below which an area fraction is S [rad], given the others.

        Independent of the swept resolutions; 0 where no sensor is fine enough.

        Args:
            fraction: Area fraction, above 0, at most 1.

        Returns:
            Shape (m,), one for each row, if the columns are resolutions; otherwise (m, k).

        Raises:
            SettingError: The fraction is outside its range.
            SearchCoverageError: The search did not cover all grasps that this needs.
        """
        largest = float(self.friction.max())
        for distribution in self.distributions:  # raises an error where it does not cover them
            distribution.required_resolution(fraction, friction=largest)
        quantiles = np.array([one.worst_quantile(fraction) for one in self.distributions])
        row, column = self.rows, self.columns
        worst = quantiles[:, None] if row == "location_error" else quantiles[None, :]
        least, _ = self.axes.friction_angles()
        resolution = np.maximum(0.0, 2.0 * (least - worst - self.axes.grid("normal_error")))
        shape = len(self.axes.values[row]), len(self.axes.values[column])
        if column == RESOLUTION:
            return locked(np.broadcast_to(resolution, (shape[0], 1))[:, 0])
        return locked(np.broadcast_to(resolution, shape))

    def to_table(self, *, fractions: Sequence[float] = ()) -> Any:
        """Return a `pyarrow.Table` with a row for each friction and resolution.

        The columns are those of `write_sweeps`, without `error`.

        Args:
            fractions: Required area fractions of S, each above 0 and at most 1.

        Raises:
            SettingError: A fraction is outside its range.
        """
        from grasp3d.system.tables import table_of_rows

        rows, columns = table_rows([self], fractions)
        return table_of_rows(rows, columns, settings={})

    def to_dataframe(self, *, fractions: Sequence[float] = ()) -> Any:
        """Return `to_table` as a `pandas.DataFrame`.

        Args:
            fractions: Required area fractions of S, each above 0 and at most 1.

        Raises:
            SettingError: A fraction is outside its range.
            OutputError: pandas is not installed; the extra `grasp3d[pandas]` installs it.
        """
        from grasp3d.system.tables import data_frame

        return data_frame(self.to_table(fractions=fractions))


def table_rows(
    sweeps: Sequence[Sweep], fractions: Sequence[float]
) -> tuple[list[dict[str, Any]], dict[str, type]]:
    """Rows of a table of sweeps, and the types of its columns.

    Args:
        sweeps: The sweeps.
        fractions: Required area fractions of S.
    """
    required = {f"required_resolution_{100.0 * fraction:g}": fraction for fraction in fractions}
    values = ("stable", "ambiguous", "unstable", "accuracy_ceiling")
    errors = ("friction_error", "normal_error", "location_error")
    columns = {
        "name": str,
        "mode": str,
        **dict.fromkeys(("friction", "sensor_resolution", *values, *required, *errors), float),
        "unit": str,
    }
    rows: list[dict[str, Any]] = []
    for one in sweeps:
        shape = one.stable.shape
        entries = {value: getattr(one, value) for value in values}
        for column, fraction in required.items():
            needed = one.required_resolution(fraction)
            entries[column] = needed[:, None] if needed.ndim == 1 else needed
        entries |= {name: one.axes.grid(name) for name in NAMES}
        entries = {name: np.broadcast_to(value, shape) for name, value in entries.items()}
        texts = {"name": one.name, "mode": one.mode, "unit": one.unit or ""}
        rows += [
            texts | {name: float(value[entry]) for name, value in entries.items()}
            for entry in np.ndindex(shape)
        ]
    return rows, columns


def write_sweeps(
    path: str | Path,
    sweeps: Sequence[Sweep],
    *,
    fractions: Sequence[float] = (),
    failures: Mapping[str, str] | None = None,
    settings: Mapping[str, Any] | None = None,
) -> None:
    """Write sweeps as a table with one row for each name and combination of values.

    Columns: name, mode, friction, sensor_resolution [rad], stable, ambiguous, unstable,
    accuracy_ceiling, for each of `fractions` `required_resolution_P` [rad] with P in percent (the
    same at all resolutions), friction_error, normal_error [rad], location_error, unit (of the
    location error; empty: that of the mesh), and error.

    Args:
        path: File to make or replace; .csv or .parquet.
        sweeps: The sweeps.
        fractions: Required area fractions of S, each above 0 and at most 1.
        failures: Error messages by the name of surfaces that could not be swept: one row each,
            empty except for the error.
        settings: Written as JSON to Parquet's metadata, under `grasp3d`.

    Raises:
        SettingError: A fraction is outside its range.
        OutputError: The suffix is unknown, or the file cannot be written.
    """
    from grasp3d.system.tables import table_of_rows, write_tables

    rows, columns = table_rows(sweeps, fractions)
    rows += [{"name": name, "error": reason} for name, reason in (failures or {}).items()]
    entries = [{"error": "", **row} for row in rows]
    table = table_of_rows(entries, {**columns, "error": str}, settings=settings or {})
    write_tables(Path(path), [table])


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
        >>> sweep = grasp3d.sweep(
        ...     labels.angle_distribution(),
        ...     friction=[0.3, 0.5],
        ...     sensor_resolution=np.radians([0.0, 10.0, 30.0]),
        ... )
        >>> sweep.stable.round(2).tolist()
        [[0.05, 0.0, 0.0], [0.68, 0.68, 0.0]]
        >>> np.degrees(sweep.required_resolution(0.5)).round(1).tolist()
        [0.0, 19.3]

        How much of a sphere of radius 30 is S where friction is known to 0.1 and contacts to 2:

        >>> sweep = grasp3d.sweep(
        ...     grasp3d.stability.SphereAngles(radius=30.0),
        ...     friction=1.0,
        ...     sensor_resolution=0.2,
        ...     friction_error=[0.0, 0.1],
        ...     location_error=[0.0, 2.0],
        ... )
        >>> sweep.rows, sweep.columns, sweep.stable.round(2).tolist()
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
    fractions = np.empty((3, *shape))
    for number, distribution in enumerate(distributions):
        at: Any = slice(None)
        if len(distributions) > 1:
            at = (number, slice(None)) if rows == "location_error" else (slice(None), number)
        fractions[(slice(None), *np.index_exp[at])] = distribution.fractions_at(
            least[at], tilt[at], largest_friction_angle=largest[at]
        )
    stable, ambiguous, unstable = map(locked, fractions)
    return Sweep(name, mode, axes, stable, ambiguous, unstable, distributions)


def _error_of(source: Any, name: AxisName, value: Any) -> Any:
    """Values of an error; None: the error of labels, and the location error of critical angles."""
    return getattr(getattr(source, "model", source), name, 0.0) if value is None else value


def _angles_at(source: AngleDistribution | LocatedGrasps, location: AnyLength) -> AngleDistribution:
    """Critical angles at a location error."""
    own = _error_of(source, "location_error", None)
    if isinstance(source, AngleDistribution) and location == own:
        return source
    located = getattr(source, "angle_distribution", None)
    if located is None:
        raise SettingError(
            f"the location error of these critical angles is {own}, not {location}: give the "
            "labels instead, grasp3d.sweep(labels, ...)"
        )
    distribution: AngleDistribution = located(location_error=location)
    return distribution


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
