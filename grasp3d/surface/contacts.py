"""Contacts of grasps on a surface, with all the normals that each may have."""

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from grasp3d._kernels.normal_sets import HEMISPHERE
from grasp3d._kernels.surface_contacts import normals_at_all
from grasp3d.arrays import Bools, Floats, Ints, locked, unit_rows
from grasp3d.contact.contacts import Contacts
from grasp3d.mesh import ObjectMesh
from grasp3d.mesh.surface_points import SurfacePoints
from grasp3d.settings import GraspModel


@dataclass(frozen=True, eq=False)
class SurfaceContacts:
    """Contacts of grasps on a surface, and all the normals that each may have.

    Where the surface is smooth a contact has one normal; on creases and at corners it may have any
    of a convex set. Rows of `set_normals` follow the contacts in their order: those of contact i of
    grasp g are `set_start[n * g + i]` to `set_start[n * g + i + 1]`.
    """

    mesh: ObjectMesh
    surface_points: SurfacePoints
    """Where the fingers touch, shape (b, n); every contact is on a face."""

    @property
    def size(self) -> int:
        """Grasps."""
        return int(self.surface_points.faces.shape[0])

    @property
    def count(self) -> int:
        """Contacts of each grasp."""
        return int(self.surface_points.faces.shape[1])

    @cached_property
    def points(self) -> Floats:
        """Positions in the mesh's frame and unit, shape (b, n, 3)."""
        return locked(self.surface_points.positions(self.mesh))

    @cached_property
    def normals(self) -> Floats:
        """Inward unit normals, the middle of the set on creases, shape (b, n, 3).

        Zero where the normals cancel out: there is none to push along.
        """
        return locked(self._sets.middles.reshape(self.size, self.count, 3))

    @cached_property
    def set_start(self) -> Ints:
        """First row of each contact in `set_normals`, shape (b * n + 1,)."""
        return locked(self._sets.start)

    @cached_property
    def set_normals(self) -> Floats:
        """Inward unit normals (K, 3): one where smooth, else corners of convex sets, in order.

        Where a set spans every direction they are the normals of the faces there, in no order.
        """
        return locked(self._sets.normals)

    @cached_property
    def on_crease(self) -> Bools:
        """Tell the contacts that may have more than one normal, shape (b, n)."""
        several = (np.diff(self._sets.start) > 1).reshape(self.size, self.count)
        return locked(several | self.any_normal)

    @cached_property
    def any_normal(self) -> Bools:
        """Tell the contacts whose set spans every direction, shape (b, n)."""
        return locked((self._sets.counts == 0).reshape(self.size, self.count))

    def contacts(self, model: GraspModel) -> Contacts:
        """The contacts at their `normals`, relative to the mesh's centre of mass.

        Args:
            model: Friction and torsion.

        Raises:
            ContactError: The normals of a contact cancel out.
        """
        points = self.points - self.mesh.center_mass
        return Contacts(points, self.normals, model.friction, model.torsion_radius)

    def take(self, which: slice | Ints | Bools) -> "SurfaceContacts":
        """Some of the grasps."""
        surface_points = SurfacePoints(
            self.surface_points.faces[which], self.surface_points.weights[which]
        )
        return SurfaceContacts(self.mesh, surface_points)

    @cached_property
    def _sets(self) -> "_NormalSets":
        return _normal_sets_at(self.mesh, self.surface_points)


def vertex_surface_points(mesh: ObjectMesh, vertices: npt.ArrayLike) -> SurfacePoints:
    """Where vertices lie on the faces.

    Args:
        mesh: The surface.
        vertices: Numbers of vertices, any shape.

    Returns:
        Places of that shape: a face of each vertex, or of the one that stands for its position,
        with all the weight at it; face -1 where the vertex belongs to none.
    """
    face = np.full(len(mesh.vertices), -1, dtype=np.int64)
    corner = np.zeros(len(mesh.vertices), dtype=np.int64)
    face[mesh.faces[::-1]] = np.arange(len(mesh.faces))[::-1, None]  # the first face remains
    corner[mesh.faces[::-1]] = np.arange(3)
    canonical = mesh.canonical[np.asarray(vertices, dtype=np.int64)]
    return SurfacePoints(face[canonical], np.eye(3)[corner[canonical]])


class _NormalSets(NamedTuple):
    """Sets of normals at surface_points, in a flat batch (m,)."""

    start: Ints
    """First row of each in `normals` (m + 1,)."""
    normals: Floats
    """Unit normals (K, 3)."""
    counts: Ints
    """Corners of each set, 0 where it spans every direction (m,)."""
    middles: Floats
    """Unit normals in the middle of each, 0 where they cancel (m, 3)."""


def _normal_sets_at(mesh: ObjectMesh, surface_points: SurfacePoints) -> _NormalSets:
    """Look up the sets of vertices, and work out those on faces and edges."""
    faces = np.ascontiguousarray(surface_points.faces).ravel()
    weights = np.ascontiguousarray(surface_points.weights).reshape(-1, 3)
    sets = mesh.contact_normals
    counts, vertices = np.empty((2, len(faces)), dtype=np.int64)
    found = np.zeros((len(faces), 2, 3))
    normals_at_all(faces, weights, mesh.contact_surface, sets, counts, vertices, found)
    at_vertex = vertices >= 0
    all_there = np.where(sets.counts > 0, sets.counts, np.diff(sets.start))
    rows = np.where(at_vertex, all_there[vertices], np.maximum(counts, 1))
    first = np.where(at_vertex, sets.start[vertices], len(sets.normals) + 2 * np.arange(len(faces)))
    start = np.concatenate([[0], np.cumsum(rows)])
    which = np.arange(start[-1]) + np.repeat(first - start[:-1], rows)
    found[counts == 0] = unit_rows(found[counts == 0])
    normals = np.concatenate([sets.normals, found.reshape(-1, 3)])[which]
    middles = found[:, 0].copy()
    arcs = np.flatnonzero((counts == 2) & ~at_vertex)
    sums = found[arcs].sum(axis=1)
    middles[arcs] = unit_rows(sums)
    counts[arcs[np.linalg.norm(sums, axis=1) < 2.0 * HEMISPHERE]] = 0
    middles[at_vertex] = mesh.normals[vertices[at_vertex]]
    return _NormalSets(start, normals, counts, middles)
