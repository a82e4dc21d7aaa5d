"""Area fractions S, M and U over friction and sensor resolution, and the required resolution."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from grasp3d.arrays import ArrayLike, Floats, locked, short_repr
from grasp3d.errors import SettingError
from grasp3d.settings import GraspModel, check_choice
from grasp3d.stability.angle_distributions import AngleDistribution
from grasp3d.stability.label import Mode


@dataclass(frozen=True, eq=False)
class Sweep:
    """Area fractions of one surface, or their mean over several, by friction and resolution.

    Rows are frictions (m,), columns resolutions (k,); in every entry S + M + U = 1.
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

        S + U + M / 2 (Wan & Howe 2018, Sec. V): half of the ambiguous grasps are guessed correctly.
        """
        return self.stable + self.unstable + self.ambiguous / 2.0

    def required_resolution(self, fraction: float) -> Floats:
        """Coarsest resolution alpha below which an area fraction is S [rad], shape (m,).

        Independent of the swept resolutions; 0 where no sensor is fine enough.

        Args:
            fraction: Area fraction, above 0, at most 1.

        Raises:
            SettingError: The fraction is outside its range.
        """
        return locked(
            [
                self.distribution.required_resolution(fraction, friction=friction)
                for friction in self.friction.tolist()
            ]
        )

    def to_table(self, *, fractions: Sequence[float] = ()) -> Any:
        """Return a `pyarrow.Table` with a row for each friction and resolution.

        The columns are those of `write_sweeps`, without `error`.

        Args:
            fractions: Required area fractions of S, each above 0 and at most 1.

        Raises:
            SettingError: A fraction is outside its range.
        """
        from grasp3d.tables import table_of_rows

        rows, columns = _rows_of([self], fractions)
        return table_of_rows(rows, columns, settings={})

    def to_dataframe(self, *, fractions: Sequence[float] = ()) -> Any:
        """Return `to_table` as a `pandas.DataFrame`.

        Args:
            fractions: Required area fractions of S, each above 0 and at most 1.

        Raises:
            SettingError: A fraction is outside its range.
            OutputError: pandas is not installed; the extra `grasp3d[pandas]` installs it.
        """
        from grasp3d.tables import data_frame

        return data_frame(self.to_table(fractions=fractions))


def sweep(
    distribution: AngleDistribution,
    *,
    friction: ArrayLike,
    sensor_resolution: ArrayLike,
    name: str = "",
    mode: Mode = "label",
) -> Sweep:
    """Compute area fractions S, M and U at every friction and resolution, from critical angles.

    Args:
        distribution: Critical angles of a surface, from `SurfaceLabels.angle_distribution`.
        friction: Coulomb coefficients above 0, one or more, in any order.
        sensor_resolution: Resolutions alpha [rad], one or more, in any order.
        name: Name of the surface.
        mode: Whether the grasps were searched ('label') or given ('scan').

    Raises:
        SettingError: A value is outside its range.
        SearchCoverageError: The search did not cover the frictions and resolutions.

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
    """
    check_choice("mode", mode, Mode)
    frictions = _in_order(friction, "friction")
    resolutions = _in_order(sensor_resolution, "sensor resolution")
    angles = [GraspModel(friction=value).friction_angle for value in frictions]
    tilts = [GraspModel(sensor_resolution=value).tilt for value in resolutions]
    stable, ambiguous, unstable = distribution.fractions_at(
        np.array(angles)[:, None], np.array(tilts)
    )
    return Sweep(
        name=name,
        mode=mode,
        friction=locked(frictions),
        sensor_resolution=locked(resolutions),
        stable=locked(stable),
        ambiguous=locked(ambiguous),
        unstable=locked(unstable),
        distribution=distribution,
    )


def mean_sweep(sweeps: Sequence[Sweep], *, name: str = "") -> Sweep:
    """Mean over surfaces with equal weights, independent of their areas.

    Its required resolution is that of the mean fractions, not the mean of required resolutions.

    Args:
        sweeps: Sweeps of the same frictions, resolutions, mode and number of fingers; at least one.
        name: Name of the mean.

    Raises:
        SettingError: There is none, or they differ.
    """
    if not sweeps:
        raise SettingError("the mean needs at least one sweep")
    first = sweeps[0]
    for other in sweeps[1:]:
        if (other.mode, other.distribution.fingers) != (
            first.mode,
            first.distribution.fingers,
        ) or not (
            np.array_equal(other.friction, first.friction)
            and np.array_equal(other.sensor_resolution, first.sensor_resolution)
        ):
            raise SettingError(
                "the mean needs sweeps of the same frictions, resolutions, mode and fingers; "
                f"{other.name!r} differs from {first.name!r}"
            )
    return sweep(
        _MeanAngles(tuple(one.distribution for one in sweeps)),
        friction=first.friction,
        sensor_resolution=first.sensor_resolution,
        name=name,
        mode=first.mode,
    )


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
    same in all rows of a name and friction), and error.

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
    from grasp3d.tables import write_table

    rows, columns = _rows_of(sweeps, fractions)
    rows += [{"name": name, "error": reason} for name, reason in (failures or {}).items()]
    written = [{"error": "", **row} for row in rows]
    write_table(Path(path), written, {**columns, "error": str}, settings=settings or {})


def _rows_of(
    sweeps: Sequence[Sweep], fractions: Sequence[float]
) -> tuple[list[dict[str, Any]], dict[str, type]]:
    """Rows of a table of sweeps, and the types of its columns."""
    required = {f"required_resolution_{100.0 * fraction:g}": fraction for fraction in fractions}
    values = ("stable", "ambiguous", "unstable", "accuracy_ceiling")
    columns = {
        "name": str,
        "mode": str,
        **dict.fromkeys(("friction", "sensor_resolution", *values, *required), float),
    }
    rows: list[dict[str, Any]] = []
    for one in sweeps:
        needed = {column: one.required_resolution(value) for column, value in required.items()}
        written = {value: getattr(one, value) for value in values}
        for (row, column), _ in np.ndenumerate(one.stable):
            rows.append(
                {
                    "name": one.name,
                    "mode": one.mode,
                    "friction": float(one.friction[row]),
                    "sensor_resolution": float(one.sensor_resolution[column]),
                    **{name: float(value[row, column]) for name, value in written.items()},
                    **{name: float(value[row]) for name, value in needed.items()},
                }
            )
    return rows, columns


def _in_order(values: ArrayLike, what: str) -> list[float]:
    """One or more numbers in increasing order, each once."""
    try:
        numbers = np.unique(np.asarray(values, dtype=np.float64).reshape(-1))
    except (TypeError, ValueError) as error:
        raise SettingError(f"each {what} must be a number: {error}") from error
    if not len(numbers):
        raise SettingError(f"no {what} to sweep over: give at least one")
    if not math.isfinite(numbers[-1]):  # nan is sorted last
        raise SettingError(f"each {what} must be a finite number; got {numbers[-1]:g}")
    return [float(number) for number in numbers]
