"""Checks of declared counts and expected memory against the file size, before reading."""

import re

from grasp3d.reading.sources import Source

MEMORY_PER_BYTE = {"stl": 16.0, "ply": 24.0, "obj": 12.0, "off": 24.0, "glb": 12.0, "gltf": 12.0}
"""Memory for reading, per byte of the file, measured on 300,000 faces; text needs most."""

MEMORY_UNPACKED = 12.0
"""Memory for reading, per byte of an unpacked archive."""

STL_HEADER, STL_FACE = 84, 50
LONGEST_HEADER = 65_536


OFF_HEADER = re.compile(
    rb"(?:\xef\xbb\xbf)?\s*(?:(?:ST)?C?N?OFF|off)\s+(?P<vertices>-?\d+)\s+(?P<faces>-?\d+)"
    rb"(?:[ \t]+-?\d[^\r\n]*|\s+\d+[ \t]*(?=[\r\n]))?(?=\s|$)"
)
"""Header of a text OFF without comments: the counts on one line or on several. The third, of edges,
is often left out; alone on a line it cannot be a vertex."""

_OTHER_OFF = re.compile(rb"\s*(?:(?:ST)?C?N?(?:4n?|n)OFF|(?:ST)?C?N?OFF\s+BINARY)\b")
"""Headers of the kinds of OFF that are not read."""


def without_comments(text: bytes) -> bytes:
    """Return the text of an OFF without its comments, which end with their line."""
    return re.sub(rb"#[^\r\n]*", b"", text) if b"#" in text else text


def check_memory(source: Source, size: int, per_byte: float) -> None:
    """Reject a file that needs more memory to read than is allowed.

    Args:
        source: The file.
        size: Bytes to read.
        per_byte: Memory per byte.

    Raises:
        MeshError: It needs more.
    """
    needed = per_byte * size / 1e9
    if needed > source.max_memory:
        raise source.error(
            f"reading {size:,} bytes of {source.kind.upper()} takes about "
            f"{needed:.3g} GB of memory, and max_memory is {source.max_memory:g} GB; simplify the "
            "mesh, or raise max_memory (--max-memory)"
        )


def check_count(source: Source, what: str, count: int, min_bytes: int, available: int) -> None:
    """Reject a header that declares more items than the file can contain.

    Args:
        source: The file.
        what: Name of the items, in the plural.
        count: Declared number of items.
        min_bytes: Least size of an item [bytes].
        available: Bytes of the file for all items.

    Raises:
        MeshError: It declares too many, or a negative number.
    """
    if count < 0 or count * min_bytes > available:
        raise source.error(
            f"declares {count:,} {what}, but has {available:,} bytes for them; "
            "is the file complete?"
        )


def check_declared_size(source: Source) -> None:
    """Check the declared size of a mesh against the file size and the memory limit.

    Raises:
        MeshError: The file is too small for it, or reading needs more memory than is allowed.
    """
    check_memory(source, source.size, MEMORY_PER_BYTE.get(source.kind, 1.0))
    if source.kind == "off":
        off_counts(source)
    if source.kind == "stl":
        _check_stl(source)


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
    return None if text or not _is_binary(head) else faces


def _is_binary(head: bytes) -> bool:
    """Return whether bytes contain control characters, which text does not."""
    return any(byte < 9 or 13 < byte < 32 for byte in head)


def _check_stl(source: Source) -> None:
    faces = binary_stl_faces(source)
    if faces is None:
        return
    available = (source.size - STL_HEADER) // STL_FACE
    if faces > available:
        raise source.error(
            f"declares {faces:,} faces, but contains {available:,}; is the file complete?"
        )


def off_counts(source: Source) -> tuple[int, int]:
    """Return the numbers of vertices and faces that an OFF declares, checked against its size.

    Raises:
        MeshError: It is not an OFF, or declares more than it can contain.
    """
    for size in (LONGEST_HEADER, source.size):  # a comment may be longer than a header
        head = without_comments(source.head(size))
        if found := OFF_HEADER.match(head):
            break
    if found is None:
        if kind := _OTHER_OFF.match(head):
            name = kind[0].strip().decode("ascii")
            raise source.error(
                f"is of the kind {name!r}; of OFF only text with vertices of three "
                "coordinates is read: export it so, or as STL"
            )
        raise source.error(f"cannot be read as OFF: no counts; {source.hint}")
    vertices, faces = int(found["vertices"][:18]), int(found["faces"][:18])
    check_count(source, "vertices", vertices, len("0 0 0\n"), source.size)
    check_count(source, "faces", faces, len("3 0 1 2\n"), source.size)
    return vertices, faces
