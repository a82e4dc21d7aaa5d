"""What a file promises, checked against its size before memory is taken for it."""

import re

from grasp3d.errors import MeshError
from grasp3d.reading.sources import Source

MEMORY_PER_BYTE = {"stl": 16.0, "ply": 24.0, "obj": 12.0, "off": 24.0, "glb": 12.0, "gltf": 12.0}
"""Memory that reading takes per byte of a file, measured on 300,000 faces; text takes most."""

MEMORY_UNPACKED = 12.0
"""The same per byte of an unpacked archive."""

STL_HEADER, STL_FACE = 84, 50
LONGEST_HEADER = 65_536


def check_memory(source: Source, size: int, per_byte: float) -> None:
    """Refuse a file that would need more memory to read than is allowed.

    Args:
        source: The file.
        size: Bytes to be read.
        per_byte: What each takes.

    Raises:
        MeshError: It would.
    """
    needed = per_byte * size / 1e9
    if needed > source.max_memory:
        raise MeshError(
            f"{source.where}: reading {size:,} bytes of {source.kind.upper()} takes about "
            f"{needed:.3g} GB of memory, and max_memory is {source.max_memory:g} GB; simplify the "
            "mesh, or raise max_memory (--max-memory)"
        )


def check_room(source: Source, what: str, promised: int, least: int, there: int) -> None:
    """Refuse a header that promises more than the bytes behind it can hold.

    Args:
        source: The file.
        what: What is promised, in the plural.
        promised: How many of them.
        least: Bytes that one takes at least.
        there: Bytes that are there for them.

    Raises:
        MeshError: It does, or promises less than nothing.
    """
    if promised < 0 or promised * least > there:
        raise MeshError(
            f"{source.where}: promises {promised:,} {what}, but holds {there:,} bytes for them; "
            "is the file complete?"
        )


def check_promises(source: Source) -> None:
    """Compare what the header of a file promises with the file's size.

    Raises:
        MeshError: It promises more than is there, or needs more memory than is allowed.
    """
    check_memory(source, source.size, MEMORY_PER_BYTE.get(source.kind, 1.0))
    if source.kind == "off":
        off_counts(source)
    if source.kind == "stl":
        _check_stl(source)


def binary_stl_faces(source: Source) -> int | None:
    """How many faces a binary STL promises; None: it is text, or nothing of the kind."""
    head = source.head(STL_HEADER)
    if len(head) < STL_HEADER:
        return None
    faces = int.from_bytes(head[80:], "little")
    if source.size >= STL_HEADER + STL_FACE * faces and faces:
        return faces
    # Text is told by its first word, but binary headers may begin with it as well.
    text = head.lstrip()[:5].lower() == b"solid" and b"facet" in source.head().lower()
    return None if text or not _binary(head) else faces


def _binary(head: bytes) -> bool:
    """Tell binary data from prose: a header of text, but bytes that are no text after it."""
    return any(byte < 9 or 13 < byte < 32 for byte in head)


def _check_stl(source: Source) -> None:
    faces = binary_stl_faces(source)
    if faces is None:
        return
    there = (source.size - STL_HEADER) // STL_FACE
    if faces > there:
        raise MeshError(
            f"{source.where}: promises {faces:,} faces, but {there:,} are there; is the file "
            "complete?"
        )


def off_counts(source: Source) -> tuple[int, int]:
    """How many vertices and faces an OFF promises; each takes a line of at least three numbers.

    Raises:
        MeshError: It is none, or promises more than its size can hold.
    """
    head = re.sub(rb"#[^\r\n]*", b"", source.head(LONGEST_HEADER))
    found = re.match(rb"\s*(?:ST)?C?N?OFF\s+(-?\d+)\s+(-?\d+)", head)
    if found is None:
        raise MeshError(f"{source.where}: cannot be read as OFF: no counts; {source.hint}")
    vertices, faces = int(found[1][:18]), int(found[2][:18])
    check_room(source, "vertices", vertices, len("0 0 0\n"), source.size)
    check_room(source, "faces", faces, len("3 0 1 2\n"), source.size)
    return vertices, faces
