"""Checks of archives with meshes (3MF, 3DXML) and of XML, before they are unpacked.

Of a 3MF the meshes are counted as well: trimesh silently skips some nested parts.
"""

import re
import struct
import zipfile
import zlib
from dataclasses import dataclass, field
from typing import IO
from xml.parsers import expat

from grasp3d.reading.sources import Source, check_memory
from grasp3d.system.names import reason_of

MOST_ENTRIES = 10_000
MOST_RATIO = 100.0
"""Largest ratio of unpacked to packed size; the text of a mesh compresses about tenfold."""

MEMORY_UNPACKED = 12.0
"""Memory for reading, per byte of an unpacked archive."""

SMALL = 10_000_000
"""Unpacked size up to which the ratio is not checked [bytes]."""

_BLOCK = 1 << 16
_DAMAGE = (
    zipfile.BadZipFile,
    zlib.error,
    struct.error,
    ArithmeticError,
    EOFError,
    LookupError,
    MemoryError,
    OSError,
    RuntimeError,
    ValueError,
)
"""Errors that zipfile and expat raise for damaged archives and unknown encodings."""

MOST_PARTS = 10_000
"""Largest number of copies of all parts together."""


class _FirstElementError(Exception):
    """The first element of a document was reached: no declaration can follow."""


def check_archive(source: Source) -> int:
    """Reject an archive that is too large when unpacked, or whose XML declares entities.

    Returns:
        The unpacked size [bytes].

    Raises:
        MeshError: It is too large, declares entities, or is damaged.
    """
    try:
        with zipfile.ZipFile(source.path) as archive:
            entries = archive.infolist()
            unpacked = sum(entry.file_size for entry in entries)
            _check_size(source, entries, unpacked)
            for entry in entries:
                if entry.filename.lower().endswith((".model", ".xml", ".3dxml", ".3drep", ".rels")):
                    with archive.open(entry) as stream:
                        check_declarations(source, stream)
    except _DAMAGE as error:
        kind, reason = source.kind.upper(), reason_of(error)
        raise source.unexpected(f"cannot be read as {kind} ({reason})") from error
    return unpacked


def _check_size(source: Source, entries: list[zipfile.ZipInfo], unpacked: int) -> None:
    """Reject an archive that is too large, or compressed by methods with unbounded memory."""
    if {entry.compress_type for entry in entries} - {zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED}:
        raise source.damaged("its compression method is not supported")
    if len(entries) > MOST_ENTRIES:
        raise source.error(
            f"contains {len(entries):,} files, more than the limit of {MOST_ENTRIES:,}; "
            "is it an archive of a mesh?"
        )
    if unpacked > SMALL and unpacked > MOST_RATIO * source.size:
        raise source.damaged(
            f"unpacks from {source.size:,} to {unpacked:,} bytes, more than {MOST_RATIO:g} times "
            "its size"
        )
    check_memory(source, unpacked, MEMORY_UNPACKED)


def check_declarations(source: Source, stream: IO[bytes]) -> None:
    """Reject an XML document, in any encoding, that declares a document type or entities.

    Raises:
        MeshError: It declares one, or it is not valid XML up to its first element.
    """
    parser = expat.ParserCreate()

    def reject(*_: object) -> None:
        raise source.damaged("declares a document type or entities, which are not supported")

    def stop(*_: object) -> None:
        raise _FirstElementError

    parser.StartDoctypeDeclHandler = reject
    parser.StartElementHandler = stop
    try:
        while block := stream.read(_BLOCK):
            parser.Parse(block)
        parser.Parse(b"", True)  # noqa: FBT003
    except _FirstElementError:
        return
    except (expat.ExpatError, LookupError, ValueError) as error:
        raise source.unexpected(f"its XML cannot be read ({error})") from error


@dataclass
class _Part:
    meshes: int = 0
    components: list[str] = field(default_factory=list)


def count_parts(source: Source) -> int:
    """Return the number of copies of its meshes that a 3MF builds.

    Raises:
        MeshError: They are too many, nested in a cycle, or in files that are not read.
    """
    with zipfile.ZipFile(source.path) as archive:
        names = {name.lower(): name for name in reversed(archive.namelist())}
        models = [names[name] for name in names if "3d/3dmodel.model" in name]
        if len(models) != 1:
            raise source.unexpected(f"contains {len(models)} models, not one")
        parts, built, paths = _structure(archive.read(models[0]))
        _check_paths(source, archive, parts, paths)
    counts: dict[str, int] = {}

    def copies(name: str, above: tuple[str, ...] = ()) -> int:
        """Number of meshes of an object and its components."""
        part = parts.get(name)
        if part is None or name in above or bool(part.meshes) == bool(part.components):
            raise source.damaged(f"object {ascii(name)[:20]} is missing, empty, or contains itself")
        if name not in counts:
            inner = (copies(other, (*above, name)) for other in part.components)
            counts[name] = sum(inner) or 1
        return counts[name]

    count = sum(map(copies, built))
    if count > MOST_PARTS:
        raise source.error(
            f"contains {count:,} copies of its parts, more than the limit of "
            f"{MOST_PARTS:,}; export fewer"
        )
    return count


def _structure(text: bytes) -> tuple[dict[str, _Part], list[str], list[tuple[str, str]]]:
    """Return (objects by id, ids of built objects, files with the ids of the objects in them)."""
    parts, built, paths = dict[str, _Part](), list[str](), list[tuple[str, str]]()
    current = _Part()

    def start_element(name: str, attributes: dict[str, str]) -> None:
        nonlocal current
        kind = name.rpartition(":")[2]
        path = next((v for k, v in attributes.items() if k.endswith("path")), None)
        if path is not None and kind in {"component", "item"}:
            paths.append((path if kind == "component" else "", attributes["objectid"]))
        if kind == "object":
            current = parts.setdefault(attributes["id"], _Part())
        elif kind == "mesh":
            current.meshes += 1
        elif kind == "component":
            current.components.append(attributes["objectid"])
        elif kind == "item":
            built.append(attributes["objectid"])

    parser = expat.ParserCreate()
    parser.StartElementHandler = start_element
    # Vertices and triangles are most of the text and are not needed.
    head, *meshes = text.split(b"<mesh>")
    rest = (b"<mesh/>" + mesh.partition(b"</mesh>")[2] for mesh in meshes)
    parser.Parse(b"".join([head, *rest]), True)  # noqa: FBT003
    return parts, built, paths


def _check_paths(
    source: Source, archive: zipfile.ZipFile, parts: dict[str, _Part], paths: list[tuple[str, str]]
) -> None:
    """Add objects of other files; reject those that trimesh would confuse with others."""
    names = [name for name, _ in paths]
    for name, number in paths:
        try:
            text = archive.read(name.strip("/"))
        except KeyError:
            text = b""
        once = names.count(name) == 1 and number not in parts
        if not once or len(re.findall(rb"<(?:\w+:)?mesh[\s>]", text)) != 1 or b"component" in text:
            raise source.error(
                f"its objects are in several files, and {ascii(name)[:60]} does "
                "not contain exactly one that is used once; export it as one model, or as STL"
            )
        parts[number] = _Part(meshes=1)
