"""Labelled PLY files."""

from pathlib import Path

from grasp3d.export.fields import present
from grasp3d.export.settings import settings_of
from grasp3d.export.vertex_fields import VERTICES
from grasp3d.surface.labels import SurfaceLabels
from grasp3d.tables.ply_files import write_ply_columns


def write_ply(path: str | Path, labels: SurfaceLabels, *, binary: bool = True) -> None:
    """Write a labelled PLY: the mesh with one label, colour and set of numbers per vertex.

    Per vertex: x y z (double), outward nx ny nz, red green blue, `label` (uchar: 0 U, 1 M, 2 S),
    `critical_angle`, `critical_angle_best`, `max_resolution` and `margin` (float, radians; inf, 0
    and -inf where there is no grasp), `epsilon`, `epsilon_min` and `epsilon_max` (float; nan where
    there is no grasp); with a location error, a gripper or a load further fields, see the page on
    file formats. The settings are in comments that begin with `grasp3d`.

    Args:
        path: File to make or replace.
        labels: The labels.
        binary: Little-endian binary; otherwise text.

    Raises:
        OutputError: The file cannot be written.

    Example:
        >>> import trimesh
        >>> import grasp3d
        >>> ball = grasp3d.load_mesh(trimesh.creation.icosphere(2), unit="cm", max_edge=9.0)
        >>> labels = grasp3d.label_surface(ball)
        >>> grasp3d.write_ply("ball.ply", labels)
        >>> trimesh.load_mesh("ball.ply").vertices.shape
        (162, 3)
    """
    chosen = (field for field in VERTICES if field.ply)
    columns = {
        name: column.astype(field.ply)
        for field, values in present(chosen, labels)
        for name, column in field.as_columns(values).items()
    }
    write_ply_columns(Path(path), columns, labels.mesh.faces, settings_of(labels), binary=binary)
