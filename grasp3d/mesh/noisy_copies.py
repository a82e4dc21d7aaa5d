"""Copies of a surface with moved vertices: the same faces, with contact normals of their own."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from grasp3d.arrays import Floats, Ints, locked, short_repr, unit_rows
from grasp3d.mesh.measures import Triangles
from grasp3d.mesh.mesh_sources import MeshSource
from grasp3d.mesh.normals import CornerNormals, corner_normals
from grasp3d.mesh.object_mesh import ObjectMesh
from grasp3d.mesh.patches import fingertip_normals
from grasp3d.mesh.preparing import prepare
from grasp3d.mesh.refinement import longest_edge, refined_corners
from grasp3d.mesh.repair import RepairedSurface
from grasp3d.settings import MeshOptions


@dataclass(frozen=True, eq=False)
class MovableSurface:
    """A surface whose own vertices can be moved; those that divide long edges follow them.

    Example:
        >>> import numpy as np
        >>> import trimesh
        >>> from grasp3d.mesh.noisy_copies import movable_surface
        >>> surface = movable_surface(trimesh.creation.box([4.0, 3.0, 2.0]))
        >>> surface.points.shape, len(surface.mesh.vertices) > 8
        ((8, 3), True)
        >>> copy = surface.moved(0.01 * np.random.default_rng(0).normal(size=(8, 3)))
        >>> copy.vertices.shape == surface.mesh.vertices.shape
        True
    """

    mesh: ObjectMesh
    """The surface as it is."""
    repaired: RepairedSurface
    """The same before long edges are divided, in the mesh's frame and unit."""
    parents: Ints
    """The face of `repaired` on which each face of the mesh lies, shape (F,)."""
    weights: Floats
    """Barycentric coordinates of its three corners there, shape (F, 3, 3)."""

    __repr__ = short_repr

    @cached_property
    def points(self) -> Floats:
        """The vertices that can be moved, in the mesh's frame and unit, shape (n, 3).

        Those at the same position, and those that belong to no face, are left out.
        """
        return locked(self.repaired.vertices[self._own])

    @cached_property
    def normals(self) -> Floats:
        """Inward unit normals there, shape (n, 3)."""
        return locked(self.mesh.normals[self._own])

    @cached_property
    def mean_edge(self) -> float:
        """Mean length of the edges between these vertices, in the mesh's unit."""
        corners = self.repaired.vertices[self.repaired.faces]
        return float(np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).mean())

    @cached_property
    def _own(self) -> Ints:
        return np.unique(self.repaired.faces)

    @cached_property
    def _first_corner(self) -> tuple[Ints, Ints]:
        """The vertices that belong to faces, and one corner (3 f + i) of each."""
        used, first = np.unique(self.mesh.faces, return_index=True)
        return used, first

    def moved(self, shifts: Floats, *, threads: int | None = None) -> ObjectMesh:
        """A copy of the mesh with moved vertices, and the contact normals that these give.

        Which edges are creases, and the patch of a fingertip, are determined anew; faces, repair
        and division of edges are the mesh's own. Mass properties are not computed again.

        Args:
            shifts: Displacements of `points`, in the mesh's unit, shape (n, 3).
            threads: Threads to use; None: one per processor.

        Returns:
            The copy; its arrays correspond to those of the mesh, row by row.
        """
        mesh, repaired, faces = self.mesh, self.repaired, self.repaired.faces
        vertices = repaired.vertices.copy()
        vertices[self._own] += shifts
        vertices = vertices[repaired.canonical]
        normalized = Triangles((vertices - mesh.center) / mesh.size, faces)
        normals = self._divided(corner_normals(normalized, mesh.options.crease_angle))
        refined = Triangles(self._all(normalized.vertices), mesh.faces)
        normals, _ = fingertip_normals(
            Triangles(vertices, faces), refined, normals, mesh.options, mesh.size, threads=threads
        )
        return replace(
            mesh,
            vertices=locked(mesh.from_normalized(refined.vertices)),
            corner_normals=normals.locked(),
        )

    def _all(self, vertices: Floats) -> Floats:
        """Positions of all vertices, from those of the repaired surface."""
        positions = np.concatenate([vertices, np.zeros((self._added, 3))])
        used, corner = self._first_corner
        corners = vertices[self.repaired.faces[self.parents[corner // 3]]]  # (n, 3, 3)
        weights = self.weights.reshape(-1, 3)[corner]
        new = used >= len(vertices)
        positions[used[new]] = np.einsum("nk,nkc->nc", weights[new], corners[new])
        return positions

    @property
    def _added(self) -> int:
        return len(self.mesh.vertices) - len(self.repaired.vertices)

    def _divided(self, normals: CornerNormals) -> CornerNormals:
        """Interpolate corner normals of the repaired surface, as the division of edges does."""
        rows = np.where(self.weights > 0.0, normals.corners[self.parents][:, None], -1)
        # Corners at one vertex that lie between the same normals share one; so do own vertices.
        low, middle, high = np.sort(rows, axis=2).reshape(-1, 3).T
        vertex = self.mesh.faces.ravel()
        order = np.lexsort((low, middle, high, vertex))
        keys = np.stack([low, middle, high, vertex], axis=1)[order]
        new = np.concatenate([[True], (keys[1:] != keys[:-1]).any(axis=1)])
        number = np.empty(len(order), dtype=np.int64)
        number[order] = np.cumsum(new) - 1
        first = order[new]
        corners = normals.normals[normals.corners[self.parents[first // 3]]]  # (C, 3, 3)
        weights = self.weights.reshape(-1, 3)[first]
        mixed = np.einsum("nk,nkc->nc", weights, corners)
        return CornerNormals(number.reshape(-1, 3), unit_rows(mixed), vertex[first])


def movable_surface(
    source: MeshSource, options: MeshOptions | None = None, *, threads: int | None = None
) -> MovableSurface:
    """Read and prepare a mesh, as `load_mesh` does, so that its vertices can be moved.

    Args:
        source: A path or an object, as in `load_mesh`; the surface of an `ObjectMesh` is prepared
            again, with its own options if none are given.
        options: How the mesh is read and prepared; None: the defaults.
        threads: Threads to use; None: one per processor.

    Raises:
        MeshError: The mesh cannot be read, for the same reasons as in `load_mesh`.
        SettingError: An option is outside its range.
    """
    own = source.options if isinstance(source, ObjectMesh) else None
    chosen = options or own or MeshOptions()
    found = prepare(source, chosen, threads=threads)
    mesh, repaired = found.mesh, found.repaired
    surface = Triangles((repaired.vertices - mesh.center) / mesh.size, repaired.faces)
    edge = longest_edge(mesh.options, mesh.size)
    return MovableSurface(mesh, repaired, *refined_corners(surface, edge))
