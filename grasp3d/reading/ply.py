"""PLY files: their headers, checked against the file size, and the columns of their elements."""

import re
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from grasp3d.arrays import Floats, Ints
from grasp3d.errors import MeshError
from grasp3d.reading.sources import LONGEST_HEADER, Source, as_triangles, check_count

_TYPES = {
    "char": "i1", "uchar": "u1", "int8": "i1", "uint8": "u1", "short": "i2", "ushort": "u2",
    "int16": "i2", "uint16": "u2", "int": "i4", "uint": "u4", "int32": "i4", "uint32": "u4",
    "int64": "i8", "uint64": "u8", "float": "f4", "double": "f8", "float32": "f4", "float64": "f8",
}  # fmt: skip
_LENGTHS = ("i1", "u1", "i2", "u2", "i4", "u4")
_ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
_CORNERS = ("vertex_indices", "vertex_index")
_MIN_TEXT_BYTES = 2
"""Least size of a number and its separator in a text file [bytes]."""

Column: TypeAlias = npt.NDArray[Any] | list[npt.NDArray[Any]]
"""A property of all records: numbers (N,), lists of one length (N, k), or lists that differ."""

Columns: TypeAlias = dict[str, Column]
"""Columns of an element by the name of their property."""


@dataclass(frozen=True)
class Property:
    """A number, or a list of numbers, of each record of an element."""

    name: str
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

    @property
    def plural(self) -> str:
        """Its records, for messages."""
        plurals = {"vertex": "vertices", "face": "faces"}
        return plurals.get(self.name, f"elements {self.name[:20]!r}")

    @property
    def corners(self) -> Property | None:
        """The list of the corners of each face; None: there is none."""
        lists = [entry for entry in self.properties if entry.length is not None]
        only = len(self.properties) == 1
        return next((entry for entry in lists if only or entry.name in _CORNERS), None)


@dataclass(frozen=True)
class PlyHeader:
    """Header of a PLY file."""

    order: str
    """Byte order in NumPy's notation; empty: the file is text."""
    elements: tuple[Element, ...]
    start: int
    """Position of the first byte of data."""

    def element(self, name: str) -> Element:
        """The element of a name; an empty one if there is none."""
        return next((one for one in self.elements if one.name == name), Element(name, 0))


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
    order, elements = "", list[Element]()
    for line in re.split(r"\r?\n", match[1].decode("utf-8", "replace")):
        words = line.split()
        try:
            if words[:1] == ["format"]:
                order = _ORDERS[words[1]]
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
        return Property(name, _TYPES[each], _TYPES[length])
    (each,) = kind
    return Property(name, _TYPES[each], None)


def _check_elements(source: Source, header: PlyHeader) -> None:
    if len({element.name for element in header.elements}) < len(header.elements):
        raise source.damaged("it has two elements of one name")
    for element in header.elements:
        names = [entry.name for entry in element.properties]
        corners = element.corners if element.name == "face" else None
        if len(set(names)) < len(names) or (corners and corners.type[0] == "f"):
            raise source.damaged(
                f"element {element.name[:20]!r} has a property twice, or corners that are not "
                "whole numbers"
            )
        least = element.min_bytes if header.order else _MIN_TEXT_BYTES * len(element.properties)
        available = source.size - header.start + 1
        check_count(source, element.plural, element.count, max(least, 1), available)


def read_ply(source: Source) -> tuple[Floats, Ints]:
    """Read the vertices (V, 3) and faces (F, 3) of a PLY.

    Raises:
        MeshError: It is damaged, or has no positions or no corners of faces.
    """
    header = read_ply_header(source)
    face = header.element("face")
    if not face.count:
        return np.empty((0, 3)), np.empty((0, 3), dtype=np.int64)
    elements = read_elements(source, header)
    vertices = scalars(elements.get("vertex", {}))
    if not vertices.keys() >= set("xyz"):
        raise source.damaged("its vertices have no x, y and z")
    if face.corners is None:
        raise source.damaged("its faces have no corners")
    polygons = elements["face"][face.corners.name]
    counts = np.fromiter(map(len, polygons), np.int64, len(polygons))
    corners = polygons.ravel() if isinstance(polygons, np.ndarray) else np.concatenate(polygons)
    faces = as_triangles(source, corners.astype(np.int64), counts)
    return np.stack([vertices[axis] for axis in "xyz"], axis=1), faces


def scalars(columns: Columns) -> dict[str, Floats]:
    """The columns that are no lists, as floating-point numbers."""
    return {
        name: column.astype(np.float64)
        for name, column in columns.items()
        if isinstance(column, np.ndarray) and column.ndim == 1
    }


def read_elements(source: Source, header: PlyHeader) -> dict[str, Columns]:
    """Read the columns of the elements by name; of a text only those of vertices and faces.

    Numbers have the type that the header declares, but whole numbers of a text are 64 bits wide.

    Raises:
        MeshError: It is incomplete or damaged.
    """
    data, elements = source.path.read_bytes(), dict[str, Columns]()
    if not header.order:
        lines = [line for line in data[header.start :].splitlines() if line.strip()]
        for element in header.elements:
            rows, lines = lines[: element.count], lines[element.count :]
            if element.name in {"vertex", "face"}:
                elements[element.name] = _of_text(source, element, rows)
        return elements
    start = header.start
    for element in header.elements:
        elements[element.name], start = _of_bytes(source, header.order, element, data, start)
    return elements


def _of_text(source: Source, element: Element, lines: list[bytes]) -> Columns:
    """The columns of an element with one record per line."""
    if len(lines) < element.count:
        raise _fewer(source, element, len(lines))
    rows = []
    for number, line in enumerate(lines):
        try:
            rows.append(_divided(line.split(), element.properties))
        except (ValueError, IndexError) as error:
            quoted = line[:40].decode("utf-8", "replace")
            raise source.damaged(
                f"{element.name} {number} ({quoted!r}) has a wrong number of numbers"
            ) from error
    try:
        return {
            entry.name: _column_of_words(entry, [row[number] for row in rows])
            for number, entry in enumerate(element.properties)
        }
    except (ValueError, OverflowError) as error:
        raise source.damaged(f"its {element.plural} have something that is no number") from error


def _divided(words: list[bytes], properties: list[Property]) -> list[Any]:
    """A word for each property, or words for a list. Raises ValueError, IndexError."""
    parts, start = list[Any](), 0
    for entry in properties:
        count = 1 if entry.length is None else int(words[start])
        start += entry.length is not None
        part = words[start : start + count]
        parts.append(part[0] if entry.length is None else part)
        start += count
    if start != len(words):
        raise ValueError(len(words))
    return parts


def _column_of_words(entry: Property, words: list[Any]) -> Column:
    if entry.length is None:
        kind = entry.type if entry.type[0] == "f" else "f8"
        with np.errstate(over="ignore"):  # overflow gives inf, which is checked later
            return np.array(words, dtype=np.float64).astype(kind)
    kind = "f8" if entry.type[0] == "f" else "i8"
    if len(set(map(len, words))) <= 1:
        return np.array(words, dtype=kind)
    return [np.array(part, dtype=kind) for part in words]


def _of_bytes(
    source: Source, order: str, element: Element, data: bytes, start: int
) -> tuple[Columns, int]:
    """The columns of an element of a binary file, and the position of its end.

    Raises:
        MeshError: The file is incomplete.
    """
    with suppress(ValueError):  # most often all lists are as long as the first
        record = _first_record(order, element, data, start)
        rows = np.frombuffer(data, record, element.count, start)
        lengths = [rows[name] for name in record.names or () if name.startswith(_LENGTH)]
        if all((one == one[:1]).all() for one in lengths):
            return {entry.name: rows[entry.name] for entry in element.properties}, (
                start + rows.nbytes
            )
    parts: dict[str, list[npt.NDArray[Any]]] = {entry.name: [] for entry in element.properties}
    for number in range(element.count if element.lists else 0):
        try:
            for entry in element.properties:
                count, start = _length(order, entry, data, start)
                parts[entry.name].append(np.frombuffer(data, order + entry.type, count, start))
                start += parts[entry.name][-1].nbytes
        except ValueError as error:
            raise _fewer(source, element, number) from error
    if element.count and not element.lists:
        raise _fewer(source, element, (len(data) - start) // element.min_bytes)
    return {
        entry.name: parts[entry.name] if entry.length else np.concatenate([[], *parts[entry.name]])
        for entry in element.properties
    }, start


_LENGTH = "length of "
"""Beginning of the fields with the lengths of lists; names of properties have no spaces."""


def _first_record(order: str, element: Element, data: bytes, start: int) -> np.dtype[np.void]:
    """The layout of an element's first record. Raises ValueError: the file ends before its end."""
    fields: list[tuple[Any, ...]] = []
    for entry in element.properties:
        count, start = _length(order, entry, data, start)
        if entry.length is not None:
            fields.append((f"{_LENGTH}{entry.name}", order + entry.length))
        shape = () if entry.length is None else (count,)
        fields.append((entry.name, order + entry.type, shape))
        start += count * int(entry.type[1])
    return np.dtype(fields)


def _length(order: str, entry: Property, data: bytes, start: int) -> tuple[int, int]:
    """How many numbers a property has in a record, and the position of the first of them.

    Raises:
        ValueError: The file ends before, or the length of a list is negative.
    """
    if entry.length is None:
        return 1, start
    length = np.frombuffer(data, order + entry.length, 1, start)
    if (count := int(length[0])) < 0:
        raise ValueError(count)
    return count, start + length.nbytes


def _fewer(source: Source, element: Element, count: int) -> MeshError:
    return source.incomplete(f"declares {element.count:,} {element.plural}, but contains {count:,}")
