"""Hole filling: cycles of open edges, and a triangulation of least area for each."""

import manifold3d
import numpy as np

from grasp3d.arrays import Floats, Ints
from grasp3d.mesh.measures import edges_of

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
