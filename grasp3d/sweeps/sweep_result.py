"""Area fractions S, M and U over two of the uncertainties, and their table."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from grasp3d.arrays import Floats, locked, short_repr
from grasp3d.settings.lengths import Unit
from grasp3d.stability.angle_distributions import AngleDistribution
from grasp3d.stability.label import Mode
from grasp3d.sweeps.axes import COLUMN, NAMES, AxisName, AxisValues


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
        found = np.maximum(0.0, 2.0 * (least - worst - self.axes.grid("normal_error")))
        shape = len(self.axes.values[row]), len(self.axes.values[column])
        if column == COLUMN:
            return locked(np.broadcast_to(found, (shape[0], 1))[:, 0])
        return locked(np.broadcast_to(found, shape))

    def to_table(self, *, fractions: Sequence[float] = ()) -> Any:
        """Return a `pyarrow.Table` with a row for each friction and resolution.

        The columns are those of `write_sweeps`, without `error`.

        Args:
            fractions: Required area fractions of S, each above 0 and at most 1.

        Raises:
            SettingError: A fraction is outside its range.
        """
        from grasp3d.tables import table_of_rows

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
        from grasp3d.tables import data_frame

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
        written = {value: getattr(one, value) for value in values}
        for column, fraction in required.items():
            needed = one.required_resolution(fraction)
            written[column] = needed[:, None] if needed.ndim == 1 else needed
        written |= {name: one.axes.grid(name) for name in NAMES}
        written = {name: np.broadcast_to(value, shape) for name, value in written.items()}
        texts = {"name": one.name, "mode": one.mode, "unit": one.unit or ""}
        rows += [
            texts | {name: float(value[entry]) for name, value in written.items()}
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
    from grasp3d.tables import write_table

    rows, columns = table_rows(sweeps, fractions)
    rows += [{"name": name, "error": reason} for name, reason in (failures or {}).items()]
    written = [{"error": "", **row} for row in rows]
    write_table(Path(path), written, {**columns, "error": str}, settings=settings or {})
