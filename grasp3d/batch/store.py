"""The summary of a batch as a Parquet table."""

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from types import NoneType
from typing import get_args, get_type_hints

from grasp3d.batch.job import BatchSettings, Row
from grasp3d.tables import write_table


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
    model = settings.model
    told = {"epsilon_rank": model.epsilon_rank, "epsilon_min": model.tilts}
    write_table(
        path,
        [asdict(row) for row in sorted(rows, key=lambda row: row.mesh)],
        {name: _without_none(hint) for name, hint in get_type_hints(Row).items()},
        settings={**asdict(settings), **told},
    )


def _without_none(hint: type) -> type:
    """Type of a field that may be empty."""
    kinds: list[type] = [kind for kind in get_args(hint) if kind is not NoneType]
    return kinds[0] if kinds else hint
