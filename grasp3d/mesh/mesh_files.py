"""Reading of mesh files: OBJ, OFF, PLY and STL here, glTF and 3MF by trimesh.

The faces of OBJ, OFF and PLY may have any number of corners, and become triangles.
"""

import re
from array import array
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias

import mapbox_earcut
import numpy as np
import numpy.typing as npt

from grasp3d.arrays import Floats, Ints, first_at_position
from grasp3d.errors import MeshError
from grasp3d.mesh.sources import RawMesh, Source, check_corners, find_source, read_3mf, read_gltf
from grasp3d.system.limited_reading import read_file
from grasp3d.system.names import reason_of

MOST_CORNERS = 1000
"""Largest number of corners of a face; round lids have a few hundred."""

FOLDED = 1e-6
"""Area that a triangle may have on the wrong side of its face, as a fraction of the face's."""

_OFF = re.compile(
    rb"(?:\xef\xbb\xbf)?\s*(?:(?:ST)?C?N?OFF|off)\s+(\d+)\s+(\d+)"
    rb"(?:[ \t]+-?\d[^\r\n]*|\s+\d+[ \t]*(?=[\r\n]))?(?=\s|$)"
)
"""Header of an OFF: numbers of vertices and faces. The number of edges is often left out; alone on
a line it cannot be mistaken for a vertex."""


def read_obj(source: Source) -> tuple[Floats, Ints]:
    """Read the vertices (V, 3) and triangles (F, 3) of all parts of an OBJ.

    Raises:
        MeshError: A face has too few corners, or some that do not exist. ValueError: It is no OBJ.
    """
    positions, corners, counts = array("d"), array("q"), array("q")
    text = re.sub(rb"\\\r?\n|#[^\r\n]*", b" ", source.path.read_bytes())
    for kind, *words in filter(None, map(bytes.split, text.splitlines())):
        if kind == b"v":
            x, y, z = words[:3]
            positions.extend((float(x), float(y), float(z)))
        elif kind == b"f":
            numbers = [int(word.split(b"/", 1)[0]) for word in words]  # of `v/vt/vn`
            if 0 in numbers:
                raise ValueError("there is no vertex 0")
            count = len(positions) // 3  # negative numbers count backwards from here
            corners.extend([k - 1 if k > 0 else count + k for k in numbers])
            counts.append(len(numbers))
    vertices = np.array(positions).reshape(-1, 3)
    return vertices, as_triangles(source, vertices, np.array(corners), np.array(counts))


def read_off(source: Source) -> tuple[Floats, Ints]:
    """Read the vertices (V, 3) and triangles (F, 3) of a text OFF; raises as `read_obj`."""
    data = re.sub(rb"#[^\r\n]*", b"", source.path.read_bytes())
    header = _OFF.match(data)
    if header is None:
        raise ValueError("expected a text that begins OFF, counts")
    count, faces = int(header[1]), int(header[2])
    lines = [words for line in data[header.end() :].splitlines() if (words := line.split())]
    if len(lines) < count + faces:
        raise ValueError(f"{count:,} vertices and {faces:,} faces on {len(lines):,} lines")
    vertices = np.array([words[:3] for words in lines[:count]], dtype=np.float64).reshape(-1, 3)
    rows = [[int(word) for word in words[: int(words[0]) + 1]] for words in lines[count:][:faces]]
    if any(row[0] != len(row) - 1 for row in rows):
        raise ValueError("a face has fewer corners than it declares")
    corners = [corner for row in rows for corner in row[1:]]
    counts = [row[0] for row in rows]
    return vertices, as_triangles(source, vertices, np.array(corners, int), np.array(counts, int))


_TYPES = {
    "char": "i1", "uchar": "u1", "int8": "i1", "uint8": "u1", "short": "i2", "ushort": "u2",
    "int16": "i2", "uint16": "u2", "int": "i4", "uint": "u4", "int32": "i4", "uint32": "u4",
    "int64": "i8", "uint64": "u8", "float": "f4", "double": "f8", "float32": "f4", "float64": "f8",
}  # fmt: skip
_ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}

LENGTH = "length of "
"""Prefix of the name of a column with the lengths of lists."""

Column: TypeAlias = npt.NDArray[Any] | list[npt.NDArray[Any]]
"""A property of all records: numbers (N,), lists of one length (N, k), or lists that differ."""

Columns: TypeAlias = dict[str, Column]
"""Columns of an element by the name of their property."""


@dataclass(frozen=True)
class Element:
    """An element of a PLY: a table of records."""

    count: int
    properties: dict[str, tuple[str, str]]
    """By name, the NumPy types, without byte order, of its numbers and of the length of a list; the
    latter is empty if it is no list."""


@dataclass(frozen=True, eq=False)
class PlyFile:
    """A PLY file whose header has been read."""

    source: Source
    order: str
    """Byte order in NumPy's notation; empty: the file is text."""
    elements: dict[str, Element]
    """By name, in the order of the file."""
    header: bytes
    """The whole header, with its comments."""
    body: bytes
    """What follows the header."""


def open_ply(source: Source) -> PlyFile:
    """Read the header of a PLY. Raises MeshError."""
    data = source.path.read_bytes()
    head = re.match(rb"ply\s(.*?)\nend_header[ \r]*\n", data, re.DOTALL)
    if head is None:
        raise source.unexpected("cannot be read as PLY (it has no header)")
    order, elements, properties = "", dict[str, Element](), dict[str, tuple[str, str]]()
    for line in re.split(r"\r?\n", head[1].decode("utf-8", "replace")):
        try:
            match line.split():
                case ["format", name, *_]:
                    order = _ORDERS[name]
                case ["element", name, count] if count.isdecimal() and name not in elements:
                    elements[name] = Element(int(count), properties := {})
                case ["property", "list", length, kind, name] if _TYPES[length][0] != "f":
                    properties[name] = _TYPES[kind], _TYPES[length]
                case ["property", kind, name] if name not in properties:
                    properties[name] = _TYPES[kind], ""
                case ["element" | "property", *_]:
                    raise ValueError(line)  # noqa: TRY301
        except (ValueError, LookupError) as error:
            raise source.unexpected(f"a line of its header ({line[:60]!r}) is not valid") from error
    return PlyFile(source, order, elements, head[0], data[head.end() :])


def read_ply(source: Source) -> tuple[Floats, Ints]:
    """Read the vertices (V, 3) and triangles (F, 3) of a PLY.

    Raises:
        MeshError: A line of the header, or a face, is invalid. ValueError: A column is invalid.
    """
    file = open_ply(source)
    elements = read_elements(file)
    vertices = elements.get("vertex", {})
    if not vertices.keys() >= set("xyz"):
        raise ValueError("its vertices have no x, y and z")
    kind = np.float32 if file.elements["vertex"].properties["x"][0] == "f4" else np.float64
    positions = np.stack([np.asarray(vertices[axis], dtype=kind) for axis in "xyz"], axis=1)
    positions, triangles = positions.astype(np.float64), [np.empty((0, 3), dtype=np.int64)]
    for name in elements.keys() & {"face", "tristrips"}:
        columns = elements[name]
        lists = [key for key, one in columns.items() if len(np.shape(one[:1])) == 2]
        known = [key for key in ("vertex_indices", "vertex_index", *lists) if key in lists]
        rows = columns[known[0]] if name == "face" else _of_strips(columns[known[0]])
        corners = np.concatenate([*rows, []])
        if (corners % 1 != 0).any():
            raise ValueError(f"its element {name!r} has corners that are no whole numbers")
        counts = np.fromiter(map(len, rows), np.int64, len(rows))
        triangles.append(as_triangles(source, positions, corners.astype(np.int64), counts))
    return positions, np.concatenate(triangles)


def _of_strips(rows: Column) -> npt.NDArray[Any]:
    """Triangles (k, 3) of strips that end at -1, without degenerate ones that only join strips."""
    from trimesh.util import triangle_strips_to_faces

    parts = (part for row in rows for part in np.split(row, np.flatnonzero(row == -1)))
    strips = [strip.astype(int) for part in parts if len(strip := part[part != -1]) > 2]
    triangles: Ints = triangle_strips_to_faces(strips or [np.empty(0, int)])
    return np.asarray(triangles[(triangles != np.roll(triangles, 1, axis=1)).all(axis=1)])


def read_elements(ply: PlyFile) -> dict[str, Columns]:
    """Read the columns of all elements that have any records, by name.

    Numbers have the type that the header declares; those of a text file are float64.

    Raises:
        ValueError: There are too few numbers, or in a text file too many. OverflowError: As well.
    """
    data, elements, start = ply.body, dict[str, Columns](), 0
    if not ply.order:  # treat a text file as a binary file of 64-bit numbers
        data = np.array(data.split(), dtype=np.float64).tobytes()
    for name, element in ply.elements.items():
        if element.count and element.properties:
            elements[name], start = _columns(element, ply.order, data, start)
    if not ply.order and start < len(data):
        raise ValueError("it has more numbers than its header declares")
    return elements


def _columns(element: Element, order: str, data: bytes, start: int) -> tuple[Columns, int]:
    """The columns of an element, and where it ends. Raises ValueError, OverflowError."""
    kinds = {
        name: [one and (order + one if order else "f8") for one in types]
        for name, types in element.properties.items()
    }

    def record(at: int) -> tuple[dict[str, npt.NDArray[Any]], int]:
        """The numbers of the record that begins there, and where it ends."""
        values = {}
        for name, (kind, length) in kinds.items():
            count = 1.0
            if length:
                (count,) = np.frombuffer(data, length, 1, at).tolist()
                at += np.dtype(length).itemsize
                if count < 0 or count % 1:
                    raise ValueError(f"a list has {count} numbers")
            values[name] = np.frombuffer(data, kind, int(count), at)
            at += values[name].nbytes
        return values, at

    first, _ = record(start)
    lists = [name for name, (_, length) in kinds.items() if length]
    layout = list[Any]()  # usually all lists are as long as the first
    for name, (kind, length) in kinds.items():
        layout += [(LENGTH + name, length)] if length else []
        layout.append((name, kind, first[name].shape if length else ()))
    with suppress(ValueError):
        rows = np.frombuffer(data, layout, element.count, start)
        if all((rows[LENGTH + name] == len(first[name])).all() for name in lists):
            return {name: rows[name] for name in kinds}, start + rows.nbytes
    if not lists:
        raise ValueError(f"there is no data for {element.count:,} records")
    records = []
    for _ in range(element.count):
        values, start = record(start)
        records.append(values)
    columns: Columns = {name: [one[name] for one in records] for name in kinds}
    return columns | {
        name: np.concatenate(columns[name]) for name in kinds.keys() - set(lists)
    }, start


def as_triangles(source: Source, vertices: Floats, corners: Ints, counts: Ints) -> Ints:
    """Divide polygons into triangles, shape (F, 3).

    The triangles of a polygon share its first corner, unless one of them would then lie outside it
    or overlap another: such a polygon is divided by ear clipping.

    Args:
        source: The file.
        vertices: Positions, shape (V, 3).
        corners: Vertex numbers of the corners of one polygon after the other, shape (k,).
        counts: Number of corners of each polygon, shape (n,).

    Raises:
        MeshError: A polygon has too few or too many corners, or corners that do not exist.
    """
    bad = np.flatnonzero((counts < 3) | (counts > MOST_CORNERS))
    if len(bad):
        raise source.error(
            f"face {bad[0]} has {counts[bad[0]]:,} corners; 3 to {MOST_CORNERS:,} are allowed"
        )
    starts, polygons = np.cumsum(counts) - counts, np.repeat(np.arange(len(counts)), counts - 2)
    first = starts[polygons]
    step = np.arange(len(first)) - (first - 2 * polygons)
    fans: Ints = corners[np.stack([first, first + step + 1, first + step + 2], axis=1)]
    check_corners(fans, len(vertices), source.where)
    if (counts == 3).all():
        return fans
    with np.errstate(over="ignore", invalid="ignore"):  # such coordinates are refused later
        one, two, three = np.moveaxis(vertices[fans], 1, 0)
        normals = np.cross(two - one, three - one)
        of_polygons = np.add.reduceat(normals, starts - 2 * np.arange(len(counts)))
        areas = (normals * of_polygons[polygons]).sum(axis=1)
        is_folded = areas < -FOLDED * (of_polygons**2).sum(axis=1)[polygons]
    for polygon in np.unique(polygons[is_folded]):
        own = corners[starts[polygon] : starts[polygon] + counts[polygon]]
        ears = own[_ears(vertices[own], of_polygons[polygon])]
        if len(ears) == len(own) - 2:  # otherwise it crosses itself
            row = starts[polygon] - 2 * polygon
            fans[row : row + len(ears)] = ears
    return fans


def _ears(points: Floats, normal: Floats) -> Ints:
    """Divide a polygon by ear clipping in the plane of its normal; corner numbers (k, 3)."""
    normal = normal / np.linalg.norm(normal)
    side = np.cross(normal, np.eye(3)[np.abs(normal).argmin()])
    side /= np.linalg.norm(side)
    flat = (points - points[0]) @ np.stack([side, np.cross(normal, side)], axis=1)
    ends = np.array([len(points)], dtype=np.uint32)
    return mapbox_earcut.triangulate_float64(flat, ends).reshape(-1, 3).astype(np.int64)


_STL_HEADER = 84
"""Size of the header of a binary STL, which ends with the number of faces [bytes]."""

_STL_FACE = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])


def read_mesh(path: Path) -> RawMesh:
    """Read a mesh file; a scene becomes one mesh, with the transforms of its parts applied.

    Args:
        path: The file.

    Raises:
        MeshError: There is no such file, its format is unknown, it is damaged, or has no triangles.
        FileUnreadError: Reading is limited, and it exceeded a limit.
    """
    return read_file(_read, path)


def _read(path: Path) -> RawMesh:
    source = find_source(path)
    try:
        vertices, faces, *stated = READERS[source.kind](source)
    except (MeshError, MemoryError):
        raise
    except Exception as error:  # trimesh raises errors of any class
        is_obscure = isinstance(error, LookupError | TypeError | AttributeError | AssertionError)
        reason = "its parts do not fit together" if is_obscure else reason_of(error)
        raise source.unexpected(f"cannot be read as {source.kind.upper()} ({reason})") from error
    return RawMesh(vertices, faces, source.kind, next(iter(stated), None), path.name, path)


def _read_stl(source: Source) -> tuple[Floats, Ints]:
    """Vertices (V, 3), each position once, and faces (F, 3) of an STL."""
    data = source.path.read_bytes()
    count = int.from_bytes(data[_STL_HEADER - 4 : _STL_HEADER], "little")
    if 0 < count <= (len(data) - _STL_HEADER) // _STL_FACE.itemsize:
        corners = np.frombuffer(data, _STL_FACE, count, _STL_HEADER)["corners"].reshape(-1, 3)
    else:
        text, ends = re.subn(rb"(?m)^\s*endsolid.*", b"", data.lower().replace(b"\r", b"\n"))
        text = re.sub(rb"(?m)^\s*solid.*", b"", text)  # names may be words of the format
        words = re.findall(rb"vertex\s+(\S+)\s+(\S+)\s+(\S+)", text)
        corners, count = np.array(words, dtype=np.float64), text.count(b"endfacet")
        if not (ends and count) or len(words) != 3 * count:
            raise source.unexpected(
                "cannot be read as STL: its triangles are complete neither in binary nor as text"
            )
    first, faces = np.unique(first_at_position(corners), return_inverse=True)
    return corners[first].astype(np.float64), faces.reshape(-1, 3)


READERS: dict[str, Callable[[Source], tuple[Any, ...]]] = {
    "3mf": read_3mf,
    "glb": read_gltf,
    "gltf": read_gltf,
    "obj": read_obj,
    "off": read_off,
    "ply": read_ply,
    "stl": _read_stl,
}
