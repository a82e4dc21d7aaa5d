"""Conversion of PLY files to a form that trimesh reads correctly: faces with equal corners."""

import re
import struct

import numpy as np

from grasp3d.arrays import Ints
from grasp3d.errors import MeshError
from grasp3d.reading.obj import MOST_CORNERS
from grasp3d.reading.ply import Element, PlyHeader
from grasp3d.reading.sources import Source


def plain_ply(source: Source, header: PlyHeader, data: bytes) -> bytes:
    """Return a PLY of which trimesh reads positions and faces only.

    Raises:
        MeshError: Its faces are not valid.
    """
    if not header.order:
        text = data[header.start :].replace(b"\r\n", b"\n").replace(b"\r", b"\n")
        text = re.sub(rb"\n[ \t]*(?=\n)", b"", b"\n" + text)[1:]
        _check_lines(source, header, text)
        return header.plain() + text
    if _has_equal_records(header, data):
        return header.plain() + data[header.start :]
    return _with_triangles(source, header, data)


def _check_lines(source: Source, header: PlyHeader, text: bytes) -> None:
    """Reject lines with more or fewer numbers than their element declares."""
    lines, start = text.split(b"\n"), 0
    for element in header.elements:
        rows = lines[start : start + element.count]
        start += element.count
        if element.name not in {"vertex", "face"}:
            continue
        lists = [i for i, entry in enumerate(element.properties) if entry.length]
        for number, line in enumerate(rows):
            if not _is_complete(line.split(), len(element.properties), lists):
                raise MeshError(
                    f"{source.where}: {element.name} {number} "
                    f"({line[:40].decode('utf-8', 'replace')!r}) has a wrong number of numbers; "
                    "export the mesh again"
                )


def _is_complete(words: list[bytes], properties: int, lists: list[int]) -> bool:
    """Return whether a line has the numbers of its properties, some of which are lists."""
    more = 0
    try:
        for index in lists:
            more += int(words[index + more])
    except (ValueError, IndexError):
        return False
    return properties + more == len(words)


def _has_equal_records(header: PlyHeader, data: bytes) -> bool:
    """Return whether all lists of each binary element are as long as in its first record.

    trimesh assumes this if the file size matches.
    """
    start = header.start
    for element in header.elements:
        if not element.count:
            continue
        dtype = _first_record(header.order, element, data, start)
        if dtype is None or start + element.count * dtype.itemsize > len(data):
            return False
        rows = np.frombuffer(data, dtype, element.count, start)
        for name in dtype.names or ():
            if name.startswith("length") and (rows[name] != rows[name][0]).any():
                return False
        start += element.count * dtype.itemsize
    return start == len(data)


def _first_record(
    order: str, element: Element, data: bytes, start: int
) -> np.dtype[np.void] | None:
    """Return the layout of an element's first record; None: the file ends before."""
    fields: list[tuple[str, str, int]] = []
    for number, entry in enumerate(element.properties):
        count = 1
        if entry.length is not None:
            length = np.dtype(order + entry.length)
            if start + length.itemsize > len(data):
                return None
            count = int(np.frombuffer(data, length, 1, start)[0])
            fields.append((f"length{number}", length.str, 1))
            start += length.itemsize
        if not 0 <= count <= len(data):
            return None
        fields.append((f"value{number}", order + entry.type, count))
        start += count * int(entry.type[1])
    return np.dtype([(name, kind, (count,)) for name, kind, count in fields])


def _with_triangles(source: Source, header: PlyHeader, data: bytes) -> bytes:
    """Return a binary PLY with its positions, and its faces as triangle fans."""
    start, parts = header.start, list[bytes]()
    lines = [
        b"ply",
        b"format binary_%s_endian 1.0" % (b"little" if header.order == "<" else b"big"),
    ]
    for element in header.elements:
        if element.name == "face":
            faces = _fans(*_corners(source, header.order, element, data, start))
            break
        if element.lists:
            raise MeshError(
                f"{source.where}: has lists of differing lengths before its faces; export the "
                "mesh again, as triangles"
            )
        lines += [line.encode("utf-8", "replace") for line in element.lines()]
        parts.append(data[start : start + element.count * element.min_bytes])
        start += element.count * element.min_bytes
    lines += [
        b"element face %d" % len(faces),
        b"property list uchar int64 vertex_indices",
        b"end_header\n",
    ]
    rows = np.zeros(len(faces), dtype=[("n", "u1"), ("corners", f"{header.order}i8", 3)])
    rows["n"], rows["corners"] = 3, faces
    return b"\n".join(lines) + b"".join(parts) + rows.tobytes()


def _corners(
    source: Source, order: str, element: Element, data: bytes, start: int
) -> tuple[Ints, Ints]:
    """Return (number of corners of each face, vertex numbers of all corners)."""
    if element.lists != 1:
        raise MeshError(
            f"{source.where}: its faces have {element.lists} lists of differing lengths, one is "
            "allowed; export the mesh again, as triangles"
        )
    index = next(i for i, entry in enumerate(element.properties) if entry.length)
    entry = element.properties[index]
    before = sum(other.min_bytes for other in element.properties[:index])
    after = sum(other.min_bytes for other in element.properties[index + 1 :])
    length = struct.Struct(order + np.dtype(entry.length).char)
    size = int(entry.type[1])
    counts, rows = [], []
    for face in range(element.count):
        first = start + before + length.size
        count = length.unpack_from(data, first - length.size)[0] if first <= len(data) else 0
        start = first + count * size + after
        if start > len(data) or first > len(data):
            raise MeshError(
                f"{source.where}: declares {element.count:,} faces, but contains {face:,}; is "
                "the file complete?"
            )
        if not 3 <= count <= MOST_CORNERS:
            raise MeshError(
                f"{source.where}: face {face} has {count} corners; 3 to {MOST_CORNERS:,} are "
                "allowed"
            )
        counts.append(count)
        rows.append(data[first : first + count * size])
    found = np.frombuffer(b"".join(rows), dtype=order + entry.type).astype(np.int64)
    return np.array(counts, dtype=np.int64), found


def _fans(counts: Ints, corners: Ints) -> Ints:
    """Divide polygons into triangles that share the first corner, shape (F, 3)."""
    first = np.repeat(np.cumsum(counts) - counts, counts - 2)
    step = np.arange(len(first)) - np.repeat(np.cumsum(counts - 2) - (counts - 2), counts - 2)
    fans: Ints = corners[np.stack([first, first + step + 1, first + step + 2], axis=1)]
    return fans
