"""OBJ, OFF and PLY: the formats of faces with any number of corners, which become triangles."""

import re
from array import array
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from grasp3d.arrays import Floats, Ints
from grasp3d.reading.polygons import as_triangles
from grasp3d.reading.sources import Source
from grasp3d.system.names import reason_of

_OFF = re.compile(
    rb"(?:\xef\xbb\xbf)?\s*(?:(?:ST)?C?N?OFF|off)\s+(\d+)\s+(\d+)"
    rb"(?:[ \t]+-?\d[^\r\n]*|\s+\d+[ \t]*(?=[\r\n]))?(?=\s|$)"
)
"""Header of an OFF: its numbers of vertices and faces. The third, of edges, is often left out;
alone on a line it cannot be a vertex."""


def read_obj(source: Source) -> tuple[Floats, Ints]:
    """Read the vertices (V, 3) and triangles (F, 3) of all parts of an OBJ. Raises MeshError."""
    lines = re.sub(rb"\\\r?\n", b" ", source.path.read_bytes()).splitlines()
    total = sum(line.split(None, 1)[:1] == [b"v"] for line in lines)
    positions, corners, counts = array("d"), array("q"), array("q")
    for number, line in enumerate(lines, 1):
        kind, *words = line.partition(b"#")[0].split() or [b""]
        try:
            if kind == b"v":
                positions.extend(_position(words))
            elif kind == b"f":
                count = len(positions) // 3
                corners.extend([_vertex(word, count, total) for word in words])
                counts.append(len(words))
        except ValueError as error:
            text = line.decode("utf-8", "replace")[:40]
            raise source.damaged(f"line {number}, {text!r}, cannot be read ({error})") from error
    return _surface(source, positions, corners, counts)


def _position(words: list[bytes]) -> list[float]:
    """The three coordinates of a vertex, which colours may follow."""
    position = [float(word) for word in words[:3]]
    if len(position) < 3:
        raise ValueError("a vertex needs three coordinates")
    return position


def _vertex(corner: bytes, count: int, total: int) -> int:
    """The vertex of a face's corner `v/vt/vn`, of which numbers below 0 count backwards."""
    number = int(corner.split(b"/", 1)[0])
    absolute = number if number > 0 else count + 1 + number
    if number == 0 or absolute < 1:
        raise ValueError(f"a face uses vertex {number}")
    if absolute > total:
        raise ValueError(f"there are {total:,} vertices")
    return absolute - 1


def read_off(source: Source) -> tuple[Floats, Ints]:
    """Read the vertices (V, 3) and triangles (F, 3) of a text OFF. Raises MeshError."""
    data = re.sub(rb"#[^\r\n]*", b"", source.path.read_bytes())
    header = _OFF.match(data)
    if header is None:
        raise source.unexpected("cannot be read as OFF: expected a text that begins OFF, counts")
    vertices, faces = int(header[1][:18]), int(header[2][:18])
    lines = [line for line in data[header.end() :].splitlines() if line.strip()]
    if len(lines) < vertices + faces:
        raise source.incomplete(
            f"declares {vertices:,} vertices and {faces:,} faces, but contains {len(lines):,} lines"
        )
    positions, corners, counts = array("d"), array("q"), array("q")
    for number, line in enumerate(lines[: vertices + faces]):
        words = line.split()
        try:
            if number < vertices:
                positions.extend(_position(words))
                continue
            counts.append(int(words[0]))
            corners.extend([int(words[k]) for k in range(1, counts[-1] + 1)])
        except (ValueError, IndexError, OverflowError) as error:
            what = f"vertex {number}" if number < vertices else f"face {number - vertices}"
            text = line.decode("utf-8", "replace")[:40]
            raise source.damaged(f"{what}, {text!r}, cannot be read ({error})") from error
    return _surface(source, positions, corners, counts)


def _surface(
    source: Source, positions: "array[float]", corners: "array[int]", counts: "array[int]"
) -> tuple[Floats, Ints]:
    vertices = np.array(positions, np.float64).reshape(-1, 3)
    faces = as_triangles(source, vertices, np.array(corners, int), np.array(counts, int))
    return vertices, faces


_TYPES = {
    "char": "i1", "uchar": "u1", "int8": "i1", "uint8": "u1", "short": "i2", "ushort": "u2",
    "int16": "i2", "uint16": "u2", "int": "i4", "uint": "u4", "int32": "i4", "uint32": "u4",
    "int64": "i8", "uint64": "u8", "float": "f4", "double": "f8", "float32": "f4", "float64": "f8",
}  # fmt: skip
_ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}

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


@dataclass(frozen=True)
class Element:
    """An element of a PLY: a table of records."""

    name: str
    count: int
    properties: list[Property] = field(default_factory=list)

    @property
    def plural(self) -> str:
        """Its records, for messages."""
        plurals = {"vertex": "vertices", "face": "faces"}
        return plurals.get(self.name, f"elements {self.name[:20]!r}")

    def corners(self) -> str | None:
        """Name of the list of the corners of each record; None: there is none."""
        lists = [one.name for one in self.properties if one.length is not None]
        named = {"vertex_indices", "vertex_index"}
        only = len(self.properties) == 1
        return next((name for name in lists if only or name in named), None)


@dataclass(frozen=True)
class PlyHeader:
    """Header of a PLY file."""

    order: str
    """Byte order in NumPy's notation; empty: the file is text."""
    elements: tuple[Element, ...]
    text: bytes
    """All of it, with the comments."""

    def element(self, name: str) -> Element:
        """The element of a name; an empty one if there is none."""
        return next((one for one in self.elements if one.name == name), Element(name, 0))


def read_ply_header(source: Source) -> PlyHeader:
    """Read the header of a PLY. Raises MeshError."""
    for size in (65_536, source.size):  # labels are partly in comments
        head = re.match(rb"ply\s(.*?)\nend_header[ \r]*\n", source.head(size), re.DOTALL)
        if head is not None:
            break
    else:
        raise source.unexpected("cannot be read as PLY: no header")
    order, elements = "ascii", list[Element]()
    for line in re.split(r"\r?\n", head[1].decode("utf-8", "replace")):
        try:
            order = _with_line(line.split(), elements) or order
        except (ValueError, LookupError) as error:
            raise source.damaged(f"a line of its header ({line[:60]!r}) is not valid") from error
    if order not in _ORDERS:
        raise source.damaged(f"its format {order[:40]!r} is not known")
    names = [[each.name for each in one.properties] for one in elements]
    for listed in ([one.name for one in elements], *names):
        if len(set(listed)) < len(listed) or any(one.count < 0 for one in elements):
            raise source.damaged("its header has a name twice, or a count below 0")
    return PlyHeader(_ORDERS[order], tuple(elements), head[0])


def _with_line(words: list[str], elements: list[Element]) -> str:
    """Add a line of a header to its elements; returns the format, if it states one.

    Raises:
        ValueError: It is not valid. LookupError: As well.
    """
    match words:
        case ["format", name, *_]:
            return name
        case ["element", name, count]:
            elements.append(Element(name, int(count[:18])))
        case ["property", "list", length, kind, name] if _TYPES[length][0] != "f":
            elements[-1].properties.append(Property(name, _TYPES[kind], _TYPES[length]))
        case ["property", kind, name]:
            elements[-1].properties.append(Property(name, _TYPES[kind], None))
        case ["element" | "property", *_]:
            raise ValueError(words)
    return ""


def read_ply(source: Source) -> tuple[Floats, Ints]:
    """Read the vertices (V, 3) and triangles (F, 3) of a PLY. Raises MeshError."""
    header = read_ply_header(source)
    elements, rest = read_elements(source, header)
    if rest and not header.order:
        raise source.damaged(f"has {rest:,} numbers more than its header declares")
    vertices, triangles = scalars(elements.get("vertex", {})), [np.empty((0, 3), dtype=np.int64)]
    if not vertices.keys() >= set("xyz"):
        raise source.damaged("its vertices have no x, y and z")
    positions = np.stack([vertices[axis] for axis in "xyz"], axis=1)
    for element in (one for one in header.elements if one.name in {"face", "tristrips"}):
        name = element.corners()
        if name is None:
            raise source.damaged(f"its {element.plural} have no corners")
        rows = elements[element.name][name]
        if element.name == "tristrips" and element.count:
            rows = np.concatenate([_of_strips(np.asarray(row)) for row in rows])
        corners = rows.ravel() if isinstance(rows, np.ndarray) else np.concatenate(rows)
        if (corners % 1 != 0).any():
            raise source.damaged(f"its {element.plural} have corners that are no whole numbers")
        counts = np.fromiter(map(len, rows), np.int64, len(rows))
        triangles.append(as_triangles(source, positions, corners.astype(np.int64), counts))
    return positions, np.concatenate(triangles)


def _of_strips(row: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Triangles (k, 3) of strips that -1 ends; every second one is wound the other way."""
    found = []
    for strip in np.split(row, np.flatnonzero(row == -1)):
        corners = strip[strip != -1]
        three = np.stack([corners[:-2], corners[1:-1], corners[2:]], axis=1)
        three[1::2] = three[1::2, ::-1]
        found.append(three[(three != np.roll(three, 1, axis=1)).all(axis=1)])
    return np.concatenate(found)


def scalars(columns: Columns) -> dict[str, Floats]:
    """The columns that are no lists, as floating-point numbers."""
    return {
        name: column.astype(np.float64)
        for name, column in columns.items()
        if isinstance(column, np.ndarray) and column.ndim == 1
    }


def read_elements(source: Source, header: PlyHeader) -> tuple[dict[str, Columns], int]:
    """Read the columns of all elements by name, and how many bytes, or numbers of a text, follow.

    Numbers have the type that the header declares; whole numbers of a text are float64. Raises
    MeshError.
    """
    data, elements, start = source.path.read_bytes()[len(header.text) :], dict[str, Columns](), 0
    if not header.order:
        try:  # the numbers of a text, as those of a binary file that are all of 64 bits
            data = np.array(data.split(), dtype=np.float64).tobytes()
        except ValueError as error:
            raise source.damaged(f"its numbers cannot be read ({reason_of(error)})") from error
    for element in header.elements:
        try:
            columns, start = _columns(element, header.order, data, start)
        except (ValueError, OverflowError) as error:
            raise source.incomplete(
                f"declares {element.count:,} {element.plural}, but has no data for so many"
            ) from error
        for one in element.properties if not header.order else ():
            if one.length is None and one.type[0] == "f":
                with np.errstate(over="ignore"):  # overflow gives inf, which is checked later
                    columns[one.name] = np.asarray(columns[one.name]).astype(one.type)
        elements[element.name] = columns
    return elements, (len(data) - start) // (1 if header.order else 8)


def _columns(element: Element, order: str, data: bytes, start: int) -> tuple[Columns, int]:
    """The columns of an element, and where it ends. Raises ValueError, OverflowError."""
    kinds = [
        (one.name, one.length and (order + one.length if order else "f8"),
         order + one.type if order else "f8")
        for one in element.properties
    ]  # fmt: skip
    if not element.count:
        return {
            name: np.empty((0, 0) if length else 0, kind) for name, length, kind in kinds
        }, start

    def count_at(length: str | None, at: int) -> tuple[int, int]:
        """How many numbers a property has, and where these begin."""
        if length is None:
            return 1, at
        (count,) = np.frombuffer(data, length, 1, at).tolist()
        if count < 0 or count != int(count):
            raise ValueError(count)
        return int(count), at + np.dtype(length).itemsize

    with suppress(ValueError):  # most often all lists are as long as the first
        layout, end = list[Any](), start
        for name, length, kind in kinds:
            layout += [(f"length of {name}", length)] if length else []
            count, end = count_at(length, end)
            layout.append((name, kind, (count,) if length else ()))
            end += count * np.dtype(kind).itemsize
        rows = np.frombuffer(data, layout, element.count, start)
        lists = [rows[f"length of {name}"] for name, length, _ in kinds if length]
        if all((one == one[0]).all() for one in lists):
            return {name: rows[name] for name, *_ in kinds}, start + rows.nbytes
    if not any(length for _, length, _ in kinds):
        raise ValueError(element.count)
    parts: dict[str, list[npt.NDArray[Any]]] = {name: [] for name, *_ in kinds}
    for _ in range(element.count):
        for name, length, kind in kinds:
            count, start = count_at(length, start)
            parts[name].append(np.frombuffer(data, kind, count, start))
            start += parts[name][-1].nbytes
    return {
        name: parts[name] if length else np.concatenate(parts[name]) for name, length, _ in kinds
    }, start
