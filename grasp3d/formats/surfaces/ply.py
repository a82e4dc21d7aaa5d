"""Labelled PLY files."""

from pathlib import Path

from grasp3d.formats.surfaces.npz import packed, unpacked
from grasp3d.formats.surfaces.stored import Stored, damaged, fingers_of
from grasp3d.mesh.reading.sources import Source
from grasp3d.surface.fields import DECIDED, EPSILONS, FLOAT, present
from grasp3d.surface.labels import SurfaceLabels
from grasp3d.surface.vertex_fields import SURFACE, VERTICES
from grasp3d.system.ply_files import (
    ply_header,
    property_names,
    read_ply_columns,
    settings_of_header,
    write_ply_columns,
)


def write_ply(path: str | Path, labels: SurfaceLabels) -> None:
    """Write a labelled PLY: the mesh with one label, colour and set of numbers per vertex.

    Per vertex: x y z, outward nx ny nz, red green blue, `label` (uchar: 0 U, 1 M, 2 S),
    `critical_angle`, `critical_angle_best`, `max_resolution` and `margin` (radians; inf, 0 and -inf
    where there is no grasp), `epsilon`, `epsilon_min` and `epsilon_max` (nan where there is no
    grasp), the opposing contacts `partner_2_x` ... of its grasp; with a location error, a gripper
    (the pose) or a load further fields, see the page on file formats. The settings are in comments
    that begin with `grasp3d`, and what else `read_labels` needs.

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
        >>> grasp3d.write_ply("ball.ply", labels)
        >>> trimesh.load_mesh("ball.ply").vertices.shape
        (162, 3)
    """
    fields = (field for field in VERTICES if field.ply)
    columns = {
        name: column.astype(field.ply)
        for field, values in present(fields, labels)
        for name, column in field.as_columns(values).items()
    }
    settings = {**labels.complete_settings(), PACKED: packed((*HIDDEN, *SURFACE[1:]), labels)}
    write_ply_columns(Path(path), columns, labels.mesh.faces, settings)


PACKED = "packed"
"""Name of the comment with what is not shown of the grasps and the surface; see `npz.packed`."""

HIDDEN = tuple(
    one for one in VERTICES if one.array and not one.ply and one.name != "partner_normals"
)
"""What a PLY has of the vertices in that comment; the normals there follow from the contacts."""


LABELLED = tuple(field.name for field in (*DECIDED, *EPSILONS))
"""Vertex properties that only a labelled file has. A file that has any of them must have all, with
the types, values and comments that `write_ply` writes; otherwise it is refused, as its numbers
could mean anything. Other properties (colours, confidence, texture coordinates) are allowed."""


def read_ply(source: Source) -> Stored | None:
    """Read a labelled PLY; None: it has no labels. Raises MeshError."""
    with source.path.open("rb") as stream:
        header = ply_header(stream)
        settings = settings_of_header(header)
        if {*LABELLED}.isdisjoint(property_names(header)):
            return None
        try:
            fingers = fingers_of(settings)
            columns, faces = read_ply_columns(stream, header)
            values = unpacked(source, settings.pop(PACKED)) | {"faces": faces}
            for name in LABELLED:
                columns[name]
        except (OSError, MemoryError, ValueError, OverflowError, KeyError) as error:
            raise damaged(source, error) from error
    for field in VERTICES:
        if field.ply not in {"", FLOAT} and {*field.column_names(fingers)} <= columns.keys():
            values[field.name] = field.from_columns(columns, fingers)
    return Stored(source, settings, values)
