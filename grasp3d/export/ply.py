"""Labelled PLY files."""

from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from grasp3d.arrays import Ints
from grasp3d.export.npz import packed, unpacked
from grasp3d.export.stored import Stored, damaged, fingers_of
from grasp3d.mesh.reading.polygon_files import Column, Element, PlyFile, open_ply, read_elements
from grasp3d.mesh.reading.sources import Source, check_corners
from grasp3d.surface.fields import DECIDED, EPSILONS, FLOAT, Arrays, present
from grasp3d.surface.labels import SurfaceLabels
from grasp3d.surface.vertex_fields import SURFACE, VERTICES
from grasp3d.system.ply_files import settings_of_header, write_ply_columns


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

_KINDS = {"u1": "a uchar", "f8": "a double"}


def read_ply(source: Source) -> Stored | None:
    """Read a labelled PLY; None: it has no labels. Raises MeshError."""
    file = open_ply(source)
    vertex = file.elements.get("vertex", Element(0, {}))
    kinds = {name: "list" if length else kind for name, (kind, length) in vertex.properties.items()}
    if not set(LABELLED) & set(kinds):
        return None
    settings = settings_of_header(file.header)
    missing = next((name for name in LABELLED if name not in kinds), None)
    if missing is not None:
        name = next(name for name in LABELLED if name in kinds)
        raise damaged(source, f"its vertices have a property {name!r} but no {missing!r}")
    if PACKED not in settings:
        raise damaged(source, "not their grasps: it is of an older version, or incomplete")
    try:
        fingers = fingers_of(settings)
        fields = {
            field: names
            for field in VERTICES
            if field.ply not in {"", FLOAT}
            and set(names := field.column_names(fingers)) <= kinds.keys()
        }
        for field, names in fields.items():
            if {kinds[name] for name in names} != {field.ply}:
                raise damaged(source, f"its property {names[0]!r} is not {_KINDS[field.ply]}")
        columns, faces = read_tables(file)
        values = unpacked(source, settings.pop(PACKED)) | {"faces": faces}
    except (OSError, MemoryError, ValueError, OverflowError) as error:
        reason = getattr(error, "strerror", None) or str(error) or "memory is too small"
        raise damaged(source, f"it cannot be read ({' '.join(reason.split())[:200]})") from error
    values |= {field.name: field.from_columns(columns, fingers) for field in fields}
    return Stored(source, settings, values)


def read_tables(file: PlyFile) -> tuple[Arrays, Ints]:
    """Read a PLY whose vertices have only scalar properties and whose faces are triangles.

    Args:
        file: The file.

    Returns:
        Properties of the vertices by name, shape (V,) each, and the triangles, (F, 3).

    Raises:
        MeshError: The file has other elements, is incomplete, or has invalid faces.
        ValueError: Numbers do not have the type that the header gives.
    """
    source, kinds = file.source, {name: one.properties for name, one in file.elements.items()}
    lists = [length != "" for properties in kinds.values() for _, length in properties.values()]
    if [*kinds] != ["vertex", "face"] or lists != [*[False] * len(kinds["vertex"]), True]:
        raise damaged(source, "its elements are not vertices with numbers, then triangles")
    elements = read_elements(file)
    (corners,) = elements.get("face", {}).values()
    if not isinstance(corners, np.ndarray) or corners.shape[1:] != (3,):
        raise damaged(source, "its faces are not all triangles")
    faces = _exact(corners, "i8")
    check_corners(faces, file.elements["vertex"].count, source.where)
    columns = elements["vertex"]
    return {name: _exact(columns[name], kind) for name, (kind, _) in kinds["vertex"].items()}, faces


def _exact(values: Column, kind: str) -> npt.NDArray[Any]:
    """Numbers in the type that the header gives. Raises ValueError: they do not have it."""
    values = np.asarray(values)
    if kind[0] == "f":
        return values.astype(kind)  # only the order of the bytes
    limits = np.iinfo(kind)
    if not ((values >= limits.min) & (values <= limits.max) & (values % 1.0 == 0.0)).all():
        raise ValueError("expected a whole number")
    return values.astype(kind)
