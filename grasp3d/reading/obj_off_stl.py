"""OBJ, OFF and STL: their declared sizes, vertices and faces."""

import re
from array import array

import numpy as np

from grasp3d.arrays import Floats, Ints, first_at_position
from grasp3d.reading.sources import (
    LONGEST_HEADER,
    MOST_CORNERS,
    Source,
    as_triangles,
    check_count,
    check_memory,
)

MEMORY_PER_BYTE = {"stl": 16.0, "ply": 24.0, "obj": 12.0, "off": 24.0, "glb": 12.0, "gltf": 12.0}
"""Memory for reading, per byte of the file, measured on 300,000 faces; text needs most."""

STL_HEADER, STL_FACE = 84, 50


OFF_HEADER = re.compile(
    rb"(?:\xef\xbb\xbf)?\s*(?:(?:ST)?C?N?OFF|off)\s+(?P<vertices>-?\d+)\s+(?P<faces>-?\d+)"
    rb"(?:[ \t]+-?\d[^\r\n]*|\s+\d+[ \t]*(?=[\r\n]))?(?=\s|$)"
)
"""Header of a text OFF without comments: the counts on one line or on several. The third, of edges,
is often left out; alone on a line it cannot be a vertex."""

_OTHER_OFF = re.compile(rb"\s*(?:(?:ST)?C?N?(?:4n?|n)OFF|(?:ST)?C?N?OFF\s+BINARY)\b")
"""Headers of the kinds of OFF that are not read."""

_NAME = re.compile(rb"solid[^\n]*")


def without_comments(text: bytes) -> bytes:
    """Return the text of an OFF without its comments, which end with their line."""
    return re.sub(rb"#[^\r\n]*", b"", text) if b"#" in text else text


def check_declared_size(source: Source) -> None:
    """Check the declared size of a mesh against the file size and the memory limit.

    Raises:
        MeshError: The file is too small for it, or reading needs more memory than is allowed.
    """
    check_memory(source, source.size, MEMORY_PER_BYTE.get(source.kind, 1.0))
    if source.kind == "off":
        off_counts(source)
    faces = binary_stl_faces(source) if source.kind == "stl" else None
    available = (source.size - STL_HEADER) // STL_FACE
    if faces is not None and faces > available:
        raise source.incomplete(f"declares {faces:,} faces, but contains {available:,}")


def binary_stl_faces(source: Source) -> int | None:
    """Return the number of faces that a binary STL declares; None: it is text, or not an STL."""
    head = source.head(STL_HEADER)
    if len(head) < STL_HEADER:
        return None
    faces = int.from_bytes(head[80:], "little")
    if source.size >= STL_HEADER + STL_FACE * faces and faces:
        return faces
    # Text begins with `solid`, but binary headers may do so as well.
    text = head.lstrip()[:5].lower() == b"solid" and b"facet" in source.head().lower()
    control_characters = any(byte < 9 or 13 < byte < 32 for byte in head)
    return None if text or not control_characters else faces


def off_counts(source: Source) -> tuple[int, int]:
    """Return the numbers of vertices and faces that an OFF declares, checked against its size.

    Raises:
        MeshError: It is not an OFF, or declares more than it can contain.
    """
    for size in (LONGEST_HEADER, source.size):  # a comment may be longer than a header
        head = without_comments(source.head(size))
        if match := OFF_HEADER.match(head):
            break
    if match is None:
        if kind := _OTHER_OFF.match(head):
            name = kind[0].strip().decode("ascii")
            raise source.error(
                f"is of the kind {name!r}; of OFF only text with vertices of three "
                "coordinates is read: export it so, or as STL"
            )
        raise source.unexpected("cannot be read as OFF: no counts")
    vertices, faces = int(match["vertices"][:18]), int(match["faces"][:18])
    check_count(source, "vertices", vertices, len("0 0 0\n"), source.size)
    check_count(source, "faces", faces, len("3 0 1 2\n"), source.size)
    return vertices, faces


def read_obj(source: Source) -> tuple[Floats, Ints]:
    """Read the vertices (V, 3) and faces (F, 3) of an OBJ, of all its parts together.

    Raises:
        MeshError: A vertex has too few coordinates, or a face too few or too many corners, or no
            valid vertex number.
    """
    lines = re.sub(rb"\\\r?\n", b" ", source.path.read_bytes()).splitlines()
    total = sum(line.split(None, 1)[:1] == [b"v"] for line in lines)
    positions, corners, counts = array("d"), array("q"), array("q")
    for number, line in enumerate(lines, 1):
        kind, *words = line.split() or [b""]
        try:
            if kind == b"v":
                positions.extend(_position(words))
            elif kind == b"f":
                count = len(positions) // 3
                corners.extend([_vertex(word, count, total) for word in words])
                counts.append(len(words))
        except ValueError as error:
            text = line.decode("utf-8", "replace")[:40]
            raise source.damaged(f"line {number}, {text!r}, cannot be read ({error})") from error
    return _surface(source, positions, corners, counts)


def _surface(
    source: Source, positions: "array[float]", corners: "array[int]", counts: "array[int]"
) -> tuple[Floats, Ints]:
    """Vertices (V, 3) of their coordinates, and triangles (F, 3) of polygons."""
    faces = as_triangles(source, np.array(corners, np.int64), np.array(counts, np.int64))
    return np.array(positions, np.float64).reshape(-1, 3), faces


def _position(words: list[bytes]) -> list[float]:
    """The three coordinates of a vertex, which colours may follow."""
    position = [float(word) for word in words[:3]]
    if len(position) < 3:
        raise ValueError("a vertex needs three coordinates")
    return position


def _vertex(corner: bytes, count: int, total: int) -> int:
    """The vertex of a face's corner `v/vt/vn`, of which numbers below 0 count backwards."""
    number = int(corner.split(b"/", 1)[0])
    absolute = number if number > 0 else count + 1 + number
    if number == 0 or absolute < 1:
        raise ValueError(f"a face uses vertex {number}")
    if absolute > total:
        raise ValueError(f"there are {total:,} vertices")
    return absolute - 1


def read_off(source: Source) -> tuple[Floats, Ints]:
    """Read the vertices (V, 3) and faces (F, 3) of an OFF.

    Raises:
        MeshError: It is incomplete, or a face has fewer corners than it declares.
    """
    vertices, faces = off_counts(source)
    data = without_comments(source.path.read_bytes())
    header = OFF_HEADER.match(data)
    lines = [line for line in data[header.end() if header else 0 :].splitlines() if line.strip()]
    if len(lines) < vertices + faces:
        raise source.incomplete(
            f"declares {vertices:,} vertices and {faces:,} faces, but contains {len(lines):,} lines"
        )
    positions, corners, counts = array("d"), array("q"), array("q")
    try:
        for line in lines[:vertices]:
            positions.extend(_position(line.split()))
    except ValueError as error:
        raise source.damaged(f"a vertex cannot be read ({error})") from error
    for number, line in enumerate(lines[vertices : vertices + faces]):
        words = line.split()
        count = int(words[0]) if words[0].isdigit() else 0
        try:
            corners.extend([int(word) for word in words[1 : count + 1]])
        except (ValueError, OverflowError):
            count = 0
        if not 3 <= count < min(len(words), MOST_CORNERS + 1):
            text = line.decode("utf-8", "replace")[:40]
            raise source.damaged(
                f"face {number} ({text!r}) does not have the corners that it declares, of which 3 "
                f"to {MOST_CORNERS:,} are allowed"
            )
        counts.append(count)
    return _surface(source, positions, corners, counts)


def read_stl(source: Source) -> tuple[Floats, Ints]:
    """Read the vertices (V, 3), each position once, and the faces (F, 3) of an STL.

    Raises:
        MeshError: It is incomplete.
    """
    data, faces = source.path.read_bytes(), binary_stl_faces(source)
    if faces is None:
        corners = _text_corners(source, data)
    else:
        rows = np.frombuffer(data, "V12, (9,)<f4, V2", faces, STL_HEADER)["f1"]
        corners = rows.reshape(-1, 3).astype(np.float64)
    first, numbers = np.unique(first_at_position(corners), return_inverse=True)
    return corners[first], numbers.reshape(-1, 3)


def _text_corners(source: Source, data: bytes) -> Floats:
    """Corners of the facets of all solids of a text STL, whose names may be any, shape (3 F, 3)."""
    if b"\n" not in data:
        data = data.replace(b"\r", b"\n")
    data = data.lower()
    ends = data.count(b"endsolid")
    text = _NAME.sub(b"", data)
    facets, corners = text.count(b"endfacet"), text.count(b"vertex")
    started = text.count(b"facet") - facets
    if not facets or not ends or started != facets or corners != 3 * facets:
        reason = f"{started:,} facets with {corners:,} corners, and {ends:,} ends"
        if started == corners == 0:
            reason = "it holds no triangles"
        raise source.unexpected(f"cannot be read as STL: {reason}")
    try:
        return np.array([_position(part.split(None, 3)) for part in text.split(b"vertex")[1:]])
    except ValueError as error:
        raise source.damaged(f"a vertex cannot be read ({error})") from error
