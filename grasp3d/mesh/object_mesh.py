"""ObjectMesh, the surface that contacts lie on, and the report of how it was made."""

from dataclasses import dataclass, replace
from functools import cached_property
from importlib import import_module
from typing import TYPE_CHECKING, Any

import numpy as np

from grasp3d._kernels.hands.touched_surface import TouchedSurface
from grasp3d._kernels.surface.box_tree import BoxTree, box_tree
from grasp3d._kernels.surface.face_tree import FaceTree, face_tree
from grasp3d._kernels.surface.surface_contacts import ContactNormals, Surface
from grasp3d.arrays import Bools, Floats, Ints, locked, short_repr, unit_rows, used_indices
from grasp3d.mesh.measures import face_areas, paired_edges
from grasp3d.mesh.normals import CornerNormals, NormalSets, crease_twins, normal_sets
from grasp3d.mesh.repair.work import RepairStep
from grasp3d.mesh.touched_surface import touched_surface
from grasp3d.settings import MeshOptions
from grasp3d.settings.lengths import (
    METRES,
    GivenLength,
    SettingsTs,
    Unit,
    length_in_unit,
    settings_in_unit,
)

if TYPE_CHECKING:
    import pyvista
    import trimesh


@dataclass(frozen=True)
class MeshReport:
    """What a mesh file contained and how it was repaired."""

    source: str
    """Name of the file, the type of another library's object ('trimesh.Trimesh'), or 'arrays'."""
    format: str
    """Suffix of the file, name of the other library ('trimesh'), or 'arrays'."""
    unit: Unit | None
    """Unit of positions and openings; None if neither the file nor the user states it."""
    file_vertices: int
    file_faces: int
    vertices: int
    """Vertices after refinement, the file's own included."""
    faces: int
    """Faces after cleaning and refinement."""
    bodies: int
    closed: bool
    """Whether the faces bound a volume: equally many run along every edge in both directions."""
    center_mass_from: str
    """'volume' (uniform density) or, if the mesh is open, 'surface'; or 'given'."""
    repairs: tuple[RepairStep, ...]
    """What was changed; one sentence each as text."""
    warnings: tuple[str, ...]
    """What may make the labels wrong, one sentence each."""


@dataclass(frozen=True, eq=False)
class ObjectMesh:
    """An object's surface, with the normals that a contact may have at each surface point.

    Positions are in the file's own unit and frame; normals point into the object.

    Example:
        >>> import trimesh
        >>> import grasp3d
        >>> mesh = grasp3d.load_mesh(trimesh.creation.box([4.0, 3.0, 2.0]), unit="cm", max_edge=9.0)
        >>> mesh.vertices.shape, mesh.faces.shape, round(mesh.volume, 6), mesh.unit
        ((8, 3), (12, 3), 24.0, 'cm')
        >>> mesh.to_trimesh().units
        'cm'
    """

    vertices: Floats
    """Shape (V, 3): the file's vertices in their own order, then those added by refinement."""
    faces: Ints
    """Shape (F, 3), counter-clockwise from outside; they use canonical vertices only."""
    canonical: Ints
    """Canonical vertex of each vertex, the one used for its position, shape (V,)."""
    file_vertices: int
    """Number of vertices in the file; they come first."""
    corner_normals: CornerNormals
    center: Floats
    """Centre of the surface, shape (3,): origin of the normalised frame."""
    size: float
    """Diameter of the ball about `center` around the surface: unit of the normalised frame."""
    center_mass: Floats
    """Centre of mass, at uniform density unless it is given, shape (3,)."""
    volume: float
    """Enclosed volume; nan if the surface is open."""
    options: MeshOptions
    """How the mesh was read and prepared."""
    report: MeshReport
    region: Bools | None = None
    """Mask of the vertices in the part of the surface where contacts may be, by the option
    `region`, shape (V,); None: all of it."""

    __repr__ = short_repr

    @property
    def unit(self) -> Unit | None:
        """Unit of positions and openings."""
        return self.report.unit

    def in_own_unit(self, *settings: *SettingsTs) -> tuple[*SettingsTs]:
        """Settings with every length as a number in the mesh's unit.

        Args:
            settings: Settings, or None, which stays None.

        Raises:
            SettingError: A length has a unit, but that of the mesh is not known.
        """
        return settings_in_unit(self.unit, *settings, source=self.report.source)

    def length(self, name: str, value: GivenLength) -> float:
        """A length as a number in the mesh's unit.

        Args:
            name: Name of the setting, for the error.
            value: A number in that unit, or a length with a unit.

        Raises:
            SettingError: It is no length, or has a unit, but that of the mesh is not known.
        """
        number = length_in_unit(name, value, self.unit, source=self.report.source)
        return float(number)

    @cached_property
    def on_surface(self) -> Bools:
        """Mask of the vertices whose position belongs to a face, shape (V,)."""
        mask = np.zeros(len(self.vertices), dtype=bool)
        mask[self.faces] = True
        return locked(mask[self.canonical])

    @cached_property
    def allowed(self) -> Bools:
        """Mask of the vertices on the surface where contacts may be, shape (V,)."""
        return self.on_surface if self.region is None else locked(self.on_surface & self.region)

    @cached_property
    def contact_vertices(self) -> Ints:
        """Canonical vertices on the surface where contacts may be."""
        used = used_indices(self.faces)
        return locked(used[self.allowed[used]])

    @cached_property
    def contact_faces(self) -> Ints:
        """Faces in which contacts may be: all of their corners are allowed."""
        return locked(np.flatnonzero(self.allowed[self.faces].all(axis=1)))

    @cached_property
    def allowed_fraction(self) -> float:
        """Area fraction of the surface where contacts may be."""
        return float(self.vertex_areas.sum()) / self.area

    @cached_property
    def area(self) -> float:
        """Area of the whole surface."""
        return float(face_areas(self.vertices, self.faces).sum())

    @property
    def region_notes(self) -> tuple[str, ...]:
        """A sentence on the part of the surface where contacts may be; empty: all of it."""
        if self.region is None:
            return ()
        share = f"{100.0 * self.allowed_fraction:.3g} %"
        return (f"contacts may be on {share} of the surface only, of which fractions are stated",)

    @cached_property
    def normal_sets(self) -> NormalSets:
        """All normals that a contact at each vertex may have."""
        return normal_sets(len(self.vertices), self.corner_normals)

    @cached_property
    def normals(self) -> Floats:
        """Inward unit normal at each vertex, the middle of its set at creases, shape (V, 3)."""
        return locked(unit_rows(self.normal_sets.centres)[self.canonical])

    @cached_property
    def vertex_areas(self) -> Floats:
        """A third of the area around each vertex, shape (V,).

        Duplicates, and vertices where no contact may be, count as zero.
        """
        third = face_areas(self.vertices, self.faces) / 3.0
        areas = np.zeros(len(self.vertices))
        np.add.at(areas, self.faces, third[:, None])
        return locked(areas * self.allowed)

    @cached_property
    def crease_fraction(self) -> float:
        """Area fraction of the vertices on creases; it shrinks on a finer mesh."""
        on_crease = self.normal_sets.counts != 1
        return float(self.vertex_areas[on_crease].sum() / self.vertex_areas.sum())

    @cached_property
    def torque_scale(self) -> float:
        """Largest distance of a surface vertex from the centre of mass (rho)."""
        used = self.vertices[used_indices(self.faces)]
        return float(np.linalg.norm(used - self.center_mass, axis=1).max())

    @cached_property
    def normalized(self) -> Floats:
        """Positions centred and divided by `size`, shape (V, 3)."""
        return locked((self.vertices - self.center) / self.size)

    @cached_property
    def contact_normals(self) -> ContactNormals:
        """The vertices' normal sets, as the kernels take them."""
        return ContactNormals(
            self.normal_sets.start, self.normal_sets.counts, self.normal_sets.normals
        )

    @cached_property
    def contact_surface(self) -> Surface:
        """The surface in the normalised frame, as the kernels take it."""
        corners, normals = self.corner_normals, self.corner_normals.normals
        twins = crease_twins(self.faces, corners.corners)
        if self.region is not None:
            # A crease is searched with the face of the lower row: at the border with that inside.
            inside = np.isin(np.arange(len(self.faces)), self.contact_faces)
            pairs, rows = paired_edges(self.faces), twins.reshape(-1, 2)
            one, two = np.concatenate(pairs), np.concatenate(pairs[::-1])
            border = one[inside[one // 3] & ~inside[two // 3] & (rows[one, 0] >= 0)]
            copies = normals[rows[border]].reshape(-1, 3)
            rows[border] = len(normals) + np.arange(len(copies)).reshape(-1, 2)
            normals = locked(np.concatenate([normals, copies]))
        return Surface(
            points=np.ascontiguousarray(self.normalized),
            faces=self.faces,
            corners=corners.corners,
            normals=normals,
            twins=twins,
        )

    @cached_property
    def boxes(self) -> BoxTree:
        """The faces in the normalised frame as a tree: what is near a point or a gripper."""
        tree: BoxTree = box_tree(self.normalized, self.faces)
        return tree

    @cached_property
    def face_tree(self) -> FaceTree:
        """The faces of `contact_surface` as a tree: what closing jaws meet."""
        tree: FaceTree = face_tree(self.contact_surface)
        return tree

    @cached_property
    def touched_surface(self) -> TouchedSurface:
        """The surface in metres, as the kernels of hands take it; the mesh must have a unit."""
        assert self.unit is not None
        corners = self.corner_normals
        return touched_surface(
            self.vertices * METRES[self.unit],
            self.faces,
            corners.corners,
            corners.normals,
            closed=self.report.closed,
        )

    def scaled(self, factor: float) -> "ObjectMesh":
        """The same object at another size, in the same unit.

        Args:
            factor: Of all lengths, above 0.
        """
        # Normals and their sets do not depend on the size.
        return replace(
            self,
            vertices=locked(self.vertices * factor),
            center=locked(self.center * factor),
            size=self.size * factor,
            center_mass=locked(self.center_mass * factor),
            volume=self.volume * factor**3,
        )

    def to_trimesh(self) -> "trimesh.Trimesh":
        """Return the prepared surface as a `trimesh.Trimesh`, with outward normals and its unit."""
        import trimesh

        surface = trimesh.Trimesh(
            self.vertices, self.faces, vertex_normals=-self.normals, process=False, validate=False
        )
        if self.unit is not None:
            surface.units = self.unit
        return surface

    def to_polydata(self) -> "pyvista.PolyData":
        """Return the prepared surface as a `pyvista.PolyData`, with outward normals as `normal`."""
        data = polydata_of(self.vertices, self.faces)
        data.point_data["normal"] = -self.normals
        return data

    def show(self, **options: Any) -> Any:
        """Label the surface and show it: in a notebook below the cell, elsewhere in a window.

        Args:
            options: As in `grasp3d.viewer.show.show`: settings, height, proxy, model, sampling.

        Raises:
            OutputError: Nothing can be shown in this environment.
        """
        return import_module("grasp3d.viewer.show").show(self, **options)

    def from_normalized(self, points: Floats) -> Floats:
        """Transform points (..., 3) of the normalised frame to the file's frame and unit."""
        return points * self.size + self.center


def polydata_of(vertices: Floats, faces: Ints) -> "pyvista.PolyData":
    """A surface of triangles as PyVista data.

    Args:
        vertices: Positions, shape (V, 3).
        faces: Numbers of their vertices, shape (F, 3).
    """
    import pyvista

    data: pyvista.PolyData = pyvista.PolyData.from_regular_faces(vertices, faces.astype(int))
    return data
