"""PLY files: their headers, checked against the file size, and reduction to the surface.

The reduced file is one that trimesh reads correctly: positions, and faces with equal corners.
"""

import re
import struct
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from itertools import chain
from typing import Any

import numpy as np
import numpy.typing as npt

from grasp3d.arrays import Ints
from grasp3d.reading.obj_off_stl import MOST_CORNERS
from grasp3d.reading.sources import LONGEST_HEADER, Source, check_count

_TYPES = {
    "char": "i1", "uchar": "u1", "int8": "i1", "uint8": "u1", "short": "i2", "ushort": "u2",
    "int16": "i2", "uint16": "u2", "int": "i4", "uint": "u4", "int32": "i4", "uint32": "u4",
    "int64": "i8", "uint64": "u8", "float": "f4", "double": "f8", "float32": "f4", "float64": "f8",
}  # fmt: skip
_LENGTHS = ("i1", "u1", "i2", "u2", "i4", "u4")
_FORMATS = {"": "ascii", "<": "binary_little_endian", ">": "binary_big_endian"}
_CORNERS = ("vertex_indices", "vertex_index")
_MIN_TEXT_BYTES = 2
"""Least size of a number and its separator in a text file [bytes]."""


@dataclass(frozen=True)
class Property:
    """A number, or a list of numbers, of each record of an element."""

    name: str
    type_words: tuple[str, ...]
    """The type as the header writes it."""
    type: str
    """NumPy type of one number, without byte order."""
    length: str | None
    """NumPy type of a list's length; None: a single number."""

    @property
    def min_bytes(self) -> int:
        """Least size in a binary file [bytes]."""
        return int((self.length or self.type)[1])


@dataclass(frozen=True)
class Element:
    """An element of the file: a table of records."""

    name: str
    count: int
    properties: list[Property] = field(default_factory=list)

    @property
    def min_bytes(self) -> int:
        """Least size of a record in a binary file [bytes]; exact if there are no lists."""
        return sum(entry.min_bytes for entry in self.properties)

    @property
    def lists(self) -> int:
        """Number of properties that are lists."""
        return sum(entry.length is not None for entry in self.properties)

    def lines(self) -> list[str]:
        """Return the header lines of the element, with neutral names for what is not read."""
        names = {"vertex": ("x", "y", "z"), "face": _CORNERS}.get(self.name, ())
        only = self.name == "face" and len(self.properties) == 1
        lines = [f"element {self.name if names else 'other_' + self.name} {self.count}"]
        for number, entry in enumerate(self.properties):
            name = entry.name if entry.name in names or only else f"other_{number}"
            lines.append(" ".join(["property", *entry.type_words, name]))
        return lines


@dataclass(frozen=True)
class PlyHeader:
    """Header of a PLY file."""

    order: str
    """Byte order in NumPy's notation; empty: the file is text."""
    elements: tuple[Element, ...]
    start: int
    """Position of the first byte of data."""

    def count(self, name: str) -> int:
        """Return the declared number of records of the elements of a name."""
        return sum(element.count for element in self.elements if element.name == name)

    def plain(self) -> bytes:
        """Return the header without comments, colours and textures, which trimesh would read."""
        return _header_text(self.order, [element for element in self.elements if element.count])


def _header_text(order: str, elements: Iterable[Element], *more: str) -> bytes:
    """A header of some elements, and further lines."""
    lines = chain.from_iterable(element.lines() for element in elements)
    text = ["ply", f"format {_FORMATS[order]} 1.0", *lines, *more, "end_header\n"]
    return "\n".join(text).encode("utf-8", "replace")


def read_ply_header(source: Source) -> PlyHeader:
    """Read the header of a PLY, and check the declared counts against the file size.

    Raises:
        MeshError: It is not a PLY, or declares more than the file can contain.
    """
    for size in (LONGEST_HEADER, source.size):  # labels are partly in comments
        match = re.match(rb"ply\s(.*?)\nend_header[ \r]*\n", source.head(size), re.DOTALL)
        if match is not None:
            break
    if match is None:
        raise source.unexpected("cannot be read as PLY: no header")
    formats = {name: order for order, name in _FORMATS.items()}
    order, elements = "", list[Element]()
    for line in re.split(r"\r?\n", match[1].decode("utf-8", "replace")):
        words = line.split()
        try:
            if words[:1] == ["format"]:
                order = formats[words[1]]
            elif words[:1] == ["element"]:
                elements.append(Element(words[1], int(words[2])))
            elif words[:1] == ["property"]:
                elements[-1].properties.append(_property(words[1:]))
        except (ValueError, KeyError, IndexError) as error:
            raise source.damaged(f"a line of its header ({line[:60]!r}) is not valid") from error
    header = PlyHeader(order, tuple(elements), match.end())
    _check_elements(source, header)
    return header


def _property(words: list[str]) -> Property:
    *kind, name = words
    if kind[0] == "list":
        _, length, each = kind
        if _TYPES[length] not in _LENGTHS:
            raise ValueError(length)
        return Property(name, tuple(kind), _TYPES[each], _TYPES[length])
    (each,) = kind
    return Property(name, tuple(kind), _TYPES[each], None)


def _check_elements(source: Source, header: PlyHeader) -> None:
    for element in header.elements:
        names = [entry.name for entry in element.properties]
        broken = element.name == "face" and any(
            entry.length and entry.type[0] == "f" and (entry.name in _CORNERS or len(names) == 1)
            for entry in element.properties
        )
        if len(set(names)) < len(names) or broken:
            raise source.damaged(
                f"element {element.name[:20]!r} has a property twice, or corners that are not "
                "whole numbers"
            )
        least = element.min_bytes if header.order else _MIN_TEXT_BYTES * len(element.properties)
        plurals = {"vertex": "vertices", "face": "faces"}
        what = plurals.get(element.name, f"elements {element.name[:20]!r}")
        check_count(source, what, element.count, max(least, 1), source.size - header.start + 1)


def vertex_columns(source: Source) -> dict[str, npt.NDArray[Any]]:
    """Read the numbers of the vertices by name, shape (V,) each.

    Raises:
        MeshError: It is damaged, or its vertices do not come first, or have lists.
    """
    header, data = read_ply_header(source), source.path.read_bytes()
    vertex = header.elements[0] if header.elements else Element("", 0)
    if vertex.name != "vertex" or vertex.lists:
        raise source.error("its vertices do not come first, or have lists; export the mesh again")
    rows = np.dtype([(entry.name, header.order + entry.type) for entry in vertex.properties])
    if not header.order:
        words = data[header.start :].split(None, vertex.count * len(vertex.properties))
        values = words[: vertex.count * len(vertex.properties)]
        try:
            columns = np.array(values, dtype=np.float64).reshape(vertex.count, -1).T
        except ValueError as error:
            raise source.damaged("its vertices are not numbers") from error
        return {one.name: column for one, column in zip(vertex.properties, columns, strict=True)}
    if len(data) < header.start + vertex.count * rows.itemsize:
        raise source.incomplete(f"declares {vertex.count:,} vertices, but contains fewer")
    table = np.frombuffer(data, rows, vertex.count, header.start)
    return {name: table[name].astype(np.float64) for name in rows.names or ()}


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
                quoted = line[:40].decode("utf-8", "replace")
                raise source.damaged(
                    f"{element.name} {number} ({quoted!r}) has a wrong number of numbers"
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
    start, parts, before = header.start, list[bytes](), list[Element]()
    for element in header.elements:
        if element.name == "face":
            faces = _fans(_polygons(source, header.order, element, data, start))
            break
        if element.lists:
            raise source.error(
                "has lists of differing lengths before its faces; export the "
                "mesh again, as triangles"
            )
        before.append(element)
        parts.append(data[start : start + element.count * element.min_bytes])
        start += element.count * element.min_bytes
    face = f"element face {len(faces)}", "property list uchar int64 vertex_indices"
    rows = np.zeros(len(faces), dtype=[("n", "u1"), ("corners", f"{header.order}i8", 3)])
    rows["n"], rows["corners"] = 3, faces
    return _header_text(header.order, before, *face) + b"".join(parts) + rows.tobytes()


def _fans(polygons: Sequence[Ints]) -> Ints:
    """Divide polygons into triangles that share the first corner, shape (F, 3)."""
    counts, corners = np.array([len(polygon) for polygon in polygons]), np.concatenate(polygons)
    first = np.repeat(np.cumsum(counts) - counts, counts - 2)
    step = np.arange(len(first)) - np.repeat(np.cumsum(counts - 2) - (counts - 2), counts - 2)
    fans: Ints = corners[np.stack([first, first + step + 1, first + step + 2], axis=1)]
    return fans


def _polygons(
    source: Source, order: str, element: Element, data: bytes, start: int
) -> list[npt.NDArray[Any]]:
    """Return the vertex numbers of the corners of each face."""
    if element.lists != 1:
        raise source.error(
            f"its faces have {element.lists} lists of differing lengths, one is "
            "allowed; export the mesh again, as triangles"
        )
    index = next(i for i, entry in enumerate(element.properties) if entry.length)
    entry = element.properties[index]
    before = sum(other.min_bytes for other in element.properties[:index])
    after = sum(other.min_bytes for other in element.properties[index + 1 :])
    length = struct.Struct(order + np.dtype(entry.length).char)
    size = int(entry.type[1])
    polygons = []
    for face in range(element.count):
        first = start + before + length.size
        count = length.unpack_from(data, first - length.size)[0] if first <= len(data) else 0
        start = first + count * size + after
        if start > len(data) or first > len(data):
            raise source.incomplete(f"declares {element.count:,} faces, but contains {face:,}")
        if not 3 <= count <= MOST_CORNERS:
            raise source.error(
                f"face {face} has {count} corners; 3 to {MOST_CORNERS:,} are allowed"
            )
        polygons.append(np.frombuffer(data, order + entry.type, count, first))
    return polygons
