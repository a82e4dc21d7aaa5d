"""Parquet tables of vertices."""

from pathlib import Path

import numpy as np

from grasp3d.export.npz import packed, unpacked
from grasp3d.export.stored import Stored, damaged, fingers_of
from grasp3d.mesh.reading.sources import Source
from grasp3d.surface.fields import XYZ, Array, Arrays, Field
from grasp3d.surface.labels import SurfaceLabels
from grasp3d.surface.vertex_fields import SURFACE, VERTICES
from grasp3d.system.documents import parse_json
from grasp3d.system.names import reason_of

SURFACE_KEY = "grasp3d_surface"
"""Key of the file's metadata with the arrays that are no columns: an NPZ in base64."""


def write_fields(path: str | Path, labels: SurfaceLabels) -> None:
    """Write a Parquet table with a row for each vertex, for pandas, Polars and DuckDB.

    Columns: x y z (in the coordinates of the mesh's own file), outward nx ny nz, `area` around the
    vertex, `label` (text: S, M, U), `critical_angle`, `critical_angle_best`, `max_resolution` and
    `margin` (radians; inf, 0 and -inf where there is no grasp), `epsilon`, `epsilon_min`,
    `epsilon_max` and `opening` (nan where there is none), `grip`, `reason` (text, as in `Reason`),
    of each other finger `partner_2_x` ... and outward `partner_2_nx` ... (nan where there is none),
    and more, see the page on file formats. nan and inf are kept and nothing is null. The settings
    are in the schema's metadata under `grasp3d` as JSON, the faces in the file's metadata.

    Args:
        path: File to make or replace.
        labels: The labels.

    Raises:
        OutputError: The file cannot be written.

    Example:
        >>> import trimesh
        >>> import grasp3d
        >>> ball = grasp3d.load_mesh(trimesh.creation.icosphere(2), unit="cm", max_edge="9cm")
        >>> labels = grasp3d.label_surface(ball)
        >>> grasp3d.write_fields("ball.parquet", labels)
        >>> import pyarrow.parquet
        >>> table = pyarrow.parquet.read_table("ball.parquet", columns=["label", "opening"])
        >>> table.num_rows, table["label"].unique().to_pylist()
        (162, ['S'])
    """
    from grasp3d.system.tables import write_arrow

    metadata = {SURFACE_KEY: packed(SURFACE, labels).encode("ascii")}
    table = labels.to_table()
    for name, column in zip(XYZ, labels.mesh.file_points.T, strict=True):
        table = table.set_column(table.column_names.index(name), name, [column])
    write_arrow(Path(path), table, metadata)


def read_fields(source: Source) -> Stored | None:
    """Read a Parquet table of vertices; None: it has none of grasp3d. Raises MeshError."""
    from grasp3d.system.tables import read_arrow

    try:
        columns, metadata = read_arrow(source.path)
        if "grasp3d" not in metadata:
            return None
        settings = {
            str(name): str(value) for name, value in dict(parse_json(metadata["grasp3d"])).items()
        }
        values = _values(columns, fingers_of(settings))
        values |= unpacked(source, metadata[SURFACE_KEY])
    except (OSError, ValueError, KeyError, TypeError, MemoryError) as error:
        reason = getattr(error, "strerror", None) or reason_of(error)
        raise damaged(source, f"its table cannot be read ({reason})") from error
    return Stored(source, settings, values)


def _values(columns: Arrays, fingers: int) -> Arrays:
    """Values by field. Raises ValueError."""
    values = {
        field.name: field.from_columns(columns, fingers)
        for field in VERTICES
        if field.table and set(field.column_names(fingers)) <= columns.keys()
    }
    for field in VERTICES:
        if field.texts and field.name in values:
            values[field.name] = codes_of(field, values[field.name])
    return values


def codes_of(field: Field, texts: Array) -> Array:
    """Codes of texts. Raises ValueError."""
    names, positions = np.unique(texts.astype(str), return_inverse=True)
    unknown = [name for name in names.tolist() if name not in field.texts]
    if unknown:
        raise ValueError(f"its {field.name} is {unknown[0][:20]!r} somewhere")
    codes = np.array([field.texts.index(text) for text in names.tolist()], dtype=field.kind)
    return codes[positions] if len(codes) else np.empty(0, dtype=field.kind)
