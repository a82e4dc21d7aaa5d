"""Areas, angles, volumes, components, edges and rounding of plain vertex and face arrays.

`Triangles` computes each quantity of a surface once.
"""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from grasp3d.arrays import Bools, Floats, Ints, short_repr, unit_rows, used_indices


class Edges(NamedTuple):
    """The undirected edges of some faces."""

    ends: Ints
    """Vertices of each edge, the smaller index first, shape (E, 2)."""
    faces: Ints
    """Number of faces at each edge, shape (E,)."""
    balance: Ints
    """Number of faces that run from the smaller to the larger index minus those that run back."""
    of_corner: Ints
    """Edge from each corner of each face to the next, shape (F, 3)."""


def face_areas(vertices: Floats, faces: Ints) -> Floats:
    """Areas of the faces, shape (F,)."""
    a, b, c = vertices[faces].swapaxes(0, 1)
    return np.asarray(0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1))


def part_volumes(vertices: Floats, faces: Ints, part: Ints) -> Floats:
    """Volumes of closed components, each computed about one of its vertices to stay exact.

    Args:
        vertices: Positions (V, 3).
        faces: Faces (F, 3).
        part: Component of each face, counted from 0, shape (F,).

    Returns:
        One volume per component; meaningless for open components.
    """
    _, first = np.unique(part, return_index=True)
    a, b, c = np.moveaxis(vertices[faces] - vertices[faces[first, 0]][part][:, None], 1, 0)
    pieces = np.einsum("ij,ij->i", a, np.cross(b, c)) / 6.0
    return np.asarray(np.bincount(part, pieces), dtype=np.float64)


def surface_extent(vertices: Floats, faces: Ints) -> tuple[Floats, float]:
    """Centre of a surface's area, and diameter of the ball about it that contains the surface.

    Args:
        vertices: Positions (V, 3).
        faces: Faces (F, 3), at least one with an area.
    """
    middle = vertices[faces].mean(axis=(0, 1))
    centred = vertices - middle
    area = face_areas(centred, faces)
    offset = (centred[faces].mean(axis=1) * area[:, None]).sum(axis=0) / area.sum()
    radius = np.linalg.norm(vertices[used_indices(faces)] - middle - offset, axis=1).max()
    return middle + offset, float(2.0 * radius)


def edges_of(faces: Ints) -> Edges:
    """Find the undirected edges of faces (F, 3)."""
    start, end = faces, np.roll(faces, -1, axis=1)
    low, high = np.minimum(start, end), np.maximum(start, end)
    size = int(faces.max(initial=0)) + 1
    keys, inverse = np.unique(low * size + high, return_inverse=True)
    of_corner = inverse.reshape(-1, 3)
    direction = np.where(start < end, 1.0, -1.0)
    count = np.bincount(of_corner.ravel(), minlength=len(keys))
    balance = np.bincount(of_corner.ravel(), direction.ravel(), minlength=len(keys))
    ends = np.stack([keys // size, keys % size], axis=1)
    return Edges(ends, count.astype(np.int64), balance.astype(np.int64), of_corner)


def paired_edges(faces: Ints) -> tuple[Ints, Ints]:
    """Pair the half-edges that lie on one undirected edge with exactly two faces.

    Half-edge 3 f + i of face f lies opposite its corner i.

    Returns:
        The first and the second half-edge of each pair, (E,) each.
    """
    order, first, size = _by_edge(faces)
    pairs = first[size == 2]
    return order[pairs], order[pairs + 1]


def crowded_edges(faces: Ints) -> Ints:
    """Half-edges that lie on an undirected edge with more than two faces."""
    order, _, size = _by_edge(faces)
    return order[np.repeat(size, size) > 2]


def _by_edge(faces: Ints) -> tuple[Ints, Ints, Ints]:
    """Half-edges ordered by their edge; the first of each edge, and its number of half-edges.

    Half-edges of one edge are in ascending order.
    """
    start, end = faces[:, [1, 2, 0]].ravel(), faces[:, [2, 0, 1]].ravel()
    keys = np.minimum(start, end) * (int(faces.max(initial=0)) + 1) + np.maximum(start, end)
    order = np.argsort(keys, kind="stable")
    _, first, size = np.unique(keys[order], return_index=True, return_counts=True)
    return order, first, size


def edge_counts(faces: Ints) -> tuple[int, int]:
    """Count the edges with one face, and the edges with more than two.

    A surface is watertight in the strict sense, every edge with exactly two faces, when both are 0
    and the faces are wound alike.
    """
    count = edges_of(faces).faces
    return int((count == 1).sum()), int((count > 2).sum())


def is_closed(faces: Ints) -> bool:
    """Return whether equally many faces run along every edge in both directions.

    Then the signed volume does not depend on the origin, even where more than two faces meet.
    """
    return not edges_of(faces).balance.any()


def center_and_volume(surface: "Triangles") -> tuple[Floats, float]:
    """Centre of mass at uniform density, and volume; for an open surface centre of area, and nan.

    The volume is negative where the faces are oriented inward.
    """
    corners, areas = surface.vertices[surface.faces], surface.areas
    volume = float(surface.volumes.sum()) if is_closed(surface.faces) else math.nan
    if not abs(volume) > 0.0:
        return (areas[:, None] * corners.mean(axis=1)).sum(axis=0) / areas.sum(), volume
    weighted = surface.volumes[:, None] * (corners.sum(axis=1) / 4.0)
    return weighted.sum(axis=0) / volume, volume


def connected(count: int, one: Ints, two: Ints) -> Ints:
    """Number of the connected component of each node of a graph, shape (count,).

    Args:
        count: Number of nodes.
        one: The first node of each link, any shape.
        two: The second node of each link, same shape.
    """
    ends = one.ravel(), two.ravel()
    links = coo_array((np.ones(one.size, dtype=np.int8), ends), shape=(count, count))
    _, part = connected_components(links, directed=False)
    return np.asarray(part, dtype=np.int64)


def first_connected(count: int, one: Ints, two: Ints) -> Ints:
    """The first node of each node's connected component, shape (count,); see `connected`."""
    part = connected(count, one, two)
    _, first, inverse = np.unique(part, return_index=True, return_inverse=True)
    return np.asarray(first[inverse], dtype=np.int64)


def parts_of(faces: Ints) -> Ints:
    """Connected component of each face, shape (F,); faces that share a vertex are connected."""
    part = connected(int(faces.max(initial=-1)) + 1, faces[:, [0, 1]], faces[:, [1, 2]])
    _, numbered = np.unique(part[faces[:, 0]], return_inverse=True)
    return np.asarray(numbered, dtype=np.int64).ravel()


def rounding_of(vertices: Floats) -> float:
    """Largest rounding error of a coordinate: that of 32 bits if all are exact in 32 bits."""
    single = np.array_equal(vertices, vertices.astype(np.float32))
    step = np.finfo(np.float32 if single else np.float64).eps
    return float(step * np.abs(vertices).max(initial=0.0))


def has_area(vertices: Floats, faces: Ints, rounding: float) -> Bools:
    """Mark the faces that have an area, shape (F,).

    A face (a needle or a cap) has no area when its height is within the rounding of its
    coordinates: its normal is then undefined.

    Args:
        vertices: Positions (V, 3).
        faces: Faces (F, 3).
        rounding: Largest error of a coordinate, in the same unit.
    """
    corners = vertices[faces]  # (F, 3 corners, 3)
    sides = np.roll(corners, -1, axis=1) - corners
    longest = np.linalg.norm(sides, axis=2).max(axis=1)
    doubled = np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1)
    height = np.divide(doubled, longest, out=np.zeros_like(doubled), where=longest > 0.0)
    return np.asarray(height > 4.0 * rounding)


@dataclass(frozen=True, eq=False)
class Triangles:
    """A surface of triangles, counter-clockwise from outside."""

    vertices: Floats
    """Positions (V, 3)."""
    faces: Ints
    """Shape (F, 3)."""

    __repr__ = short_repr

    @cached_property
    def used(self) -> Ints:
        """Vertices that belong to faces, in ascending order."""
        return used_indices(self.faces)

    @cached_property
    def areas(self) -> Floats:
        """Areas of the faces, shape (F,)."""
        return face_areas(self.vertices, self.faces)

    @cached_property
    def volumes(self) -> Floats:
        """Volumes of the tetrahedra from the origin to each face, shape (F,)."""
        a, b, c = self.vertices[self.faces].swapaxes(0, 1)
        return np.asarray(np.einsum("ij,ij->i", a, np.cross(b, c)) / 6.0)

    @cached_property
    def normals(self) -> Floats:
        """Inward unit normals of the faces, shape (F, 3)."""
        a, b, c = self.vertices[self.faces].swapaxes(0, 1)
        return unit_rows(np.cross(c - a, b - a))

    @cached_property
    def angles(self) -> Floats:
        """Angle of each face at each of its corners [rad], shape (F, 3)."""
        corners = self.vertices[self.faces]
        after = np.roll(corners, -1, axis=1) - corners
        before = np.roll(corners, 1, axis=1) - corners
        sine = np.linalg.norm(np.cross(after, before), axis=2)
        return np.asarray(np.arctan2(sine, np.einsum("fij,fij->fi", after, before)))

    @cached_property
    def pairs(self) -> tuple[Ints, Ints]:
        """Both half-edges of each edge with exactly two faces; see `measures.paired_edges`."""
        return paired_edges(self.faces)

    @cached_property
    def bends(self) -> Floats:
        """Angle between the normals of the two faces at each edge in `pairs` [rad]."""
        one, two = self.pairs
        a, b = self.normals[one // 3], self.normals[two // 3]
        sine = np.linalg.norm(np.cross(a, b), axis=1)
        return np.asarray(np.arctan2(sine, np.einsum("ij,ij->i", a, b)))
