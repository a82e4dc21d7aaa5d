"""Archives that hold meshes (3MF, 3DXML) and XML: checked before anything is unpacked."""

import struct
import zipfile
import zlib
from typing import IO
from xml.parsers import expat

from grasp3d.errors import MeshError
from grasp3d.reading.promises import MEMORY_UNPACKED, check_memory
from grasp3d.reading.sources import Source

MOST_ENTRIES = 10_000
MOST_RATIO = 100.0
"""How much larger an archive may be unpacked; the text of an honest mesh shrinks about tenfold."""

SMALL = 10_000_000
"""Bytes unpacked up to which the ratio does not matter."""

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
"""What damaged archives, and encodings that are none, make their readers raise."""


class _BegunError(Exception):
    """The first element of a document has begun: no declaration can follow."""


def check_archive(source: Source) -> int:
    """Refuse an archive that unpacks to more than an honest one, or declares entities.

    Returns:
        Bytes that it unpacks to.

    Raises:
        MeshError: It does, or it is damaged.
    """
    try:
        with zipfile.ZipFile(source.path) as archive:
            entries = archive.infolist()
            unpacked = sum(entry.file_size for entry in entries)
            _check_packing(source, entries)
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


def _check_packing(source: Source, entries: list[zipfile.ZipInfo]) -> None:
    """Refuse ways of packing that take memory at will; meshes are stored or deflated."""
    for entry in entries:
        if entry.compress_type not in {zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED}:
            raise MeshError(
                f"{source.where}: is packed in a way that is not read; export the mesh again"
            )


def _check_size(source: Source, entries: int, unpacked: int) -> None:
    if entries > MOST_ENTRIES:
        raise MeshError(
            f"{source.where}: holds {entries:,} files, more than the {MOST_ENTRIES:,} that are "
            "read; is it an archive of something else?"
        )
    if unpacked > SMALL and unpacked > MOST_RATIO * source.size:
        raise MeshError(
            f"{source.where}: unpacks from {source.size:,} to {unpacked:,} bytes, more than "
            f"{MOST_RATIO:g} times its size, as no honest mesh does; export the mesh again"
        )
    check_memory(source, unpacked, MEMORY_UNPACKED)


def check_declarations(source: Source, stream: IO[bytes]) -> None:
    """Refuse a document that declares a type or entities, in any encoding; no mesh needs them.

    Raises:
        MeshError: It does, or is no XML up to its first element.
    """
    parser = expat.ParserCreate()

    def declared(*_: object) -> None:
        raise MeshError(
            f"{source.where}: declares a document type or entities, which are not read; export "
            "the mesh again"
        )

    def begun(*_: object) -> None:
        raise _BegunError

    parser.StartDoctypeDeclHandler = declared
    parser.StartElementHandler = begun
    try:
        while block := stream.read(_BLOCK):
            parser.Parse(block)
        parser.Parse(b"", True)  # noqa: FBT003
    except _BegunError:
        return
    except (expat.ExpatError, LookupError, ValueError) as error:
        raise MeshError(
            f"{source.where}: its XML cannot be read ({error}); {source.hint}"
        ) from error
