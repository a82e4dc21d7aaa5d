"""The summary of a batch as a Parquet table."""

import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from grasp3d.batch.job import BatchSettings, Row
from grasp3d.files import written_whole

_SCHEMA = pa.schema(
    [
        ("mesh", pa.string()),
        ("source", pa.string()),
        ("error", pa.string()),
        ("labeled", pa.string()),
        ("vertices", pa.int64()),
        ("faces", pa.int64()),
        ("size", pa.float64()),
        ("unit", pa.string()),
        ("closed", pa.bool_()),
        ("stable", pa.float64()),
        ("ambiguous", pa.float64()),
        ("no_grasp_found", pa.float64()),
        ("critical_angle_p10", pa.float64()),
        ("critical_angle_p50", pa.float64()),
        ("critical_angle_p90", pa.float64()),
        ("epsilon_p10", pa.float64()),
        ("epsilon_p50", pa.float64()),
        ("epsilon_p90", pa.float64()),
        ("epsilon_min_p10", pa.float64()),
        ("epsilon_min_p50", pa.float64()),
        ("epsilon_min_p90", pa.float64()),
        ("torque_scale", pa.float64()),
        ("repairs", pa.string()),
        ("warnings", pa.string()),
        ("seconds", pa.float64()),
    ]
)


def write_summary(path: Path, rows: Sequence[Row], settings: BatchSettings) -> None:
    """Write the rows, sorted by mesh; the settings are in the schema's metadata as JSON.

    With them stand the rank of epsilon, and how its minimum over all tilts was taken.

    Args:
        path: Parquet file to make or replace.
        rows: One per mesh.
        settings: What all meshes were labelled with; angles in radians.

    Raises:
        OutputError: The file cannot be written.
    """
    table = pa.Table.from_pylist(
        [_printable(asdict(row)) for row in sorted(rows, key=lambda row: row.mesh)], schema=_SCHEMA
    )
    model = settings.model
    told = {"epsilon_rank": model.epsilon_rank, "epsilon_min": model.tilts}
    metadata = {"grasp3d": json.dumps({**asdict(settings), **told})}
    with written_whole(path) as part:
        pq.write_table(table.replace_schema_metadata(metadata), part)


def _printable(row: dict[str, Any]) -> dict[str, Any]:
    """Write out the bytes of file names that are no Unicode."""
    return {
        key: value.encode("utf-8", "surrogateescape").decode("utf-8", "backslashreplace")
        if isinstance(value, str)
        else value
        for key, value in row.items()
    }
