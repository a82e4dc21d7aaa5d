"""PLY files of surfaces with columns of numbers at their vertices."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from grasp3d.arrays import Ints
from grasp3d.system.files import atomic_write

_TYPES = {"<f8": "double", "<f4": "float", "|u1": "uchar", "<i4": "int"}


def write_ply_columns(
    path: Path,
    columns: Mapping[str, npt.NDArray[Any]],
    faces: Ints,
    settings: Mapping[str, Any],
    *,
    binary: bool = True,
) -> None:
    """Write a PLY of triangles, with settings in comments that begin with `grasp3d`.

    Args:
        path: File to make or replace.
        columns: Vertex properties by name, (V,) each, of 64 or 32 bits, or bytes; with x y z.
        faces: Faces (F, 3).
        settings: Values without line breaks, by name.
        binary: Little-endian binary; otherwise text.

    Raises:
        OutputError: The file cannot be written.
    """
    count = len(next(iter(columns.values())))
    vertices = np.empty(count, dtype=[(name, column.dtype) for name, column in columns.items()])
    for name, column in columns.items():
        vertices[name] = column
    rows = np.empty(len(faces), dtype=[("count", "u1"), ("corners", "<i4", 3)])
    rows["count"], rows["corners"] = 3, faces
    header = "\n".join(
        [
            "ply",
            f"format {'binary_little_endian' if binary else 'ascii'} 1.0",
            *(f"comment grasp3d {key} {value}" for key, value in settings.items()),
            f"element vertex {count}",
            *(f"property {_TYPES[c.dtype.str]} {name}" for name, c in columns.items()),
            f"element face {len(faces)}",
            "property list uchar int vertex_indices",
            "end_header\n",
        ]
    )
    with atomic_write(path) as part, part.open("wb") as stream:
        stream.write(header.encode("ascii"))
        if binary:
            vertices.tofile(stream)
            rows.tofile(stream)
        else:
            for row in vertices:
                stream.write((" ".join(str(value) for value in row) + "\n").encode())
            np.savetxt(stream, np.column_stack([rows["count"], rows["corners"]]), fmt="%d")
