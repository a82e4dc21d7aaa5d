"""Vertices and triangles of a PLY with all properties; sizes are checked before reading."""

from typing import Any

import numpy as np
import numpy.typing as npt

from grasp3d.arrays import Ints
from grasp3d.export.stored import damaged
from grasp3d.reading.ply import Element, PlyHeader
from grasp3d.reading.sources import Source

CORNERS = 3
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
    read = _binary if header.order else _text
    columns, corners = read(source, header.order, vertex, face, data)
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
    found = np.frombuffer(data, rows, vertex.count)
    triangles = np.frombuffer(data, triangle, face.count, head)
    _check_triangles(source, triangles["count"])
    return {name: found[name].astype(rows[name].newbyteorder("=")) for name in rows.names or ()}, (
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
