"""Labelled PLY files."""

from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from grasp3d.arrays import Ints
from grasp3d.export.npz import packed, unpacked
from grasp3d.export.stored import Stored, damaged, fingers_of
from grasp3d.reading.obj_off_stl import check_declared_size
from grasp3d.reading.ply import Element, PlyHeader, read_ply_header
from grasp3d.reading.sources import Source
from grasp3d.surface.fields import DECIDED, EPSILONS, FLOAT, present
from grasp3d.surface.label_settings import complete_settings
from grasp3d.surface.labels import SurfaceLabels
from grasp3d.surface.vertex_fields import SURFACE, VERTICES
from grasp3d.system.ply_files import settings_of_header, write_ply_columns


def write_ply(path: str | Path, labels: SurfaceLabels, *, binary: bool = True) -> None:
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
    fields = (field for field in VERTICES if field.ply)
    columns = {
        name: column.astype(field.ply)
        for field, values in present(fields, labels)
        for name, column in field.as_columns(values).items()
    }
    settings = {**complete_settings(labels), PACKED: packed((*HIDDEN, *SURFACE[1:]), labels)}
    write_ply_columns(Path(path), columns, labels.mesh.faces, settings, binary=binary)


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
    header = read_ply_header(source)
    kinds = {
        entry.name: "list" if entry.length else entry.type
        for element in header.elements
        if element.name == "vertex"
        for entry in element.properties
    }
    if not set(LABELLED) & set(kinds):
        return None
    settings = settings_of_header(source.head(header.start))
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
        check_declared_size(source)
        columns, faces = read_tables(source, header)
        values = unpacked(source, settings.pop(PACKED)) | {"faces": faces}
    except (OSError, MemoryError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error) or "memory is too small"
        raise damaged(source, f"it cannot be read ({' '.join(reason.split())[:200]})") from error
    values |= {field.name: field.from_columns(columns, fingers) for field in fields}
    return Stored(source, settings, values)


CORNERS = 3
"""Corners of each face."""

Columns = dict[str, npt.NDArray[Any]]


def read_tables(source: Source, header: PlyHeader) -> tuple[Columns, Ints]:
    """Read a PLY whose vertices have only scalar properties and whose faces are triangles.

    Args:
        source: The file; its declared sizes were already compared with its length.
        header: Its header.

    Returns:
        Properties of the vertices by name, shape (V,) each, and the triangles, (F, 3).

    Raises:
        MeshError: The file has other elements, is incomplete, or has invalid faces.
    """
    vertex, face = _layout(source, header)
    data = source.path.read_bytes()[header.start :]
    reader = _binary if header.order else _text
    columns, corners = reader(source, header.order, vertex, face, data)
    if corners.size and (corners.min() < 0 or corners.max() >= vertex.count):
        raise damaged(source, f"a face refers to none of its {vertex.count:,} vertices")
    return columns, np.asarray(corners, dtype=np.int64)


def _layout(source: Source, header: PlyHeader) -> tuple[Element, Element]:
    """The vertex and the face element of a file that has only these two."""
    if [element.name for element in header.elements] == ["vertex", "face"]:
        vertex, face = header.elements
        if not vertex.lists and face.lists == len(face.properties) == 1:
            return vertex, face
    raise damaged(source, "its elements are not vertices with scalar properties, then triangles")


def _binary(
    source: Source, order: str, vertex: Element, face: Element, data: bytes
) -> tuple[Columns, npt.NDArray[Any]]:
    (corners,) = face.properties
    rows = np.dtype([(entry.name, order + entry.type) for entry in vertex.properties])
    triangle = np.dtype(
        [("count", f"{order}{corners.length}"), ("corners", order + corners.type, (CORNERS,))]
    )
    head = vertex.count * rows.itemsize
    if len(data) != head + face.count * triangle.itemsize:
        raise damaged(
            source, f"{len(data):,} bytes are not {vertex.count:,} vertices and {face.count:,} "
            "triangles: is it complete?",
        )  # fmt: skip
    table = np.frombuffer(data, rows, vertex.count)
    triangles = np.frombuffer(data, triangle, face.count, head)
    _check_triangles(source, triangles["count"])
    return {name: table[name].astype(rows[name].newbyteorder("=")) for name in rows.names or ()}, (
        triangles["corners"]
    )


def _text(
    source: Source, _: str, vertex: Element, face: Element, data: bytes
) -> tuple[Columns, npt.NDArray[Any]]:
    words = data.split()
    width = len(vertex.properties)
    head = vertex.count * width
    if len(words) != head + face.count * (1 + CORNERS):
        raise damaged(
            source, f"{len(words):,} numbers are not {vertex.count:,} vertices and {face.count:,} "
            "triangles: is it complete?",
        )  # fmt: skip
    try:
        rows = np.array(words[:head], dtype=np.float64).reshape(-1, width)
        triangles = np.array(words[head:], dtype=np.int64).reshape(-1, 1 + CORNERS)
        columns = {
            entry.name: _exact(rows[:, number], entry.type)
            for number, entry in enumerate(vertex.properties)
        }
    except (ValueError, OverflowError) as error:
        raise damaged(source, f"it contains something that is not a number ({error})") from error
    _check_triangles(source, triangles[:, 0])
    return columns, triangles[:, 1:]


def _exact(values: npt.NDArray[np.float64], kind: str) -> npt.NDArray[Any]:
    """Convert parsed numbers to the type given in the header."""
    if kind[0] == "f":
        with np.errstate(over="ignore"):  # overflow gives inf, which is checked later
            return values.astype(kind)
    limits = np.iinfo(kind)
    if not ((values >= limits.min) & (values <= limits.max) & (values % 1.0 == 0.0)).all():
        raise ValueError("expected a whole number")
    return values.astype(kind)


def _check_triangles(source: Source, counts: npt.NDArray[Any]) -> None:
    if (counts != CORNERS).any():
        raise damaged(source, "its faces are not all triangles")
