"""Welding of vertices; degenerate, repeated and mirrored faces; winding; and hole filling.

A hole is a cycle of open edges, which a triangulation of least area fills.
"""

import manifold3d
import numpy as np
from scipy.spatial import cKDTree

from grasp3d.arrays import Bools, Floats, Ints, first_alike, used_indices
from grasp3d.mesh.measures import (
    connected,
    edges_of,
    first_connected,
    has_area,
    paired_edges,
    parts_of,
)

FEW = 0.01
"""Largest fraction of open edges of a body."""

PAIR = 2
"""Number of faces at an edge inside a surface."""

WELDS = (1e-9, 1e-8, 1e-7, 1e-6)
"""Distances within which the borders of open surfaces are joined, as fractions of the size."""


def is_face(faces: Ints) -> Bools:
    """Mask of the faces with three different corners, shape (F,)."""
    a, b, c = faces.T
    return np.asarray((a != b) & (b != c) & (c != a))


def from_least_corner(faces: Ints) -> Ints:
    """Rotate each face so that it begins at its smallest vertex index, shape (F, 3)."""
    shift = np.argmin(faces, axis=1)[:, None]
    return np.take_along_axis(faces, (np.arange(3)[None, :] + shift) % 3, axis=1)


def without_mirrored(faces: Ints) -> Bools:
    """Mask that keeps each face of a closed body once, if some are repeated with opposite winding.

    A body that is in the file twice, once inside out, has no volume. A sheet with two sides has
    none either, but one side of it is open: both are kept. A few small holes do not open a body.

    Args:
        faces: Welded faces (F, 3), none twice with the same winding.

    Returns:
        The faces to keep, shape (F,).
    """
    first, same = first_alike(np.sort(faces, axis=1))
    if len(first) == len(faces):
        return np.ones(len(faces), dtype=bool)
    once = faces[first]
    one, two = paired_edges(once)
    sheet = connected(len(once), one // 3, two // 3)
    mask = ~_is_body(once, sheet)[sheet[same]]
    mask[first] = True
    return mask


def _is_body(faces: Ints, sheet: Ints) -> Bools:
    """Mask of the sheets that are closed except for small holes, in any winding."""
    turn = disagreeing(faces)
    size = int(faces.max()) + 1
    apart = np.where(turn[:, None], faces[:, ::-1], faces) + sheet[:, None] * size
    edges = edges_of(apart)
    sheet_of_edge = edges.ends[:, 0] // size
    alone = np.bincount(sheet_of_edge[edges.faces == 1], minlength=int(sheet.max()) + 1)
    body = alone <= FEW * np.bincount(sheet_of_edge)
    body[[hole[0] // size for hole in holes_of(apart) if len(hole) > SMALL]] = False
    return np.asarray(body)


def disagreeing(faces: Ints) -> Bools:
    """Find the fewest faces to flip so that neighbours across an edge are wound alike.

    A graph has two nodes per face, as given and flipped, and links the nodes of neighbours that are
    wound alike. Its components come in pairs, one of which is the other one flipped.

    Args:
        faces: Welded faces (F, 3).

    Returns:
        The faces to flip (F,); none of surfaces with one side (Möbius strips).
    """
    count = len(faces)
    one, two = paired_edges(faces)
    against = ends_of(faces, one)[0] == ends_of(faces, two)[0]
    if not against.any():
        return np.zeros(count, dtype=bool)
    first, second = one // 3, two // 3
    other = np.where(against, count, 0)
    part = connected(
        2 * count,
        np.concatenate([first, first + count]),
        np.concatenate([second + other, second + count - other]),
    )
    as_is, flipped = part[:count], part[count:]
    size = np.bincount(as_is, minlength=int(part.max()) + 1)
    return np.asarray(2 * size[flipped] + (flipped < as_is) > 2 * size[as_is])


def ends_of(faces: Ints, half_edges: Ints) -> tuple[Ints, Ints]:
    """Start and end of half-edges, which are numbered by the corner opposite to them."""
    face, corner = np.divmod(half_edges, 3)
    return faces[face, (corner + 1) % 3], faces[face, (corner + 2) % 3]


def first_of_body(faces: Ints, first_vertex: Ints) -> Ints:
    """Join the vertices at one position, but not those of bodies that are separate in the file.

    Args:
        faces: Faces (F, 3) of the file.
        first_vertex: First vertex at the position of each vertex, shape (V,).

    Returns:
        First vertex with the position and the body of each vertex, shape (V,). A body is a
        component that is closed by the file's own indices; all other faces count as one body.
    """
    faces = faces[is_face(faces)]
    part, edges = parts_of(faces), edges_of(faces)
    closed = np.ones(int(part.max(initial=-1)) + 1, dtype=bool)
    closed[part[(edges.faces[edges.of_corner] != PAIR).any(axis=1)]] = False
    body = np.zeros(len(first_vertex), dtype=np.int64)
    body[faces] = np.where(closed, np.arange(1, len(closed) + 1), 0)[part][:, None]
    _, first, inverse = np.unique(
        first_vertex * (len(closed) + 1) + body, return_index=True, return_inverse=True
    )
    return np.asarray(first[inverse], dtype=np.int64)


def clusters(
    points: Floats, distance: float, *, loose: Bools | None = None, reach: float = 0.0
) -> Ints:
    """First point of each point's cluster, shape (V,); clusters are connected by small steps.

    Args:
        points: Positions (V, 3).
        distance: Longest step.
        loose: Points (V,) to and from which steps may be longer.
        reach: Longest such step.
    """
    pairs = cKDTree(points).query_pairs(max(distance, reach), output_type="ndarray")
    if loose is not None:
        length = np.linalg.norm(points[pairs[:, 0]] - points[pairs[:, 1]], axis=1)
        pairs = pairs[(length <= distance) | loose[pairs].any(axis=1)]
    return first_connected(len(points), *pairs.T)


def weld_nearby(points: Floats, faces: Ints, rounding: float) -> Ints:
    """Join vertices whose positions differ by rounding only, if that repairs some edges.

    Vertices within rounding of each other are joined first, then, within larger distances, those on
    edges without exactly two faces: at the smallest distance that leaves the fewest such edges. It
    must not collapse a face with an area, which would join the two sides of a thin plate. A sound
    surface is not changed.

    Args:
        points: Positions (V, 3) of a surface of size about 1.
        faces: Faces (F, 3) over one vertex per position.
        rounding: Largest error of a coordinate.

    Returns:
        Canonical vertex of each vertex, shape (V,).
    """
    best, uneven = np.arange(len(points)), _uneven_edges(faces)
    among, close = used_indices(faces), 4.0 * rounding
    for distance in (close, *(weld for weld in WELDS if weld > close)):
        joined = np.arange(len(points))
        joined[among] = among[clusters(points[among], distance)]
        joined = joined[best]
        lost = ~is_face(joined[faces])
        if not len(uneven) or has_area(points, faces[lost], rounding).any():
            break
        left = _uneven_edges(joined[faces])
        if len(left) < len(uneven):
            best, uneven = joined, left
        among = used_indices(uneven)
    return best


def _uneven_edges(faces: Ints) -> Ints:
    """Ends (k, 2) of the edges without exactly two faces; repeated faces count once."""
    faces = faces[is_face(faces)]
    first, _ = first_alike(np.sort(faces, axis=1))
    edges = edges_of(faces[first])
    return np.asarray(edges.ends[edges.faces != PAIR])


SMALL = 4
"""Edges of the largest small hole."""

LONG = 256
"""Edges of a hole above which it is closed in its mean plane instead of with the least area."""


def holes_of(faces: Ints) -> list[Ints]:
    """Find the holes as cycles of vertices, in the winding of the faces that close them.

    The open edges, with their directions, are the border of a surface: they always form closed
    cycles.

    Args:
        faces: Welded faces (F, 3).

    Returns:
        The vertices of each hole, each vertex once.
    """
    edges = edges_of(faces)
    times = np.abs(edges.balance)
    ends = np.where(edges.balance[:, None] > 0, edges.ends[:, ::-1], edges.ends)
    after: dict[int, list[int]] = {}
    for start, end in np.repeat(ends, times, axis=0).tolist():
        after.setdefault(start, []).append(end)
    return [cycle for start in after for cycle in _cycles_from(start, after)]


def close_hole(points: Floats, hole: Ints) -> Ints:
    """Faces that close a hole, shape (n - 2, 3): the triangulation with the smallest area.

    Barequet & Sharir 1995, by dynamic programming over the parts of the cycle, in O(n^3); very long
    holes are closed by clipping ears in their mean plane.

    Args:
        points: Positions (V, 3).
        hole: Vertices of the cycle (n,).
    """
    corners = points[hole] - points[hole].mean(axis=0)
    if len(hole) > LONG:
        return hole[_clipped(corners)]
    count = len(hole)
    area = np.zeros((count, count))
    best = np.zeros((count, count), dtype=np.int64)
    for gap in range(2, count):
        first = np.arange(count - gap)
        last = first + gap
        middle = first[:, None] + np.arange(1, gap)  # (count - gap, gap - 1)
        start, end = corners[first][:, None], corners[last][:, None]
        across = np.cross(corners[middle] - start, end - start)
        total = 0.5 * np.linalg.norm(across, axis=2)
        total += area[first[:, None], middle] + area[middle, last[:, None]]
        choice = np.argmin(total, axis=1)
        area[first, last] = np.take_along_axis(total, choice[:, None], axis=1)[:, 0]
        best[first, last] = middle[first, choice]
    return hole[_triangles(best)]


def _cycles_from(start: int, after: dict[int, list[int]]) -> list[Ints]:
    """Walk along unused edges from a vertex and split off a cycle where the walk meets itself."""
    cycles, walk, position = [], [start], {start: 0}
    while after[walk[-1]]:
        vertex = after[walk[-1]].pop()
        if vertex in position:
            begin = position[vertex]
            cycles.append(np.array(walk[begin:], dtype=np.int64))
            for dropped in walk[begin + 1 :]:
                del position[dropped]
            del walk[begin + 1 :]
        else:
            position[vertex] = len(walk)
            walk.append(vertex)
    return cycles


def _triangles(best: Ints) -> Ints:
    """Collect the triangles of the whole cycle from the best third corner of each part."""
    triangles, open_parts = [], [(0, len(best) - 1)]
    while open_parts:
        first, last = open_parts.pop()
        if last - first > 1:
            middle = int(best[first, last])
            triangles.append((first, middle, last))
            open_parts += [(first, middle), (middle, last)]
    return np.array(triangles, dtype=np.int64)


def _clipped(corners: Floats) -> Ints:
    """Triangulate a cycle (n, 3) in the plane in which it encloses the largest area."""
    across = np.cross(corners, np.roll(corners, -1, axis=0)).sum(axis=0)
    side, up = np.linalg.svd(across[None])[2][1:]
    if np.cross(side, up) @ across < 0.0:
        side = -side
    return np.asarray(manifold3d.triangulate([corners @ np.stack([side, up], axis=1)]))
