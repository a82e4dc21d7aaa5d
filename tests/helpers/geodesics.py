"""Oracle of geodesic distances and of patches about a vertex, slow and simple; test surfaces."""

from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import ConvexHull, Delaunay

from tests.helpers.shapes import Surface

Floats = NDArray[np.float64]

EDGE_POINTS, DIVISIONS = 8, 12
"""Points added on every edge, and segments that every side of a face is divided into."""


class EdgeGraph(NamedTuple):
    """Graph of points on the edges of a surface; paths are straight within a face."""

    surface: Surface
    points: Floats
    nodes: NDArray[np.int64]
    """Indices of the points on each face."""
    lengths: csr_array
    """Lengths of the straight lines between points of a face."""

    @classmethod
    def of(cls, surface: Surface) -> "EdgeGraph":
        points, nodes = graph_nodes(*surface)
        pairs = np.indices((nodes.shape[1],) * 2).reshape(2, -1)
        ends = np.sort(nodes[:, pairs].transpose(1, 0, 2).reshape(2, -1), axis=0)
        one, two = np.unique(ends[:, ends[0] != ends[1]], axis=1)
        lengths = np.linalg.norm(points[one] - points[two], axis=1)
        graph = coo_array((lengths, (one, two)), shape=(len(points),) * 2)
        return cls(surface, points, nodes, graph.tocsr())

    def patch(self, source: int, radius: float) -> tuple[Floats, float]:
        """Inward area vector and area of the surface within a distance of a vertex.

        Faces are divided into small triangles; each is inside or outside by its centre.
        """
        vertices, faces = self.surface
        distances = dijkstra(self.lengths, directed=False, indices=source, limit=radius)
        vector, area = np.zeros(3), 0.0
        for face in np.flatnonzero((distances[self.nodes] < radius).any(axis=1)):
            a, b, c = vertices[faces[face]]
            normal = 0.5 * np.cross(c - a, b - a)
            face_nodes = self.nodes[face]
            samples = small_triangles() @ vertices[faces[face]]
            reached = (
                np.linalg.norm(samples[:, None] - self.points[face_nodes], axis=2)
                + distances[face_nodes]
            )
            fraction = float((reached.min(axis=1) < radius).mean())
            vector += fraction * normal
            area += fraction * float(np.linalg.norm(normal))
        return vector, area


def graph_nodes(vertices: Floats, faces: NDArray[np.int64]) -> tuple[Floats, NDArray[np.int64]]:
    """(points, nodes): the vertices and the points on the edges, and the indices on each face."""
    sides = np.stack([faces[:, [1, 2]], faces[:, [2, 0]], faces[:, [0, 1]]], axis=1)  # (F, 3, 2)
    edges, number = np.unique(np.sort(sides, axis=2).reshape(-1, 2), axis=0, return_inverse=True)
    fractions = np.arange(1, EDGE_POINTS + 1)[:, None] / (EDGE_POINTS + 1)
    between = vertices[edges[:, :1]] * (1.0 - fractions) + vertices[edges[:, 1:]] * fractions
    inner = len(vertices) + number.reshape(-1, 3, 1) * EDGE_POINTS + np.arange(EDGE_POINTS)
    points = np.concatenate([vertices, between.reshape(-1, 3)])
    return points, np.hstack([faces, inner.reshape(len(faces), -1)])


@cache
def small_triangles() -> Floats:
    """Barycentric coordinates of the centres of equal parts of a triangle."""
    rows = []
    for i in range(DIVISIONS):
        for j in range(DIVISIONS - i):
            rows.append((i + 1 / 3, j + 1 / 3))
            if i + j < DIVISIONS - 1:
                rows.append((i + 2 / 3, j + 2 / 3))
    first = np.array(rows) / DIVISIONS
    return np.column_stack([first, 1.0 - first.sum(axis=1)])


def sheet(count: int, seed: int, stretch: float = 1.0) -> Surface:
    """A square from 0 to 1 in the xy-plane, facing up, with random vertices."""
    border = np.array(np.meshgrid(*[np.linspace(0.0, 1.0, 9)] * 2)).reshape(2, -1).T
    inner = np.random.default_rng(seed).random((count, 2))
    return triangulated(np.concatenate([inner, border]), stretch)


def bent_sheet(seed: int, angle: float) -> Surface:
    """The same with its half beyond y = 0.5 folded upward by an angle."""
    steps = np.linspace(0.0, 1.0, 21)
    lines = [np.column_stack([steps, np.full(21, y)]) for y in (0.0, 0.5, 1.0)]
    lines += [line[:, ::-1] for line in lines[::2]]
    inner = np.random.default_rng(seed).random((400, 2))
    apart = np.abs(inner[:, 1] - 0.5) > 0.03  # the fold then consists of edges
    flat, faces = triangulated(np.unique(np.concatenate([inner[apart], *lines]), axis=0))
    beyond = np.maximum(flat[:, 1] - 0.5, 0.0)
    of = np.minimum(flat[:, 1], 0.5) + beyond * np.cos(angle)
    return np.column_stack([flat[:, 0], of, beyond * np.sin(angle)]), faces


def triangulated(flat: Floats, stretch: float = 1.0) -> Surface:
    """Delaunay triangles of points (n, 2) in the xy-plane, facing up.

    With `stretch` they are needles: the triangulation of the points stretched along y.
    """
    faces = Delaunay(flat * (1.0, stretch)).simplices.astype(np.int64)
    a, b, c = flat[faces].swapaxes(0, 1)
    doubled = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]
    faces[doubled < 0.0] = faces[doubled < 0.0, ::-1]
    return np.column_stack([flat, np.zeros(len(flat))]), faces[np.abs(doubled) > 1e-12]


def random_ball(count: int, seed: int) -> Surface:
    """A ball of radius 1 with random vertices."""
    points = np.random.default_rng(seed).normal(size=(count, 3))
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    faces = ConvexHull(points).simplices.astype(np.int64)
    a, b, c = points[faces].swapaxes(0, 1)
    inward = np.einsum("ij,ij->i", np.cross(b - a, c - a), a) < 0.0
    faces[inward] = faces[inward, ::-1]
    return points, faces
