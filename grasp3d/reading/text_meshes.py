"""Reduction of OBJ, OFF and text STL files to what trimesh reads correctly."""

import re
from itertools import pairwise

from grasp3d.reading.declared_sizes import OFF_HEADER, off_counts, without_comments
from grasp3d.reading.sources import Source

MOST_CORNERS = 1000
"""Largest number of corners of a face; round lids have a few hundred."""

LEAST_CORNERS = COORDINATES = 3

_NAME = re.compile(rb"solid[^\n]*")


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
                raise source.error(f"line {number}: a vertex needs three coordinates")
            count += 1
            kept.append(b" ".join(words[: 1 + COORDINATES]))
        elif words[0] == b"f":
            if not LEAST_CORNERS < len(words) <= 1 + MOST_CORNERS:
                raise source.error(
                    f"line {number} is a face of {len(words) - 1:,} corners; "
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
            raise source.error(
                f"line {number}, {text!r}, cannot be read ({error}); export the mesh again"
            ) from error


def _check_line(words: list[bytes], count: int, total: int) -> None:
    if words[:1] == [b"v"] and len([float(word) for word in words[1:]]) < COORDINATES:
        raise ValueError("a vertex needs three coordinates")
    if words[:1] == [b"f"]:
        for word in words[1:]:
            if int(_absolute(word, count)) > total:
                raise ValueError(f"there are {total:,} vertices")


def plain_off(source: Source, data: bytes) -> bytes:
    """Return an OFF without comments and with faces of at most four corners.

    trimesh reads comments as data, and reads no larger faces: they become triangle fans.

    Raises:
        MeshError: A face has fewer corners than it declares.
    """
    vertices, faces = off_counts(source)
    data = without_comments(data)
    header = OFF_HEADER.match(data)
    data = data[header.end() if header else 0 :]
    start, lines = vertices, [line for line in data.splitlines() if line.strip()]
    kept: list[bytes] = []
    for number, line in enumerate(lines[start : start + faces]):
        words = line.split()
        count = int(words[0]) if words[0].isdigit() else 0
        if not 3 <= count < min(len(words), MOST_CORNERS + 1):
            text = line.decode("utf-8", "replace")[:40]
            raise source.error(
                f"face {number} ({text!r}) does not have the corners that it "
                f"declares, of which 3 to {MOST_CORNERS:,} are allowed; export the mesh again"
            )
        if count <= 4:
            kept.append(line)
        else:
            first, *rest = words[1 : count + 1]
            kept += [b"3 %s %s %s" % (first, a, b) for a, b in pairwise(rest)]
    head = b"OFF\n%d %d 0" % (vertices, len(kept))
    return b"\n".join([head, *lines[:start], *kept])


def plain_stl(source: Source, data: bytes) -> tuple[bytes, int]:
    """Return a text STL with all its solids as one solid without a name.

    Names may contain keywords of the format, and trimesh misreads several solids.

    Returns:
        (the text, its number of facets).

    Raises:
        MeshError: It is incomplete.
    """
    if b"\n" not in data:
        data = data.replace(b"\r", b"\n")
    data = data.lower()
    ends = data.count(b"endsolid")
    text = _NAME.sub(b"", data).replace(b"normal", b"")  # normals are not read
    facets, corners = text.count(b"endfacet"), text.count(b"vertex")
    started = text.count(b"facet") - facets
    if not facets or not ends or started != facets or corners != 3 * facets:
        reason = f"{started:,} facets with {corners:,} corners, and {ends:,} ends"
        if started == corners == 0:
            reason = "it holds no triangles"
        raise source.error(f"cannot be read as STL: {reason}; {source.hint}")
    return b"solid\n" + text + b"\nendsolid\n", facets
