"""Noisy copies of a surface, of the same faces with normals of their own; how noisy a scan is."""

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from grasp3d.arrays import Floats, Ints, locked, short_repr, unit_rows
from grasp3d.errors import MeshError
from grasp3d.mesh.measures import Triangles
from grasp3d.mesh.mesh_sources import MeshSource
from grasp3d.mesh.noise import noise_below_creases, noise_stream, normal_noise, random_field
from grasp3d.mesh.normals import CornerNormals, corner_normals, fingertip_normals
from grasp3d.mesh.object_mesh import ObjectMesh
from grasp3d.mesh.preparing import prepare
from grasp3d.mesh.refinement import longest_edge, refined_corners
from grasp3d.mesh.repair.work import RepairedSurface
from grasp3d.settings import MeshOptions

FIRST = 0.05
"""Standard deviation from which the estimate starts, in mean edges."""

MEASURING = 1
"""Number of the stream of random numbers."""

STEPS = 6
"""Most steps of the estimate; each multiplies it by a factor of at most `LARGEST`."""

LARGEST = 4.0
"""Largest factor of a step, as an estimate far off says little about the next."""

CLOSE = 0.02
"""Change of a step, as a fraction, at which the estimate ends; that of the noise is far larger."""

SMOOTH = math.radians(0.05)
"""Noise of normals below which a surface has none that can be measured [rad]."""


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

    def moved(self, shifts: Floats) -> ObjectMesh:
        """A copy of the mesh with moved vertices, and the contact normals that these give.

        Which edges are creases, and the patch of a fingertip, are determined anew; faces, repair
        and division of edges are the mesh's own. Mass properties are not computed again.

        Args:
            shifts: Displacements of `points`, in the mesh's unit, shape (n, 3).

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
            Triangles(vertices, faces), refined, normals, mesh.options, mesh.size
        )
        return replace(
            mesh,
            vertices=locked(mesh.from_normalized(refined.vertices)),
            corner_normals=normals.locked(),
        )

    @cached_property
    def _first_corner(self) -> tuple[Ints, Ints]:
        """The vertices that belong to faces, and one corner (3 f + i) of each."""
        used, first = np.unique(self.mesh.faces, return_index=True)
        return used, first

    def _all(self, vertices: Floats) -> Floats:
        """Positions of all vertices, from those of the repaired surface."""
        positions = np.zeros((len(self.mesh.vertices), 3))
        positions[: len(vertices)] = vertices
        used, corner = self._first_corner
        corners = vertices[self.repaired.faces[self.parents[corner // 3]]]  # (n, 3, 3)
        weights = self.weights.reshape(-1, 3)[corner]
        new = used >= len(vertices)
        positions[used[new]] = np.einsum("nk,nkc->nc", weights[new], corners[new])
        return positions

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


def movable_surface(source: MeshSource, options: MeshOptions | None = None) -> MovableSurface:
    """Read and prepare a mesh, as `load_mesh` does, so that its vertices can be moved.

    Args:
        source: A path or an object, as in `load_mesh`; the surface of an `ObjectMesh` is prepared
            again, with its own options if none are given.
        options: How the mesh is read and prepared; None: the defaults.

    Raises:
        MeshError: The mesh cannot be read, for the same reasons as in `load_mesh`.
        SettingError: An option is outside its range.
    """
    own = source.options if isinstance(source, ObjectMesh) else None
    settings = options or own or MeshOptions()
    prepared = prepare(source, settings)
    mesh, repaired = prepared.mesh, prepared.repaired
    surface = Triangles((repaired.vertices - mesh.center) / mesh.size, repaired.faces)
    edge = longest_edge(mesh.options, mesh.size)
    return MovableSurface(mesh, repaired, *refined_corners(surface, edge))


def noise_length(surface: MovableSurface, correlation: float = 0.0, *, seed: int = 0) -> float:
    """Estimate how far the vertices of a scan are off, along their normals.

    It is the noise that must be added to the surface so that its roughness (`normal_noise`) grows
    by a factor of sqrt(2), as independent errors add up by their squares. What of the noise the
    roughness does not contain, since neighbours have the same error, cancels out.

    Args:
        surface: The scan.
        correlation: Correlation length of the errors, in the mesh's unit; see `random_field`. Of
            errors that are correlated over several edges the surface shows too little: give 0, or a
            few edges at most.
        seed: Seed of the noise that is added.

    Returns:
        Standard deviation of the errors along the normals, in the mesh's unit.

    Raises:
        MeshError: The surface is so smooth that it has no noise that can be measured.

    Example:
        >>> import numpy as np
        >>> import trimesh
        >>> from grasp3d.mesh.noisy_copies import movable_surface, noise_length
        >>> ball = trimesh.creation.icosphere(4)
        >>> errors = np.random.default_rng(1).normal(0.0, 0.005, len(ball.vertices))
        >>> scan = movable_surface((ball.vertices * (1.0 + errors)[:, None], ball.faces))
        >>> 0.0045 < noise_length(scan) < 0.0055
        True
    """
    points = (surface.points - surface.mesh.center) / surface.mesh.size
    faces = np.searchsorted(np.unique(surface.repaired.faces), surface.repaired.faces)
    own, crease = normal_noise(Triangles(points, faces))
    if own < SMOOTH:
        raise MeshError(
            f"{surface.mesh.report.source}: the surface has no noise that can be measured; state "
            "that of the scanner (--noise, in Python noise=...)"
        )
    reach = correlation / surface.mesh.size
    field = random_field(points, surface.normals, reach, noise_stream(seed, MEASURING))
    errors = field[:, None] * surface.normals
    sigma = FIRST * surface.mean_edge / surface.mesh.size
    for _ in range(STEPS):
        rough = noise_below_creases(Triangles(points + sigma * errors, faces), crease)
        added = math.sqrt(max(rough**2 - own**2, 0.0))
        factor = min(max(own / added if added else LARGEST, 1.0 / LARGEST), LARGEST)
        sigma *= factor
        if abs(factor - 1.0) < CLOSE:
            break
    return sigma * surface.mesh.size
