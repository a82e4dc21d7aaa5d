"""PLY files of surfaces with columns of numbers at their vertices, and settings in comments."""

import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from grasp3d.arrays import Ints
from grasp3d.system.files import atomic_write

_TYPES = {"<f8": "double", "<f4": "float", "|u1": "uchar", "<i4": "int"}

COMMENT, MORE = "comment grasp3d ", "comment grasp3d+ "
"""Beginnings of a line with a setting, and of lines that continue its value."""

FACE = np.dtype([("count", "u1"), ("corners", "<i4", 3)])
FACES = "property list uchar int vertex_indices"
"""A triangle, and its line in the header."""

WIDTH = 200
"""Longest part of a value in one line: MeshLab and Open3D read no header with long lines."""


def write_ply_columns(
    path: Path, columns: Mapping[str, npt.NDArray[Any]], faces: Ints, settings: Mapping[str, Any]
) -> None:
    """Write a binary PLY of triangles, with settings in comments that begin with `grasp3d`.

    Some programs read no file with other elements than vertices and faces, nor other properties of
    faces than their corners.

    Args:
        path: File to make or replace.
        columns: Vertex properties by name, (V,) each, of 64 or 32 bits, or bytes; with x y z.
        faces: Faces (F, 3).
        settings: Values without line breaks, by name.

    Raises:
        OutputError: The file cannot be written.
    """
    count = len(next(iter(columns.values())))
    vertices = np.empty(count, dtype=[(name, column.dtype) for name, column in columns.items()])
    for name, column in columns.items():
        vertices[name] = column
    rows = np.empty(len(faces), FACE)
    rows["count"], rows["corners"] = 3, faces
    header = "\n".join(
        [
            "ply",
            "format binary_little_endian 1.0",
            *(line for key, value in settings.items() for line in _lines(key, str(value))),
            f"element vertex {count}",
            *(f"property {_TYPES[c.dtype.str]} {name}" for name, c in columns.items()),
            f"element face {len(faces)}",
            FACES,
            "end_header\n",
        ]
    )
    with atomic_write(path) as part, part.open("wb") as stream:
        stream.write(header.encode("ascii"))
        vertices.tofile(stream)
        rows.tofile(stream)


def _lines(key: str, value: str) -> Iterator[str]:
    """A setting as lines of a header, which break at no spaces: programs strip these."""
    first, *rest = re.findall(rf".{{0,{WIDTH - 1}}}\S(?!\s)|.+", value) or [""]
    yield f"{COMMENT}{key} {first}"
    yield from (f"{MORE}{part}" for part in rest)


def settings_of_header(header: bytes) -> dict[str, str]:
    """The settings in the header of a PLY, as text by name."""
    text = header.decode("ascii", "replace").replace("\r\n", "\n").replace(f"\n{MORE}", "")
    lines = (line for line in text.splitlines() if line.startswith(COMMENT))
    parts = (line.removeprefix(COMMENT).partition(" ") for line in lines)
    return {name: value for name, _, value in parts}
