"""Faces of a PLY with differing numbers of corners, which trimesh reads wrongly or not at all."""

import re
import struct

import numpy as np

from grasp3d.arrays import Ints
from grasp3d.errors import MeshError
from grasp3d.reading.obj import MOST_CORNERS
from grasp3d.reading.ply import Element, PlyHeader
from grasp3d.reading.sources import Source


def plain_ply(source: Source, header: PlyHeader, data: bytes) -> bytes:
    """Write a PLY again so that trimesh reads its positions and faces, and nothing else.

    Raises:
        MeshError: Its faces make no sense.
    """
    if not header.order:
        text = data[header.start :].replace(b"\r\n", b"\n").replace(b"\r", b"\n")
        text = re.sub(rb"\n[ \t]*(?=\n)", b"", b"\n" + text)[1:]
        _check_lines(source, header, text)
        return header.plain() + text
    if _are_alike(header, data):
        return header.plain() + data[header.start :]
    return _with_triangles(source, header, data)


def _check_lines(source: Source, header: PlyHeader, text: bytes) -> None:
    """Refuse lines with more or fewer numbers than their element promises."""
    lines, at = text.split(b"\n"), 0
    for element in header.elements:
        rows = lines[at : at + element.count]
        at += element.count
        if element.name not in {"vertex", "face"}:
            continue
        lists = [i for i, entry in enumerate(element.properties) if entry.length]
        for number, line in enumerate(rows):
            if not _is_right(line.split(), len(element.properties), lists):
                raise MeshError(
                    f"{source.where}: {element.name} {number} "
                    f"({line[:40].decode('utf-8', 'replace')!r}) has not the numbers that it "
                    "promises; export the mesh again"
                )


def _is_right(words: list[bytes], properties: int, lists: list[int]) -> bool:
    """Tell whether a line has as many numbers as its properties, some of which are lists."""
    more = 0
    try:
        for place in lists:
            more += int(words[place + more])
    except (ValueError, IndexError):
        return False
    return properties + more == len(words)


def _are_alike(header: PlyHeader, data: bytes) -> bool:
    """Tell whether the lists of each binary element are all as long as in its first record.

    trimesh takes that for granted as long as the size of the file fits.
    """
    at = header.start
    for element in header.elements:
        if not element.count:
            continue
        dtype = _first_record(header.order, element, data, at)
        if dtype is None or at + element.count * dtype.itemsize > len(data):
            return False
        rows = np.frombuffer(data, dtype, element.count, at)
        for name in dtype.names or ():
            if name.startswith("length") and (rows[name] != rows[name][0]).any():
                return False
        at += element.count * dtype.itemsize
    return at == len(data)


def _first_record(order: str, element: Element, data: bytes, at: int) -> np.dtype[np.void] | None:
    """Layout of an element's first record; None: the file ends before."""
    fields: list[tuple[str, str, int]] = []
    for number, entry in enumerate(element.properties):
        count = 1
        if entry.length is not None:
            length = np.dtype(order + entry.length)
            if at + length.itemsize > len(data):
                return None
            count = int(np.frombuffer(data, length, 1, at)[0])
            fields.append((f"length{number}", length.str, 1))
            at += length.itemsize
        if not 0 <= count <= len(data):
            return None
        fields.append((f"value{number}", order + entry.type, count))
        at += count * int(entry.type[1])
    return np.dtype([(name, kind, (count,)) for name, kind, count in fields])


def _with_triangles(source: Source, header: PlyHeader, data: bytes) -> bytes:
    """Write a binary PLY again with its positions, and its faces as fans of triangles."""
    at, parts = header.start, list[bytes]()
    lines = [
        b"ply",
        b"format binary_%s_endian 1.0" % (b"little" if header.order == "<" else b"big"),
    ]
    for element in header.elements:
        if element.name == "face":
            faces = _fans(*_corners(source, header.order, element, data, at))
            break
        if element.lists:
            raise MeshError(
                f"{source.where}: has lists of differing lengths before its faces; export the "
                "mesh again, as triangles"
            )
        lines += [line.encode("utf-8", "replace") for line in element.lines()]
        parts.append(data[at : at + element.count * element.least])
        at += element.count * element.least
    lines += [
        b"element face %d" % len(faces),
        b"property list uchar int64 vertex_indices",
        b"end_header\n",
    ]
    rows = np.zeros(len(faces), dtype=[("n", "u1"), ("corners", f"{header.order}i8", 3)])
    rows["n"], rows["corners"] = 3, faces
    return b"\n".join(lines) + b"".join(parts) + rows.tobytes()


def _corners(
    source: Source, order: str, element: Element, data: bytes, at: int
) -> tuple[Ints, Ints]:
    """(corners of each face, vertices at all of them), going from face to face."""
    if element.lists != 1:
        raise MeshError(
            f"{source.where}: its faces have {element.lists} lists of differing lengths, one is "
            "read; export the mesh again, as triangles"
        )
    place = next(i for i, entry in enumerate(element.properties) if entry.length)
    entry = element.properties[place]
    before = sum(other.least for other in element.properties[:place])
    after = sum(other.least for other in element.properties[place + 1 :])
    length = struct.Struct(order + np.dtype(entry.length).char)
    size = int(entry.type[1])
    counts, rows = [], []
    for face in range(element.count):
        begin = at + before + length.size
        count = length.unpack_from(data, begin - length.size)[0] if begin <= len(data) else 0
        at = begin + count * size + after
        if at > len(data) or begin > len(data):
            raise MeshError(
                f"{source.where}: promises {element.count:,} faces, but {face:,} are there; is "
                "the file complete?"
            )
        if not 3 <= count <= MOST_CORNERS:
            raise MeshError(
                f"{source.where}: face {face} has {count} corners; 3 to {MOST_CORNERS:,} are read"
            )
        counts.append(count)
        rows.append(data[begin : begin + count * size])
    found = np.frombuffer(b"".join(rows), dtype=order + entry.type).astype(np.int64)
    return np.array(counts, dtype=np.int64), found


def _fans(counts: Ints, corners: Ints) -> Ints:
    """Cut polygons into triangles that share their first corner, shape (F, 3)."""
    first = np.repeat(np.cumsum(counts) - counts, counts - 2)
    step = np.arange(len(first)) - np.repeat(np.cumsum(counts - 2) - (counts - 2), counts - 2)
    fans: Ints = corners[np.stack([first, first + step + 1, first + step + 2], axis=1)]
    return fans
