"""Checks of archives with meshes (3MF, 3DXML) and of XML, before they are unpacked."""

import struct
import zipfile
import zlib
from typing import IO
from xml.parsers import expat

from grasp3d.errors import MeshError
from grasp3d.reading.declared_sizes import MEMORY_UNPACKED, check_memory
from grasp3d.reading.sources import Source

MOST_ENTRIES = 10_000
MOST_RATIO = 100.0
"""Largest ratio of unpacked to packed size; the text of a mesh compresses about tenfold."""

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
            _check_compression(source, entries)
            _check_size(source, len(entries), unpacked)
            for entry in entries:
                if entry.filename.lower().endswith((".model", ".xml", ".3dxml", ".3drep", ".rels")):
                    with archive.open(entry) as stream:
                        check_declarations(source, stream)
    except _DAMAGE as error:
        reason = " ".join(str(error).split())
        raise MeshError(
            f"{source.where}: cannot be read as {source.kind.upper()} ({reason}); {source.hint}"
        ) from error
    return unpacked


def _check_compression(source: Source, entries: list[zipfile.ZipInfo]) -> None:
    """Reject compression methods with unbounded memory; meshes are stored or deflated."""
    for entry in entries:
        if entry.compress_type not in {zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED}:
            raise MeshError(
                f"{source.where}: its compression method is not supported; export the mesh again"
            )


def _check_size(source: Source, entries: int, unpacked: int) -> None:
    if entries > MOST_ENTRIES:
        raise MeshError(
            f"{source.where}: contains {entries:,} files, more than the limit of {MOST_ENTRIES:,}; "
            "is it an archive of a mesh?"
        )
    if unpacked > SMALL and unpacked > MOST_RATIO * source.size:
        raise MeshError(
            f"{source.where}: unpacks from {source.size:,} to {unpacked:,} bytes, more than "
            f"{MOST_RATIO:g} times its size; export the mesh again"
        )
    check_memory(source, unpacked, MEMORY_UNPACKED)


def check_declarations(source: Source, stream: IO[bytes]) -> None:
    """Reject an XML document, in any encoding, that declares a document type or entities.

    Raises:
        MeshError: It declares one, or it is not valid XML up to its first element.
    """
    parser = expat.ParserCreate()

    def reject(*_: object) -> None:
        raise MeshError(
            f"{source.where}: declares a document type or entities, which are not supported; "
            "export the mesh again"
        )

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
        raise MeshError(
            f"{source.where}: its XML cannot be read ({error}); {source.hint}"
        ) from error
