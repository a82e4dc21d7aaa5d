"""OBJ and OFF, and the division of their polygons, and of those of a PLY, into triangles."""

import re
from array import array
from collections.abc import Callable, Iterable

import mapbox_earcut
import numpy as np

from grasp3d.arrays import Floats, Ints
from grasp3d.reading.sources import Source, check_corners

MOST_CORNERS = 1000
"""Largest number of corners of a face; round lids have a few hundred."""

FOLDED = 1e-6
"""Area that a triangle may have on the wrong side of its face, as a fraction of the face's."""

_OFF = re.compile(
    rb"(?:\xef\xbb\xbf)?\s*(?:(?:ST)?C?N?OFF|off)\s+(\d+)\s+(\d+)"
    rb"(?:[ \t]+-?\d[^\r\n]*|\s+\d+[ \t]*(?=[\r\n]))?(?=\s|$)"
)
"""Header of an OFF: its numbers of vertices and faces. The third, of edges, is often left out;
alone on a line it cannot be a vertex."""


class _Polygons:
    """Vertices, and polygons of any number of corners, of which lines of a text are read."""

    def __init__(self, source: Source) -> None:
        self.source = source
        self.positions, self.corners, self.counts = array("d"), array("q"), array("q")

    def read(self, lines: Iterable[bytes], add: Callable[[list[bytes]], None]) -> None:
        """Add the words of each line. Raises MeshError."""
        for line in lines:
            try:
                add(line.split())
            except (ValueError, IndexError, OverflowError) as error:
                text = line.decode("utf-8", "replace")[:40]
                raise self.source.damaged(f"its line {text!r} cannot be read ({error})") from error

    def add_vertex(self, words: list[bytes]) -> None:
        """Add a vertex of three coordinates, which colours may follow."""
        self.positions.extend([float(words[k]) for k in range(3)])

    def add_polygon(self, corners: list[int]) -> None:
        """Add a polygon of the numbers of its corners."""
        self.corners.extend(corners)
        self.counts.append(len(corners))

    def surface(self) -> tuple[Floats, Ints]:
        """Vertices (V, 3) and triangles (F, 3). Raises MeshError."""
        vertices = np.array(self.positions, np.float64).reshape(-1, 3)
        corners, counts = np.array(self.corners, int), np.array(self.counts, int)
        return vertices, as_triangles(self.source, vertices, corners, counts)


def read_obj(source: Source) -> tuple[Floats, Ints]:
    """Read the vertices (V, 3) and triangles (F, 3) of all parts of an OBJ. Raises MeshError."""
    found = _Polygons(source)

    def add(words: list[bytes]) -> None:
        if words[:1] == [b"v"]:
            found.add_vertex(words[1:])
        elif words[:1] == [b"f"]:
            count = len(found.positions) // 3
            numbers = [int(word.split(b"/", 1)[0]) for word in words[1:]]  # of `v/vt/vn`
            if 0 in numbers:
                raise ValueError("there is no vertex 0")
            found.add_polygon([k - 1 if k > 0 else count + k for k in numbers])  # or backwards

    text = re.sub(rb"\\\r?\n", b" ", source.path.read_bytes())
    found.read(re.sub(rb"#[^\r\n]*", b"", text).splitlines(), add)
    return found.surface()


def read_off(source: Source) -> tuple[Floats, Ints]:
    """Read the vertices (V, 3) and triangles (F, 3) of a text OFF. Raises MeshError."""
    data = re.sub(rb"#[^\r\n]*", b"", source.path.read_bytes())
    header = _OFF.match(data)
    if header is None:
        raise source.unexpected("cannot be read as OFF: expected a text that begins OFF, counts")
    vertices, faces = int(header[1][:18]), int(header[2][:18])
    lines = [line for line in data[header.end() :].splitlines() if line.strip()]
    if len(lines) < vertices + faces:
        raise source.unexpected(
            f"declares {vertices:,} vertices and {faces:,} faces, but contains {len(lines):,} lines"
        )
    found = _Polygons(source)
    found.read(lines[:vertices], found.add_vertex)
    found.read(
        lines[vertices : vertices + faces],
        lambda words: found.add_polygon([int(words[k + 1]) for k in range(int(words[0]))]),
    )
    return found.surface()


def as_triangles(source: Source, vertices: Floats, corners: Ints, counts: Ints) -> Ints:
    """Divide polygons into triangles, shape (F, 3).

    They share the first corner of their polygon, unless one would then lie outside it, or on
    another one: then its ears are cut.

    Args:
        source: The file.
        vertices: Positions, shape (V, 3).
        corners: Vertex numbers of the corners of one polygon after the other, shape (k,).
        counts: How many are those of each polygon, shape (n,).

    Raises:
        MeshError: A polygon has too few or too many corners, or such as do not exist.
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
    with np.errstate(over="ignore", invalid="ignore"):  # of coordinates that are refused later
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
    """Triangles (k, 3) of a polygon, in numbers of its corners, cut on the plane of its normal."""
    normal = normal / np.linalg.norm(normal)
    side = np.cross(normal, np.eye(3)[np.abs(normal).argmin()])
    side /= np.linalg.norm(side)
    flat = (points - points[0]) @ np.stack([side, np.cross(normal, side)], axis=1)
    ends = np.array([len(points)], dtype=np.uint32)
    return mapbox_earcut.triangulate_float64(flat, ends).reshape(-1, 3).astype(np.int64)
