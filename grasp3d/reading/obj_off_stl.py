"""OBJ, OFF and STL: declared sizes, and reduction of text to what trimesh reads correctly."""

import re
from itertools import pairwise

from grasp3d.reading.sources import LONGEST_HEADER, Source, check_count, check_memory

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

MOST_CORNERS = 1000
"""Largest number of corners of a face; round lids have a few hundred."""

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


def plain_obj(source: Source, data: bytes) -> tuple[bytes, int, int]:
    """Return an OBJ with positions and faces only, so that trimesh keeps the order of vertices.

    With texture coordinates and normals trimesh would split and reorder vertices; with materials
    and groups it would split the mesh and open other files.

    Returns:
        (the OBJ, number of positions, number of faces).

    Raises:
        MeshError: A vertex has too few coordinates, or a face too few or too many corners, or no
            valid vertex number.
    """
    lines = re.sub(rb"\\\r?\n", b" ", data).splitlines()
    total, count = sum(line.split(None, 1)[:1] == [b"v"] for line in lines), 0
    plain: list[bytes] = []
    for number, line in enumerate(lines, 1):
        kind, *words = line.split() or [b""]
        if kind not in {b"v", b"f"}:
            continue
        count += kind == b"v"
        try:
            values = (
                _position(words) if kind == b"v" else [_absolute(w, count, total) for w in words]
            )
        except ValueError as error:
            text = line.decode("utf-8", "replace")[:40]
            raise source.damaged(f"line {number}, {text!r}, cannot be read ({error})") from error
        if kind == b"f" and not 3 <= len(words) <= MOST_CORNERS:
            raise source.error(
                f"line {number} is a face of {len(words):,} corners; 3 to {MOST_CORNERS:,} are "
                "allowed"
            )
        plain.append(b" ".join([kind, *values]))
    return b"\n".join(plain), count, len(plain) - count


def _position(words: list[bytes]) -> list[bytes]:
    """Return the three coordinates of a vertex, which colours may follow."""
    if len([float(word) for word in words[:3]]) < 3:
        raise ValueError("a vertex needs three coordinates")
    return words[:3]


def _absolute(corner: bytes, count: int, total: int) -> bytes:
    """Return the vertex number of a face's corner `v/vt/vn`, counted from the start of the file."""
    number = int(corner.split(b"/", 1)[0])
    absolute = number if number > 0 else count + 1 + number
    if number == 0 or absolute < 1:
        raise ValueError(f"a face uses vertex {number}")
    if absolute > total:
        raise ValueError(f"there are {total:,} vertices")
    return b"%d" % absolute


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
    rows: list[bytes] = []
    for number, line in enumerate(lines[start : start + faces]):
        words = line.split()
        count = int(words[0]) if words[0].isdigit() else 0
        if not 3 <= count < min(len(words), MOST_CORNERS + 1):
            text = line.decode("utf-8", "replace")[:40]
            raise source.damaged(
                f"face {number} ({text!r}) does not have the corners that it declares, of which 3 "
                f"to {MOST_CORNERS:,} are allowed"
            )
        if count <= 4:
            rows.append(line)
        else:
            first, *rest = words[1 : count + 1]
            rows += [b"3 %s %s %s" % (first, a, b) for a, b in pairwise(rest)]
    head = b"OFF\n%d %d 0" % (vertices, len(rows))
    return b"\n".join([head, *lines[:start], *rows])


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
        raise source.unexpected(f"cannot be read as STL: {reason}")
    return b"solid\n" + text + b"\nendsolid\n", facets
