"""OBJ and OFF, and the division of their polygons, and of those of a PLY, into triangles."""

import re
from array import array

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


def read_obj(source: Source) -> tuple[Floats, Ints]:
    """Read the vertices (V, 3) and triangles (F, 3) of all parts of an OBJ.

    Raises:
        MeshError: A face has too few corners, or such as do not exist. ValueError: It is no OBJ.
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
            count = len(positions) // 3  # from which numbers below 0 count backwards
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
