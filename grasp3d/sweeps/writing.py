"""Writes sweeps as a table."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from grasp3d.sweeps.sweep_result import Sweep, table_rows


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
