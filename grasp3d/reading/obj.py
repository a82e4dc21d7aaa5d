"""Reduction of an OBJ file to its positions and faces."""

import re

from grasp3d.errors import MeshError
from grasp3d.reading.sources import Source

MOST_CORNERS = 1000
"""Largest number of corners of a face; round lids have a few hundred."""

LEAST_CORNERS = COORDINATES = 3


def plain_obj(source: Source, data: bytes) -> tuple[bytes, int, int]:
    """Return an OBJ with positions and faces only, so that trimesh keeps the order of vertices.

    With texture coordinates and normals trimesh would split and reorder vertices; with materials
    and groups it would split the mesh and open other files.

    Returns:
        (the OBJ, number of positions, number of faces).

    Raises:
        MeshError: A vertex has too few coordinates, or a face too few or too many corners.
        ValueError: A face has an invalid vertex number.
    """
    data = re.sub(rb"\\\r?\n", b" ", data)
    kept: list[bytes] = []
    count = 0
    for number, line in enumerate(data.splitlines(), 1):
        words = line.split()
        if not words:
            continue
        if words[0] == b"v":
            if len(words) <= COORDINATES:
                raise MeshError(f"{source.where}: line {number}: a vertex needs three coordinates")
            count += 1
            kept.append(b" ".join(words[: 1 + COORDINATES]))
        elif words[0] == b"f":
            if not LEAST_CORNERS < len(words) <= 1 + MOST_CORNERS:
                raise MeshError(
                    f"{source.where}: line {number} is a face of {len(words) - 1:,} corners; "
                    f"{LEAST_CORNERS} to {MOST_CORNERS:,} are allowed"
                )
            kept.append(b" ".join([b"f", *(_absolute(word, count) for word in words[1:])]))
    return b"\n".join(kept), count, len(kept) - count


def _absolute(corner: bytes, count: int) -> bytes:
    """Return the vertex number of a face's corner `v/vt/vn`, counted from the start of the file."""
    index = corner.split(b"/", 1)[0]
    if not index.startswith((b"-", b"0")):
        return index
    number = int(index)
    absolute = number if number > 0 else count + 1 + number
    if number == 0 or absolute < 1:
        raise ValueError(f"a face uses vertex {number}")
    return b"%d" % absolute


def check_obj_lines(source: Source, data: bytes) -> None:
    """Find the first invalid line of an OBJ, after trimesh failed to read it.

    Raises:
        MeshError: A line is invalid.
    """
    lines = data.splitlines()
    total, count = sum(line.split()[:1] == [b"v"] for line in lines), 0
    for number, line in enumerate(lines, 1):
        words = line.split()
        count += words[:1] == [b"v"]
        try:
            _check_line(words, count, total)
        except ValueError as error:
            text = line.decode("utf-8", "replace")[:40]
            raise MeshError(
                f"{source.where}: line {number}, {text!r}, cannot be read ({error}); export the "
                "mesh again"
            ) from error


def _check_line(words: list[bytes], count: int, total: int) -> None:
    if words[:1] == [b"v"] and len([float(word) for word in words[1:]]) < COORDINATES:
        raise ValueError("a vertex needs three coordinates")
    if words[:1] == [b"f"]:
        for word in words[1:]:
            if int(_absolute(word, count)) > total:
                raise ValueError(f"there are {total:,} vertices")
