"""Parquet tables of vertices."""

from pathlib import Path

from grasp3d.surface.fields import XYZ
from grasp3d.surface.labels import SurfaceLabels


def write_fields(path: str | Path, labels: SurfaceLabels) -> None:
    """Write a Parquet table with a row for each vertex, for pandas, Polars and DuckDB.

    Columns: x y z (in the coordinates of the mesh's own file), outward nx ny nz, `area` around the
    vertex, `label` (text: S, M, U), `critical_angle`, `critical_angle_best`, `max_resolution` and
    `margin` (radians; inf, 0 and -inf where there is no grasp), `epsilon`, `epsilon_min`,
    `epsilon_max` and `opening` (nan where there is none), `grip`, `reason` (text, as in `Reason`),
    of each other finger `partner_2_x` ... and outward `partner_2_nx` ... (nan where there is none),
    and more, see the page on file formats. nan and inf are kept and nothing is null. The settings
    are in the schema's metadata under `grasp3d` as JSON; the faces are not in it.

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

    table = labels.to_table()
    for name, column in zip(XYZ, labels.mesh.file_points.T, strict=True):
        table = table.set_column(table.column_names.index(name), name, [column])
    write_arrow(Path(path), table)
