"""Sweeps: area fractions S, M and U over friction and sensor resolution, their mean and table.

Vertices have weights by area; fractions and quantiles over a surface follow from these.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np

from grasp3d.arrays import ArrayLike, Bytes, Floats, locked, short_repr
from grasp3d.errors import SettingError
from grasp3d.mesh import ObjectMesh
from grasp3d.settings import GraspModel, check_choice
from grasp3d.stability.angle_distributions import AngleDistribution
from grasp3d.stability.label import Label, Mode

Weights = Literal["area", "vertex"]
"""area: each vertex is weighted by the area around it; vertex: all on the surface equally. Vertices
where no contact may be have no weight."""


def vertex_weights(mesh: ObjectMesh, weights: Weights) -> Floats:
    """Weights of the vertices, shape (V,); their sum is 1.

    Raises:
        SettingError: Unknown `weights`.
    """
    check_choice("weights", weights, Weights)
    values = mesh.vertex_areas if weights == "area" else mesh.allowed.astype(np.float64)
    return np.asarray(values / values.sum())


def quantiles(values: Floats, levels: ArrayLike, weights: Floats) -> Floats:
    """Quantiles of weighted values.

    Args:
        values: Shape (V,).
        levels: From 0 to 1, shape (k,).
        weights: As `vertex_weights` returns them, shape (V,).

    Returns:
        Shape (k,).

    Raises:
        SettingError: A level is outside its range.
    """
    fractions = np.asarray(levels, dtype=np.float64)
    if not ((fractions >= 0.0) & (fractions <= 1.0)).all():
        raise SettingError(f"quantile levels must be from 0 to 1; got {levels!r}")
    order = np.argsort(values, kind="stable")
    cumulative = np.cumsum(weights[order])
    index = np.searchsorted(cumulative, fractions * cumulative[-1])
    return np.asarray(values[order][np.minimum(index, len(order) - 1)])


def label_fractions(codes: Bytes, weights: Floats) -> dict[str, float]:
    """Fractions S, M and U of weighted vertices.

    Args:
        codes: `Label` codes, shape (V,).
        weights: As `vertex_weights` returns them, shape (V,).
    """
    return {
        label.name: float(weights[codes == label].sum()) for label in sorted(Label, reverse=True)
    }


@dataclass(frozen=True, eq=False)
class Sweep:
    """Area fractions of one surface, or their mean over several.

    Rows are frictions, columns are resolutions; in every entry S + M + U = 1.
    """

    name: str
    mode: Mode
    """As in `SurfaceLabels`: whether grasps were searched or given."""
    friction: Floats
    """Coulomb coefficients, in increasing order, shape (m,)."""
    sensor_resolution: Floats
    """Resolutions alpha [rad], in increasing order, shape (k,)."""
    stable: Floats
    """Area fraction that is S, shape (m, k)."""
    ambiguous: Floats
    """Area fraction that is M, shape (m, k)."""
    unstable: Floats
    """Area fraction that is U, shape (m, k)."""
    distribution: AngleDistribution
    """Critical angles that the fractions were computed from."""

    __repr__ = short_repr

    @property
    def accuracy_ceiling(self) -> Floats:
        """Best accuracy of any predictor that sees through this sensor, shape (m, k).

        S + U + M / 2 (Wan & Howe 2018, Sec. IV-C): half of the ambiguous grasps are guessed
        correctly.
        """
        return self.stable + self.unstable + self.ambiguous / 2.0

    def required_resolution(self, fraction: float) -> Floats:
        """Coarsest resolution alpha below which an area fraction is S [rad], at each friction (m,).

        Independent of the swept resolutions; 0 where no sensor is fine enough.

        Args:
            fraction: Area fraction, above 0, at most 1.

        Raises:
            SettingError: The fraction is outside its range.
            SearchCoverageError: The search did not cover all grasps that this needs.
        """
        angles, largest = self.distribution, float(self.friction[-1])
        angles.required_resolution(fraction, friction=largest)  # raises if not covered
        spare = _friction_angles(self.friction) - angles.worst_quantile(fraction)
        return locked(np.maximum(0.0, 2.0 * spare))

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
    numbers = ("friction", "sensor_resolution", *values, *required)
    columns = {"name": str, "mode": str, **dict.fromkeys(numbers, float)}
    rows: list[dict[str, Any]] = []
    for one in sweeps:
        needed = {name: one.required_resolution(part) for name, part in required.items()}
        rows += [
            {
                "name": one.name,
                "mode": one.mode,
                "friction": friction,
                "sensor_resolution": resolution,
                **{name: float(getattr(one, name)[row, column]) for name in values},
                **{name: float(angles[row]) for name, angles in needed.items()},
            }
            for row, friction in enumerate(one.friction.tolist())
            for column, resolution in enumerate(one.sensor_resolution.tolist())
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
    """Write sweeps as a table with one row for each name, friction and resolution.

    Columns: name, mode, friction, sensor_resolution [rad], stable, ambiguous, unstable,
    accuracy_ceiling, for each of `fractions` `required_resolution_P` [rad] with P in percent (the
    same at all resolutions), and error.

    Args:
        path: File to make or replace; .csv or .parquet.
        sweeps: The sweeps.
        fractions: Required area fractions of S, each above 0 and at most 1.
        failures: Error messages by name of the surfaces that could not be swept: one row each,
            empty except for the name and the error.
        settings: Written as JSON to Parquet's metadata, under `grasp3d`.

    Raises:
        SettingError: A fraction is outside its range.
        OutputError: The suffix is unknown, or the file cannot be written.
    """
    from grasp3d.system.tables import table_of_rows, write_table

    rows, columns = table_rows(sweeps, fractions)
    rows += [{"name": name, "error": reason} for name, reason in (failures or {}).items()]
    entries = [{"error": "", **row} for row in rows]
    table = table_of_rows(entries, {**columns, "error": str}, settings=settings or {})
    write_table(Path(path), table)


def sweep(
    angles: AngleDistribution,
    *,
    friction: ArrayLike,
    sensor_resolution: ArrayLike,
    name: str = "",
    mode: Mode = "label",
) -> Sweep:
    """Compute area fractions S, M and U over friction and sensor resolution, from critical angles.

    Args:
        angles: Critical angles of a surface, from `SurfaceLabels.angle_distribution`, or of a shape
            in closed form.
        friction: Coulomb coefficients above 0, one or several, in any order.
        sensor_resolution: Resolutions alpha [rad], likewise.
        name: Name of the surface.
        mode: Whether the grasps were searched ('label') or given ('scan').

    Raises:
        SettingError: A value is outside its range.
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
    """
    check_choice("mode", mode, Mode)
    frictions = _in_order(friction, "friction")
    resolutions = _in_order(sensor_resolution, "sensor resolution")
    for coefficient in frictions.tolist():
        GraspModel(friction=coefficient)
    for resolution in resolutions.tolist():
        GraspModel(sensor_resolution=resolution)
    return _swept(angles, frictions, resolutions, name=name, mode=mode)


def _in_order(values: ArrayLike, what: str) -> Floats:
    """One or more numbers in increasing order, each once."""
    try:
        numbers = np.unique(np.asarray(values, dtype=np.float64).reshape(-1))
    except (TypeError, ValueError) as error:
        raise SettingError(f"each {what} must be a number: {error}") from error
    if not len(numbers):
        raise SettingError(f"no {what} to sweep over: give at least one")
    return locked(numbers)


def _swept(
    angles: AngleDistribution, friction: Floats, resolution: Floats, *, name: str, mode: Mode
) -> Sweep:
    """Sweep critical angles over values in increasing order."""
    beta, tilt = _friction_angles(friction)[:, None], resolution[None, :] / 2.0
    stable, ambiguous, unstable = map(locked, angles.fractions_at(beta, tilt))
    return Sweep(name, mode, friction, resolution, stable, ambiguous, unstable, angles)


def _friction_angles(friction: Floats) -> Floats:
    """Half-angles of the friction cones [rad], to the last digit those of a `GraspModel`."""
    return np.array([math.atan(coefficient) for coefficient in friction])


def mean_sweep(sweeps: Sequence[Sweep], *, name: str = "") -> Sweep:
    """Mean over surfaces with equal weights, independent of their areas.

    Its required resolution is that of the mean fractions, not the mean of required resolutions.

    Args:
        sweeps: Sweeps of the same values, mode and fingers; at least one.
        name: Name of the mean.

    Raises:
        SettingError: There is no sweep, or they differ in these.
    """
    if not sweeps:
        raise SettingError("the mean needs at least one sweep")
    first = sweeps[0]
    for other in sweeps[1:]:
        if _kind(other) != _kind(first):
            raise SettingError(
                "the mean needs sweeps of the same frictions, resolutions, mode and fingers; "
                f"{other.name!r} differs from {first.name!r}"
            )
    mean = _MeanAngles(tuple(one.distribution for one in sweeps))
    return _swept(mean, first.friction, first.sensor_resolution, name=name, mode=first.mode)


def _kind(one: Sweep) -> tuple[object, ...]:
    values = one.friction.tolist(), one.sensor_resolution.tolist()
    return one.mode, one.distribution.fingers, values


class _MeanAngles(AngleDistribution):
    """Mean of several surfaces' distributions."""

    def __init__(self, parts: tuple[AngleDistribution, ...]) -> None:
        self._parts = parts
        self.limit = min(part.limit for part in parts)
        self.fingers = parts[0].fingers

    def worst_below(self, angles: ArrayLike) -> Floats:
        """See `AngleDistribution`."""
        return np.asarray(np.mean([part.worst_below(angles) for part in self._parts], axis=0))

    def best_below(self, angles: ArrayLike) -> Floats:
        """See `AngleDistribution`."""
        return np.asarray(np.mean([part.best_below(angles) for part in self._parts], axis=0))
