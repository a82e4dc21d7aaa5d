"""Triangles with what follows from their shape, each quantity computed once."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from grasp3d.arrays import Floats, Ints, short_repr, used_indices
from grasp3d.mesh.measures import (
    corner_angles,
    face_areas,
    inward_normals,
    paired_edges,
    signed_volumes,
)


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
        return signed_volumes(self.vertices, self.faces)

    @cached_property
    def normals(self) -> Floats:
        """Inward unit normals of the faces, shape (F, 3)."""
        return inward_normals(self.vertices, self.faces)

    @cached_property
    def angles(self) -> Floats:
        """Angle of each face at each of its corners [rad], shape (F, 3)."""
        return corner_angles(self.vertices, self.faces)

    @cached_property
    def sides(self) -> Floats:
        """Length of the side opposite each corner, shape (F, 3)."""
        corners = self.vertices[self.faces]
        across = np.roll(corners, -2, axis=1) - np.roll(corners, -1, axis=1)
        return np.ascontiguousarray(np.linalg.norm(across, axis=2))

    @cached_property
    def pairs(self) -> tuple[Ints, Ints]:
        """Both half-edges of each edge with exactly two faces; see `measures.paired_edges`."""
        return paired_edges(self.faces)

    @cached_property
    def bends(self) -> Floats:
        """Angle between the normals of the faces of each of these edges [rad]."""
        one, two = self.pairs
        a, b = self.normals[one // 3], self.normals[two // 3]
        sine = np.linalg.norm(np.cross(a, b), axis=1)
        return np.asarray(np.arctan2(sine, np.einsum("ij,ij->i", a, b)))
